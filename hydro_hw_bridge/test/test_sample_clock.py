"""Device counters as stamps: one mapping, wraps, restarts."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.sample_clock import SampleClock

PERIOD = 2_000_000
NOW = 1_700_000_000_123_456_789


def test_counter_zero_is_where_the_first_cycle_puts_it() -> None:
    clock = SampleClock(PERIOD)
    clock.start(500, NOW)
    assert clock.zero_stamp_ns == NOW - 1_000_000_000
    assert clock.stamp_ns(clock.extend(500)) == NOW


#: As far as a counter of 32 bits tells ahead from back: 49 days at 500 Hz.
FARTHEST = 2**31 - 1


@given(st.lists(st.integers(1, 1000) | st.just(FARTHEST), max_size=50), st.integers(0, 2**32 - 1))
@example([1, 1, 1], 2**32 - 2)
@example([FARTHEST, 1], 5)
def test_intervals_are_exact_over_gaps_and_wraps(gaps: list[int], first: int) -> None:
    clock = SampleClock(PERIOD)
    clock.start(first, NOW)
    counter, cycles = first, 0
    for gap in gaps:
        counter = (counter + gap) % 2**32
        cycles += gap
        stamp = clock.stamp_ns(clock.extend(counter))
        assert stamp == NOW + cycles * PERIOD
        assert clock.counter_of(stamp) == first + cycles


def test_a_ros_clock_that_steps_changes_nothing() -> None:
    """The clock is asked once: a later time is not even an input of a stamp."""
    clock = SampleClock(PERIOD)
    clock.start(0, NOW)
    before = clock.stamp_ns(clock.extend(1))
    after = clock.stamp_ns(clock.extend(2))
    assert after - before == PERIOD


def test_earlier_counters_extend_backwards() -> None:
    clock = SampleClock(PERIOD)
    clock.start(3, NOW)
    assert clock.extend(2**32 - 1) == -1
    assert clock.extend(3) == 3
    assert clock.extend((3 - FARTHEST) % 2**32) == 3 - FARTHEST


@pytest.mark.parametrize("offset", [1, -1, PERIOD // 2, PERIOD - 1])
def test_other_stamps_are_of_no_cycle(offset: int) -> None:
    clock = SampleClock(PERIOD)
    assert clock.counter_of(NOW) is None
    clock.start(7, NOW)
    assert clock.counter_of(NOW) == 7
    assert clock.counter_of(NOW + offset) is None


def test_lockstep_puts_counter_zero_on_a_whole_second() -> None:
    clock = SampleClock(PERIOD, whole_seconds=True)
    clock.start(3, NOW)
    assert clock.zero_stamp_ns is not None
    assert clock.zero_stamp_ns % 1_000_000_000 == 0
    assert 0 <= NOW - clock.stamp_ns(3) < 1_000_000_000


HOUR, SECOND = 3_600_000_000_000, 1_000_000_000


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("step_ns", [-HOUR, 0, 1, HOUR])
@pytest.mark.parametrize("anew", [0, 2, 400])
def test_after_a_restart_stamps_go_on_upwards(whole: bool, step_ns: int, anew: int) -> None:
    """The first is as soon as it can be behind the last before, and no sooner than it is now."""
    clock = SampleClock(PERIOD, whole_seconds=whole)
    clock.start(1000, NOW)
    last = clock.stamp_ns(clock.extend(5000))
    clock.start(anew, NOW + step_ns)
    first = clock.stamp_ns(clock.extend(anew))
    soonest = max(last + PERIOD, NOW + step_ns)
    if whole:
        assert (first - anew * PERIOD) % SECOND == 0
        assert last < first
        assert abs(first - soonest) < SECOND
    else:
        assert first == soonest


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("step_ns", [-HOUR, 0, HOUR])
def test_a_new_clock_goes_on_upwards_from_the_one_before(whole: bool, step_ns: int) -> None:
    before = SampleClock(PERIOD, whole_seconds=whole)
    before.start(1000, NOW)
    last = before.stamp_ns(before.extend(5000))
    for _ in range(2):  # one that never ran stands between
        clock = SampleClock(PERIOD, whole_seconds=whole)
        clock.carry_over(before)
        before = clock
    clock.start(5001, NOW + step_ns)
    first = clock.stamp_ns(clock.extend(5001))
    soonest = max(last + PERIOD, NOW + step_ns)
    assert last < first
    assert first == soonest if not whole else abs(first - soonest) < SECOND


def test_in_lockstep_a_restart_a_whole_second_of_cycles_back_repeats_no_stamp() -> None:
    """Counter 0 on the whole second before would give the stamp that was given last."""
    clock = SampleClock(PERIOD, whole_seconds=True)
    clock.start(0, NOW)
    last = clock.stamp_ns(clock.extend(503))
    clock.start(3, NOW)
    assert clock.stamp_ns(clock.extend(3)) == last + SECOND


def test_use_before_start_and_a_period_of_nothing() -> None:
    with pytest.raises(BridgeError, match="not started"):
        SampleClock(PERIOD).stamp_ns(1)
    with pytest.raises(BridgeError, match="above 0 ns, found 0"):
        SampleClock(0)
    assert SampleClock(1).period_ns == 1
