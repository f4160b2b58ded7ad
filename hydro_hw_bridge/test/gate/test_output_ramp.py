"""How the gate's output follows what it lets through: by legal steps, slowly after a trip."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.gate.gate import Gate, Outcome, Output
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.permissives import Inputs

NAMES = ("lift_valve", "tilt_valve")
#: 2 V legal per 2 ms cycle, tripping above 4 V; 5 cycles are 10 ms.
LIMITS = GateLimits(NAMES, (10.0, 8.0), 0.002, 1000.0, 5, 2.0e6)
GOOD = Inputs(True, True, True, False, 19.0e6)
Make = Callable[..., Any]


def test_a_command_after_missing_ones_is_reached_in_legal_steps(driving: Make, step: Make) -> None:
    """From one end to the other while four commands were lost: never more than twice the limit."""
    # 4 V legal per cycle.
    gate = driving(-10.0, 0.0, replace(LIMITS, slew_v_s=2000.0))
    outputs = []
    for counter in (105, *range(106, 112)):
        assert step(gate, counter, 10.0, 0.0) is Outcome.ACCEPTED
        outputs.append(gate.output.voltages[0])
    assert outputs == [-2.0, 2.0, 6.0, 10.0, 10.0, 10.0, 10.0]
    assert step(gate, 112, 2.0, 0.0) is Outcome.ACCEPTED
    assert gate.output.voltages[0] == 2.0


def test_a_full_swing_at_the_slew_limit_is_legal_whatever_its_rounding(
    driving: Make, step: Make
) -> None:
    gate = driving()
    counter, value = 100, 0.0
    for target in (7.9, -7.9, 0.1):
        while value != target:
            value += min(max(target - value, -4.0), 4.0)
            counter += 1
            assert step(gate, counter, value, value / 3.0) is Outcome.ACCEPTED
            assert gate.output.voltages == (value, value / 3.0)


def test_the_first_command_is_approached_at_the_slew_limit(waiting: Make, step: Make) -> None:
    gate = waiting(100)
    seen = []
    for counter in range(100, 106):
        assert step(gate, counter, 7.0, -3.0) is Outcome.ACCEPTED
        seen.append(gate.output.voltages)
    assert seen == [(2.0, -2.0), (4.0, -3.0), (6.0, -3.0), (7.0, -3.0), (7.0, -3.0), (7.0, -3.0)]
    # The ramp is over: from now on the command itself is followed.
    assert step(gate, 106, 7.0 - 3.9, -3.0) is Outcome.ACCEPTED
    assert gate.output.voltages == pytest.approx((3.1, -3.0))


def test_the_rate_holds_while_ramping_too(waiting: Make, step: Make, assert_tripped: Make) -> None:
    gate = waiting(100)
    step(gate, 100, 7.0, 0.0)
    assert step(gate, 101, 2.9, 0.0) is Outcome.DENIED
    assert_tripped(gate, "step of 4.100 V in 2 ms (limit 4.000 V)")


def test_after_a_cleared_trip_the_output_is_slow_for_a_second(driving: Make, step: Make) -> None:
    gate = driving(6.0, 6.0)
    gate.trip("test")
    assert gate.clear()[0]
    slow = 10.0 * 0.002  # 10 V/s
    outputs = []
    for counter in range(101, 606):
        assert step(gate, counter, 7.0, -3.0) is Outcome.ACCEPTED
        outputs.append(gate.output.voltages)
    assert outputs[0] == (slow, -slow)
    steps = [abs(b[0] - a[0]) for a, b in itertools.pairwise(outputs)]
    assert max(steps) == pytest.approx(slow)
    assert outputs[499] == pytest.approx((7.0, -3.0))
    # It follows slowly though it had arrived already, and at once when the second, and as long as
    # the first command may have been old, is over.
    assert step(gate, 606, 5.0, -3.0) is Outcome.ACCEPTED
    assert gate.output.voltages == (5.0, -3.0)


def test_the_slow_second_outlives_what_interrupts_it(driving: Make, step: Make) -> None:
    gate = driving(6.0)
    gate.trip("test")
    gate.clear()
    step(gate, 101, 6.0, 0.0)
    assert step(gate, 102, 0.0, 0.0) is Outcome.ACCEPTED  # a stop is as fast as ever
    assert gate.output == Output((0.0, 0.0), enable=True)
    step(gate, 103, 3.0, 0.0)
    assert gate.output.voltages == (0.02, 0.0)
    assert gate.command(103, NAMES, (0.0, 0.0)) is Outcome.RELEASED
    step(gate, 104, 3.0, 0.0)
    assert gate.output.voltages == (0.02, 0.0)
    for counter in range(105, 700):
        step(gate, counter, 3.0, 0.0)
    # Once driven through, it is over: the next start is an ordinary one.
    gate.arm()
    step(gate, 700, 3.0, 0.0)
    assert gate.output.voltages == (2.0, 0.0)


def test_a_controller_far_away_is_reached_at_the_slew_limit_after_the_slow_second(
    step: Make,
) -> None:
    gate = Gate(replace(LIMITS, reenable_slew_v_s=1.0))
    gate.advance(0)
    gate.check(GOOD)
    gate.trip("test")
    gate.clear()
    for counter in range(505):
        step(gate, counter, 6.0, 0.0)
    assert gate.output.voltages[0] == pytest.approx(1.01)
    seen = []
    for counter in range(505, 509):
        step(gate, counter, 6.0, 0.0)
        seen.append(gate.output.voltages[0])
    assert seen == pytest.approx([3.01, 5.01, 6.0, 6.0])


def test_a_slow_rate_above_the_slew_limit_changes_nothing() -> None:
    assert replace(LIMITS, reenable_slew_v_s=1e5).reenable_step_v == LIMITS.legal_step_v


def test_zero_at_once_is_legal_from_anywhere(
    driving: Make, step: Make, assert_tripped: Make
) -> None:
    gate = driving(9.0, -7.0)
    assert step(gate, 101, 0.0, 0.0) is Outcome.ACCEPTED
    assert gate.output == Output((0.0, 0.0), enable=True)
    # From there on the rate holds as ever; zero on one valve alone is no stop.
    assert step(gate, 102, 4.0, 0.0) is Outcome.ACCEPTED
    gate = driving(9.0, -7.0)
    assert step(gate, 101, 0.0, -7.0) is Outcome.DENIED
    assert_tripped(gate, "lift_valve: step of 9.000 V")


def test_zero_at_once_while_ramping_too(waiting: Make, step: Make) -> None:
    gate = waiting(100)
    step(gate, 100, 7.0, -3.0)
    assert step(gate, 101, 0.0, 0.0) is Outcome.ACCEPTED
    assert gate.output == Output((0.0, 0.0), enable=True)


def test_a_step_is_one_from_where_the_amplifiers_may_be_too(driving: Make, step: Make) -> None:
    """They tell what they took, and nothing of what leaves: twice the slew limit from there."""
    gate = driving(7.0, 0.0)
    gate.held.sent(gate.output.voltages, told=False)
    reached = []
    for counter in range(101, 106):
        assert step(gate, counter, 7.0 - 2.0 * (counter - 100), 0.0) is Outcome.ACCEPTED
        gate.held.sent(gate.output.voltages, told=True)
        reached.append(gate.output.voltages[0])
    assert reached == [5.0, 3.0, 3.0, 3.0, 3.0]
    gate.held.took(5, 100, 106)
    assert step(gate, 106, -3.0, 0.0) is Outcome.ACCEPTED
    assert gate.output.voltages[0] == 1.0  # as from missing commands: a ramp


def test_in_the_slow_second_it_is_a_slow_step_from_there(driving: Make, step: Make) -> None:
    gate = driving(6.0, 0.0)
    gate.trip("test")
    gate.clear()
    gate.held.sent((0.0, 0.0), told=False)
    reached = []
    for counter in range(101, 104):
        step(gate, counter, 6.0, 0.0)
        gate.held.sent(gate.output.voltages, told=True)
        reached.append(gate.output.voltages[0])
    assert reached == [0.02, 0.02, 0.02]


def test_one_frame_under_way_slows_no_ramp(waiting: Make, step: Make) -> None:
    gate = waiting(100)
    gate.held.sent((0.0, 0.0), told=False)
    reached = []
    for counter in range(100, 103):
        step(gate, counter, 7.0, 0.0)
        gate.held.sent(gate.output.voltages, told=True)
        reached.append(gate.output.voltages[0])
        if counter > 100:
            gate.held.took(1, counter - 1, counter)
    assert reached == [2.0, 4.0, 6.0]
