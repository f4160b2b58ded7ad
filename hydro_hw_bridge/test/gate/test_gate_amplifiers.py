"""Amplifiers that are off: nothing ramps behind their back, and they do not stay so."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.gate.amplifier_watch import AmplifierWatch
from hydro_hw_bridge.gate.gate import Gate, GateState, Outcome, Output
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.held_voltages import HeldVoltages
from hydro_hw_bridge.gate.permissives import Inputs

NAMES = ("lift_valve", "tilt_valve")
#: 2 V legal per 2 ms cycle; 5 cycles are 10 ms.
LIMITS = GateLimits(NAMES, (10.0, 8.0), 0.002, 1000.0, 5, 2.0e6)
ON = Inputs(True, True, True, False, 19.0e6, True)
OFF = replace(ON, amplifiers_on=False)
ZERO = Output((0.0, 0.0), enable=True)
Make = Callable[..., Any]


def _cycle(gate: Gate, counter: int, inputs: Inputs, volts: float = 7.0) -> float:
    gate.advance(counter)
    gate.check(inputs)
    gate.command(counter, NAMES, (volts, 0.0))
    return gate.output.voltages[0]


def _begun(waiting: Make, cycles: int, **inputs: Any) -> Gate:
    """A gate that drives from cycle 100 on, so many of them."""
    gate = waiting(100, **inputs)
    for counter in range(100, 100 + cycles):
        _cycle(gate, counter, replace(ON, **inputs))
    assert isinstance(gate, Gate)
    return gate


def test_the_ramp_begins_when_the_amplifiers_are_on(waiting: Make) -> None:
    gate = _begun(waiting, 20, amplifiers_on=False)
    assert gate.output == ZERO
    assert [_cycle(gate, counter, ON) for counter in range(120, 125)] == [2.0, 4.0, 6.0, 7.0, 7.0]


def test_after_a_cleared_trip_too(driving: Make) -> None:
    gate = driving(6.0)
    gate.trip("test")
    assert gate.clear()[0]
    outputs = [_cycle(gate, counter, OFF) for counter in range(101, 121)]
    outputs += [_cycle(gate, counter, ON) for counter in range(121, 160)]
    assert outputs[:20] == [0.0] * 20
    steps = [b - a for a, b in itertools.pairwise(outputs[19:])]
    assert steps == pytest.approx([10.0 * 0.002] * 39)


def test_the_slow_second_begins_when_they_are_on(driving: Make) -> None:
    gate = driving(6.0, 0.0, replace(LIMITS, reenable_slew_v_s=2.0))
    gate.trip("test")
    assert gate.clear()[0]
    for counter in range(101, 141):
        _cycle(gate, counter, OFF)
    # A second, and as long as the first command may have been old.
    slow = [_cycle(gate, counter, ON) for counter in range(141, 645)]
    assert slow[-1] == pytest.approx(504 * 2.0 * 0.002)
    assert _cycle(gate, 645, ON) == pytest.approx(slow[-1] + 2.0)


def test_amplifiers_that_do_not_come_on_trip_after_100_ms(
    waiting: Make, assert_tripped: Make
) -> None:
    gate = _begun(waiting, 51, amplifiers_on=False)
    assert gate.state is GateState.DRIVING
    _cycle(gate, 151, OFF)
    assert_tripped(gate, "the amplifiers did not come on within 100 ms")
    # They are off as long as it is tripped: that does not keep the trip.
    assert gate.clear()[0]


def test_no_command_is_old_enough_to_end_the_wait_before_an_age_limit_does(
    waiting: Make, assert_tripped: Make
) -> None:
    """A bridge that was given more than 100 ms for a command waits as long for the amplifiers."""
    limits = replace(LIMITS, max_age_cycles=1000)
    gate = waiting(100, limits, amplifiers_on=False)
    for counter in range(100, 1101):
        _cycle(gate, counter, OFF)
    assert gate.state is GateState.DRIVING
    _cycle(gate, 1101, OFF)
    assert_tripped(gate, "the amplifiers did not come on within 2000 ms")


def test_amplifiers_that_switch_off_while_driving_trip_at_once(
    waiting: Make, assert_tripped: Make
) -> None:
    gate = _begun(waiting, 7, amplifiers_on=True)
    gate.advance(107)
    gate.check(OFF)
    assert_tripped(gate, "the amplifiers switched off while driving")


def test_what_they_say_before_they_can_have_answered_is_of_the_time_before(waiting: Make) -> None:
    """On, then off, within the time that a release takes to reach them: no trip, and 0 V."""
    gate = _begun(waiting, 1, amplifiers_on=True)
    assert gate.output.voltages[0] == 2.0
    assert _cycle(gate, 101, ON) == 4.0
    assert [_cycle(gate, counter, OFF) for counter in range(102, 107)] == [0.0] * 5
    assert [_cycle(gate, counter, ON) for counter in range(107, 112)] == [2.0, 4.0, 6.0, 7.0, 7.0]
    gate.advance(112)
    gate.check(OFF)
    assert gate.state is GateState.TRIPPED
    begun = _begun(waiting, 6, amplifiers_on=True)
    assert _cycle(begun, 106, OFF) == 0.0
    assert begun.state is GateState.DRIVING


def test_a_late_stale_off_keeps_no_larger_steps(waiting: Make) -> None:
    """Where the command had been reached already, the way back to it is a ramp again."""
    gate = waiting(100, replace(LIMITS, slew_v_s=5000.0), amplifiers_on=True)
    assert [_cycle(gate, 100, ON), _cycle(gate, 101, ON)] == [7.0, 7.0]
    assert _cycle(gate, 102, OFF) == 0.0
    slow = waiting(100, replace(LIMITS, slew_v_s=1000.0), amplifiers_on=True)
    assert [_cycle(slow, 100, ON, 2.0), _cycle(slow, 101, ON, 2.0)] == [2.0, 2.0]
    assert _cycle(slow, 102, OFF, 3.5) == 0.0
    assert _cycle(slow, 103, ON, 3.5) == 2.0


def test_every_begin_waits_for_them_anew(waiting: Make) -> None:
    gate = _begun(waiting, 20, amplifiers_on=True)
    assert gate.command(119, NAMES, (0.0, 0.0)) is Outcome.RELEASED
    for counter in range(120, 160):
        assert _cycle(gate, counter, OFF) == 0.0
    assert gate.state is GateState.DRIVING


def test_a_missing_permissive_is_the_reason_before_them(
    waiting: Make, assert_tripped: Make
) -> None:
    gate = _begun(waiting, 20, amplifiers_on=True)
    gate.advance(120)
    gate.check(replace(OFF, emergency_stop_ok=False))
    assert_tripped(gate, "emergency stop")


def test_amplifiers_that_do_not_tell_are_driven_as_before(waiting: Make) -> None:
    gate = _begun(waiting, 4, amplifiers_on=None)
    assert gate.output.voltages[0] == 7.0
    for counter in range(104, 300):
        assert _cycle(gate, counter, replace(ON, amplifiers_on=None)) == 7.0


def test_a_watch_that_never_began_waits_for_them() -> None:
    watch = AmplifierWatch(LIMITS, HeldVoltages(LIMITS))
    assert watch.look(False, 5) == ""
    assert watch.look(False, 50) == ""
    assert "did not come on" in watch.look(False, 51)


@pytest.mark.parametrize("on", [True, None])
def test_amplifiers_that_take_nothing_for_longer_than_a_watchdog_waits_trip(
    waiting: Make, assert_tripped: Make, on: bool | None
) -> None:
    gate = _begun(waiting, 20, amplifiers_on=on)
    gate.held.sent(gate.output.voltages, told=True)
    for counter in range(120, 150):
        gate.held.took(0, counter - 1, counter)
        _cycle(gate, counter, replace(ON, amplifiers_on=on))
    assert gate.state is GateState.DRIVING
    gate.held.took(0, 149, 150)
    _cycle(gate, 150, replace(ON, amplifiers_on=on))
    assert_tripped(gate, "the amplifiers took no valve frame for 60 ms")


def test_those_that_are_off_need_not_take_anything(waiting: Make) -> None:
    gate = _begun(waiting, 6, amplifiers_on=False)
    gate.held.sent(gate.output.voltages, told=True)
    for counter in range(106, 151):
        gate.held.took(0, counter - 1, counter)
        assert _cycle(gate, counter, OFF) == 0.0
    gate.held.took(0, 150, 151)
    assert gate.held.complaint == ""
    assert gate.state is GateState.DRIVING
