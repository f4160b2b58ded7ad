"""What real processes have to show of a fault on the bus, and what excuses them."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.faults import bus_injections
from hydro_hw_bridge.faults.bus_faults import BRIDGE, CONTENT, DEVICE, TRANSPORT, BusFault
from hydro_hw_bridge.faults.injection import AGE, Injection
from hydro_hw_bridge.faults.naming import Diagnosis
from hydro_hw_bridge.protocol.codec import Codec
from hydro_ident.study.faults.promised import AGE_MS, ALL_FRAMES_MS, WATCHDOG_MS
from hydro_ident.study.faults.wall_bus import DRAWN, _judged
from hydro_ident.study.faults.wall_outcomes import Judgement, WallOutcome
from hydro_ident.study.faults.wall_time import WallRun
from hydro_model.robot import Robot

BEFORE = Diagnosis({"cycles_incomplete": 3, "trips": 1, "cycles_complete": 90}, ("", "", ""))


@pytest.fixture(scope="module")
def codec(robot: Robot) -> Codec:
    return Codec.load(None, None, robot)


class Quiet:
    """What a run of processes needs to put a fault on a bus; what it was held to."""

    limit_ms: float | None = None

    def drive(self) -> None: ...

    def put_on_the_bus(self, fault: dict[str, Any]) -> int:
        self.fault = fault
        return 0

    def measured(self, kind: str, since_ns: int, limit_ms: float | None) -> WallOutcome:
        self.limit_ms = limit_ms
        return WallOutcome(kind, limit_ms, 1.0, 0.0, "")


@pytest.mark.parametrize(
    ("kind", "direction", "promised_ms"),
    [
        # A silent machine: as long as a command may be old, and never the watchdog's time.
        ("lost", DEVICE, AGE_MS),
        ("late", DEVICE, AGE_MS),
        # Broken frames are no silence, and without the bridge's the amplifiers are alone.
        ("bit_flip", DEVICE, WATCHDOG_MS),
        ("lost", BRIDGE, WATCHDOG_MS),
        ("late", BRIDGE, WATCHDOG_MS),
        ("bit_flip", BRIDGE, WATCHDOG_MS),
    ],
)
def test_a_bus_without_frames_is_held_to_what_is_promised_of_its_kind(
    kind: str, direction: str, promised_ms: float
) -> None:
    assert (AGE_MS, WATCHDOG_MS) == (16.0, 54.0)  # 12 and 50 ms of the device, 4 of the way
    run = Quiet()
    WallRun.bus_fault(run, kind, direction, random.Random(1))  # type: ignore[arg-type]
    assert (run.fault["kind"], run.fault["direction"]) == (kind, direction)
    assert run.limit_ms == promised_ms
    assert (kind, direction) in ALL_FRAMES_MS


def _after(reason: str = "", **grown: int) -> Diagnosis:
    return replace(BEFORE, counters={**BEFORE.counters, **grown}, texts=("", reason, ""))


def test_every_kind_that_a_proxy_can_make_is_drawn(codec: Codec) -> None:
    """All but a sensor that is stuck, which needs a machine that moves."""
    seen = set()
    for number in range(60):
        source = random.Random(number)
        for draw in DRAWN.values():
            fault = draw(source, codec, 0).fault
            assert isinstance(fault, BusFault)
            seen.add(fault.kind)
    assert seen == {*CONTENT, *TRANSPORT} - {"stuck"}


def split_of(cycles: int, codec: Codec) -> Injection:
    """Drawn: samples stay away for so many cycles."""
    drawn = (bus_injections.split(random.Random(n), codec, 0) for n in range(1000))
    return next(one for one in drawn if one.fault.cycles == cycles)


def test_a_fault_has_to_be_counted(codec: Codec) -> None:
    injection = split_of(1, codec)
    assert "cycles_incomplete" in _judged(injection, BEFORE, _after(cycles_complete=190)).broken
    assert _judged(injection, BEFORE, _after(cycles_incomplete=5)) == Judgement()


def test_driving_on_where_that_is_right(codec: Codec) -> None:
    injection = split_of(1, codec)
    assert injection.limit_cycles is None
    tripped = _after("lift: position jumped", cycles_incomplete=5, trips=2)
    assert "tripped: lift: position jumped" in _judged(injection, BEFORE, tripped).broken


def test_a_busy_computer_is_no_fault_of_the_bridge(codec: Codec) -> None:
    """Samples that stay away for three cycles are none that starve the gate by themselves."""
    late = _after("no command for 14 ms", cycles_incomplete=5, trips=2)
    for cycles in (1, 2, 3):
        judged = _judged(split_of(cycles, codec), BEFORE, late)
        assert judged == Judgement(excused="no command for 14 ms")


@pytest.mark.parametrize("cycles", [5, 6, 8, 10])
def test_a_fault_that_starves_the_gate_has_to_trip_and_is_held_to_its_time(
    codec: Codec, cycles: int
) -> None:
    injection = split_of(cycles, codec)
    assert injection.limit_cycles == AGE
    for said in (
        "no command for 12 ms (limit 10 ms)",
        "no whole cycle for 12 ms, missing ENCODERS",
    ):
        starved = _after(said, cycles_incomplete=5, trips=2)
        assert _judged(injection, BEFORE, starved) == Judgement()  # no stall is needed for it
    drove_on = _after(cycles_incomplete=5)
    assert (
        "said nowhere: 'no whole cycle for|no command for'"
        in _judged(injection, BEFORE, drove_on).broken
    )


def test_a_cycle_short_of_that_a_computer_that_is_late_may_trip(codec: Codec) -> None:
    injection = split_of(4, codec)
    assert injection.limit_cycles is None
    late = _after("no command for 12 ms (limit 10 ms)", cycles_incomplete=5, trips=2)
    assert _judged(injection, BEFORE, late) == Judgement()
    assert injection.wrongly_tripped(late.texts[1], lockstep=False)  # in device time nobody is
    other = _after("emergency stop", cycles_incomplete=5, trips=2)
    assert "tripped: emergency stop" in _judged(injection, BEFORE, other).broken


def test_a_trip_has_to_name_its_fault(codec: Codec) -> None:
    injection = next(
        one
        for n in range(50)
        if (one := bus_injections.intruder(random.Random(n), codec, 0)).named.says
        == "second bridge"
    )
    named = _after("a second bridge drives the valves", trips=2)
    assert _judged(injection, BEFORE, named) == Judgement()
    other = _after("emergency stop", trips=2)
    assert "said nowhere: 'second bridge'" in _judged(injection, BEFORE, other).broken


def test_noise_that_passes_its_check_may_trip_and_nothing_else_may(codec: Codec) -> None:
    reason = "two different frames PRESSURES_1 of one cycle: a second device?"
    tripped = _after(reason, cycles_corrupt=9, cycles_duplicates=1, trips=2)
    before = replace(
        BEFORE, counters={**BEFORE.counters, "cycles_corrupt": 0, "cycles_duplicates": 0}
    )
    noise = _judged(bus_injections.babble(random.Random(1), codec, 0), before, tripped)
    assert noise == Judgement()
    other = _judged(bus_injections.corrupt(random.Random(1), codec, 0), before, tripped)
    assert "tripped: two different frames" in other.broken
