"""A device that is faster than its robot file says, against clocks that differ and processes that
stall."""

from __future__ import annotations

from typing import Any

import pytest

from hydro_hw_bridge.core.supervision import OTHER_PERIOD
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.monitoring.period_watch import GAP_S, GRACE_S, SHARE, PeriodWatch

PERIOD_S = 0.002


class Device:
    """Cycles one after another before a watch."""

    def __init__(self, period_s: float = PERIOD_S, counter: int = 0, at_s: float = 0.0) -> None:
        self.watch = PeriodWatch(period_s)
        self.counter, self.at_s = counter, at_s
        self.said = self.watch.look(counter, at_s)

    def leaps(self, cycles: int, after_s: float) -> str:
        """The next cycle, and so many on."""
        self.counter += cycles
        self.at_s += after_s
        self.said = self.watch.look(self.counter, self.at_s)
        return self.said

    def runs(self, cycles: int, apart_s: float) -> int:
        """So many cycles; how many of them were told as too fast."""
        return sum(bool(self.leaps(1, apart_s)) for _ in range(cycles))


def first_told(watch: PeriodWatch, true_s: float, end_s: float) -> float | None:
    """When cycles that are `true_s` apart are told, s after the first."""
    for k in range(round(end_s / true_s)):
        if watch.look(1000 + k, 50.0 + k * true_s):
            return k * true_s
    return None


@pytest.mark.parametrize("true_s", [0.001, 0.0016])
def test_a_faster_device_is_told_once_it_is_ahead_by_the_grace(true_s: float) -> None:
    told_s = first_told(PeriodWatch(PERIOD_S), true_s, 20.0)
    # Ahead by (period / true - 1) of the time since, which exceeds grace and share then.
    assert told_s == pytest.approx(GRACE_S / (PERIOD_S / true_s - 1.0 - SHARE), abs=2 * true_s)


@pytest.mark.parametrize("true_s", [0.002, 0.00199, 0.00182, 0.004])
def test_quartzes_differ_and_slow_devices_show_elsewhere(true_s: float) -> None:
    assert first_told(PeriodWatch(PERIOD_S), true_s, 300.0) is None


def test_it_is_said_by_how_much() -> None:
    for period_s, apart_s, words in (
        (PERIOD_S, 0.001, "1 ms apart, expected 2 ms"),
        (0.00125, 0.000625, "0.625 ms apart, expected 1.25 ms"),
    ):
        device = Device(period_s)
        assert device.runs(round(1.0 / apart_s), apart_s) == 0
        assert device.runs(round(0.3 / apart_s), apart_s)
        assert device.said.startswith(f"the device's cycles are {words} (rate_hz")


def test_the_grace_ends_where_it_says() -> None:
    for cycles, told in ((1049, False), (1052, True)):
        # 1 s later: ahead by 1.1 s at 1050 cycles.
        device = Device(PERIOD_S, 7, 3.0)
        device.runs(cycles, 1.0 / cycles)
        assert bool(device.said) is told


@pytest.mark.parametrize("seconds", [3, 60, 86_400])
@pytest.mark.parametrize("at_once", [True, False], ids=["at once", "in pieces"])
def test_cycles_that_are_missing_were_not_fast(seconds: int, at_once: bool) -> None:
    """The device's counter leapt, or this computer slept, whose clock stands still meanwhile."""
    device = Device()
    device.runs(1000, PERIOD_S)
    leaps = 1 if at_once else 3
    for _ in range(leaps):
        assert device.leaps(seconds * 500 // leaps, PERIOD_S) == ""
        assert device.runs(50, PERIOD_S) == 0
    # It is looked at as before: a device that is faster is found.
    assert device.runs(1250, 0.001)


@pytest.mark.parametrize(("missing", "told"), [(49, True), (50, False)])
def test_where_less_is_missing_the_rate_is_known(missing: int, told: bool) -> None:
    assert round(GAP_S / PERIOD_S) == 50
    device = Device()
    for _ in range(40):
        device.leaps(missing + 1, (missing + 1) * 0.001)
    assert bool(device.said) is told


def test_a_slow_device_is_looked_at_as_well() -> None:
    """One cycle takes as long as what may be missing, or longer."""
    device = Device(0.5)
    assert device.runs(10, 0.25)
    assert "250 ms apart, expected 500 ms" in device.said
    assert device.leaps(100, 0.5) == device.said  # of cycles that are missing, nothing


@pytest.mark.parametrize("queued", [600, 5000, 50_000])
def test_what_was_read_late_is_too_fast_for_a_second_at_most(queued: int) -> None:
    """An interface that does not tell when frames came, and a reader that stood still."""
    device = Device()
    device.runs(10, PERIOD_S)
    device.leaps(1, queued * PERIOD_S)
    assert device.runs(queued, 1e-5)
    back = round(1.0 / PERIOD_S)
    told = device.runs(back + 2, PERIOD_S)
    assert told <= back
    assert device.said == ""


def test_a_device_that_is_faster_is_told_as_long_as_it_is() -> None:
    device = Device()
    device.runs(1200, 0.001)
    assert device.runs(50_000, 0.001) == 50_000
    back = round(1.0 / PERIOD_S)
    assert device.runs(back + 2, PERIOD_S) == pytest.approx(back, abs=10)
    assert device.said == ""


def test_a_cycle_that_seems_to_come_before_the_last_tells_nothing() -> None:
    """How long frames waited is told by the computer's clock, which may be set meanwhile."""
    device = Device()
    device.runs(1000, PERIOD_S)
    for _ in range(5):
        assert device.leaps(1, -3600.0) == ""
        assert device.leaps(1, 3600.0) == ""
    assert device.runs(1250, 0.001)


def test_what_was_late_once_may_come_sooner_afterwards() -> None:
    """A stall of up to the grace, at the first cycle or later, is no faster device."""
    watch = PeriodWatch(PERIOD_S)
    watch.look(0, 0.9)
    for k in range(1, 5000):
        assert watch.look(k, max(0.9, k * PERIOD_S)) == ""
    for k in range(5000, 10_000):
        assert watch.look(k, max(10.9, k * PERIOD_S)) == ""


def test_after_a_pause_it_is_known_as_soon_as_before() -> None:
    """Time that passes without cycles is no credit for a faster device."""
    watch = PeriodWatch(PERIOD_S)
    watch.look(0, 0.0)
    watch.look(1, 100.0)
    for k in range(2, 1300):
        said = watch.look(k, 100.0 + k * 0.001)
    assert said
    device = Device()
    for _ in range(3):  # nor is it one against it: what was ahead before is past
        assert device.runs(900, 0.001) == 0
        device.leaps(1, 100.0)
    device.leaps(1, 0.5)  # behind by half a second, a stall: what follows is ahead of that
    assert device.runs(1000, 0.00088)


def test_a_device_that_counts_anew_is_looked_at_anew() -> None:
    device = Device()
    assert device.runs(1200, 0.001)
    for counter in (device.counter + 1, 20_000):
        device.watch.forget()
        assert device.watch.look(counter, device.at_s) == ""


def test_the_bridge_drives_no_device_that_is_faster(real_time: Any, lockstep: Any) -> None:
    for bench in (real_time, lockstep):
        bench.drive()
        bench.core.paced(10.0)
        for counter in range(2, 9):
            bench.cycle(counter)
            bench.command(counter, 1.0)
        for k in range(1200):
            bench.core.assembler.counter += 1
            step = bench.core.paced(10.0 + 0.001 * k)
            if bench.core.gate.state is GateState.TRIPPED:
                break
        assert (bench.core.gate.state is GateState.TRIPPED) is (bench is real_time)
        assert (step.answer is not None) is (bench is real_time)
    assert "expected 2 ms (rate_hz of the robot file)" in real_time.core.gate.clear()[1]
    bare = type(real_time.core)(real_time.codec, real_time.core.gate.limits, lockstep=False)
    assert bare.paced(1.0).answer is None


@pytest.mark.parametrize("first", [5, (1 << 26) + 2000], ids=["back", "far ahead"])
def test_a_restart_of_the_device_begins_anew(real_time: Any, first: int) -> None:
    real_time.drive()

    def runs(begin: int, end: int) -> bool:
        """Cycles that all come at once; whether they are too fast."""
        for counter in range(begin, end):
            real_time.cycle(counter)
            real_time.core.paced(10.0)
        return OTHER_PERIOD in real_time.core.gate.faults

    assert not runs(2, 402)  # ahead by 0.8 s, which is past with the restart
    assert not runs(first, first + 400)  # so far ahead it counts anew, too
    assert real_time.core.assembler.counters.restarts == 1
    assert runs(first + 400, first + 620)
