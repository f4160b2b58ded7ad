"""A device that is faster than its robot file says, against clocks that differ and processes that
stall."""

from __future__ import annotations

from typing import Any

import pytest

from hydro_hw_bridge.gate import GateState
from hydro_hw_bridge.period_watch import GRACE_S, SHARE, PeriodWatch
from hydro_hw_bridge.supervision import OTHER_PERIOD

PERIOD_S = 0.002


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
    watch = PeriodWatch(PERIOD_S)
    assert watch.look(0, 0.0) == ""
    assert watch.look(1049, 0.999) == ""
    said = watch.look(1250, 1.25)
    assert said.startswith("the device's cycles are 1 ms apart, expected 2 ms (rate_hz")
    watch = PeriodWatch(0.00125)
    watch.look(0, 0.0)
    said = watch.look(4000, 2.5)
    assert said.startswith("the device's cycles are 0.625 ms apart, expected 1.25 ms (rate_hz")


def test_the_grace_ends_where_it_says() -> None:
    for cycles, told in ((1049, False), (1052, True)):
        watch = PeriodWatch(PERIOD_S)
        watch.look(7, 3.0)
        # 1 s later: ahead by 1.1 s at 1050 cycles.
        assert bool(watch.look(7 + cycles, 4.0)) is told


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
    watch.forget()
    watch.look(0, 0.0)
    watch.look(1, 0.5)  # behind by half a second, a stall: what follows is ahead of that
    assert watch.look(1 + 1000, 0.5 + 0.88)


def test_a_device_that_counts_anew_is_looked_at_anew() -> None:
    watch = PeriodWatch(PERIOD_S)
    watch.look(0, 0.0)
    assert watch.look(10_000, 0.1)
    watch.forget()
    assert watch.look(20_000, 0.1) == ""


def test_the_bridge_drives_no_device_that_is_faster(real_time: Any, lockstep: Any) -> None:
    for bench in (real_time, lockstep):
        bench.drive()
        bench.core.paced(10.0)
        for counter in range(2, 9):
            bench.cycle(counter)
            bench.command(counter, 1.0)
        bench.core.assembler.counter += 5000
        step = bench.core.paced(10.1)
        assert (bench.core.gate.state is GateState.TRIPPED) is (bench is real_time)
        assert (step.answer is not None) is (bench is real_time)
    assert "expected 2 ms (rate_hz of the robot file)" in real_time.core.gate.clear()[1]
    bare = type(real_time.core)(real_time.codec, real_time.core.gate.limits, lockstep=False)
    assert bare.paced(1.0).answer is None


@pytest.mark.parametrize("first", [5, (1 << 26) + 2000], ids=["back", "far ahead"])
def test_a_restart_of_the_device_begins_anew(real_time: Any, first: int) -> None:
    real_time.drive()
    real_time.cycle(1000)
    real_time.core.paced(10.0)
    for counter in range(first, first + 30):  # so far ahead it counts anew, too
        real_time.cycle(counter)
        real_time.core.paced(10.0)
    assert real_time.core.assembler.counters.restarts == 1
    assert OTHER_PERIOD not in real_time.core.gate.faults
    for counter in range(first + 30, first + 650):
        real_time.cycle(counter)
        real_time.core.paced(10.0)
    assert OTHER_PERIOD in real_time.core.gate.faults
