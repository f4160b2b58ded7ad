"""Commands on their way into the bridge: what they may answer, and who sends them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from hydro_hw_bridge.core.command_intake import CommandIntake
from hydro_hw_bridge.gate.gate import Gate, GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.sample_clock import SampleClock

LIMITS = GateLimits(("lift_valve", "tilt_valve"), (10.0, 10.0), 0.002, 1000.0, 5, 2.0e6)
NOW = 1_700_000_000_500_000_000
PERIOD = 2_000_000


def test_real_time_sends_each_command_at_once(real_time: Any) -> None:
    real_time.cycle(3)
    real_time.start()
    real_time.cycle(4)
    step = real_time.command(4, 1.50012, -0.5)
    command = real_time.sent(step.answer)
    assert command.enable
    assert command.answers(4)
    assert command.voltages == (1.5, -0.5)
    assert real_time.cycle(5).answer is None  # the device holds the last one
    assert real_time.core.commands.accepted == 1


def test_a_cycle_that_is_no_sample_cannot_be_answered(real_time: Any) -> None:
    """Of every cycle a frame is lost, and somebody goes on commanding by stamps he made up."""
    real_time.drive()
    for counter in range(2, 5):
        real_time.without(counter, 3)
        real_time.command(counter, 1.0)
    assert "a stamp that is of no complete cycle" in real_time.core.gate.reason
    assert real_time.core.commands.accepted == 1


def test_an_answer_to_a_sample_before_a_lost_one_is_taken(real_time: Any) -> None:
    real_time.drive()
    real_time.cycle(2)
    real_time.without(3, 3)
    assert real_time.command(2, 1.0).answer is not None


def test_a_cycle_that_was_no_sample_cannot_be_answered_later(real_time: Any) -> None:
    real_time.drive()
    real_time.without(2, 3)
    real_time.cycle(3)
    real_time.command(2, 1.0)
    assert "a stamp that is of no complete cycle" in real_time.core.gate.reason


def test_a_stamp_of_long_ago_is_outdated_and_no_reason_to_stop(real_time: Any) -> None:
    real_time.drive()
    for counter in range(2, 100):
        real_time.cycle(counter)
        real_time.command(counter, 1.0)
    real_time.command(3, 1.0)
    assert real_time.core.commands.outdated == 1
    assert real_time.core.gate.state is GateState.DRIVING


def test_samples_of_before_a_restart_are_none(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    for counter in (1, 2, 3, 0, 0, 1):
        real_time.cycle(counter)
    real_time.without(2, 3)
    real_time.command(2, 1.0)
    assert "a stamp that is of no complete cycle" in real_time.core.gate.reason


@pytest.mark.parametrize("numbers", [(700, 12, 701), (7, 7, 8)])
def test_commands_of_two_publishers_end_driving(real_time: Any, numbers: tuple[int, ...]) -> None:
    real_time.drive()
    zero = real_time.core.clock.zero_stamp_ns
    for counter, number in zip((2, 3, 4), numbers, strict=True):
        real_time.cycle(counter)
        stamp_ns = zero + counter * PERIOD
        real_time.core.command(stamp_ns, real_time.codec.valve_names, (1.0, 0.0), number)
    assert "commands of two publishers" in real_time.core.gate.reason
    assert real_time.core.commands.accepted == 2


@pytest.mark.parametrize(
    ("names", "volts", "made_up_ns", "own"),
    [
        (LIMITS.valve_names, math.nan, 0, "lift_valve: command is not finite (nan)"),
        (LIMITS.valve_names, 99.0, 0, "lift_valve: command of 99.000 V (rated 10 V)"),
        (("lift_valve", "grab"), 1.0, 0, "command for valves lift_valve, grab with 2 voltages"),
        (LIMITS.valve_names, 1.0, 1, "command with a stamp that is of no complete cycle"),
    ],
)
def test_what_is_wrong_with_a_second_publishers_command_is_said_first(
    real_time: Any, names: tuple[str, ...], volts: float, made_up_ns: int, own: str
) -> None:
    """Who is told of a second controller alone looks for one, and not for what it sends."""
    real_time.drive()
    zero = real_time.core.clock.zero_stamp_ns
    for counter in (2, 3):
        real_time.cycle(counter)
        stamp_ns = zero + counter * PERIOD
        real_time.core.command(stamp_ns, LIMITS.valve_names, (1.0, 0.0), 1000 + counter)
    real_time.core.command(stamp_ns + made_up_ns, names, (volts, 0.0), 1)
    reason = real_time.core.gate.reason
    assert reason.startswith(own)
    assert reason.endswith("; commands of two publishers: is there a second controller?")
    assert real_time.core.commands.denied == 1


def test_an_old_duplicate_of_the_same_publisher_does_no_harm(real_time: Any) -> None:
    """A second one's, which its number tells, ends driving."""
    real_time.drive()
    zero = real_time.core.clock.zero_stamp_ns
    for counter in (2, 3, 4):
        real_time.cycle(counter)
        volts = (0.1 * counter, 0.0)
        stamp_ns = zero + counter * PERIOD
        real_time.core.command(stamp_ns, LIMITS.valve_names, volts, 1000 + 2 * counter)
        again = stamp_ns - PERIOD, LIMITS.valve_names, (0.1 * (counter - 1), 0.0)
        real_time.core.command(*again, 1001 + 2 * counter)
    assert real_time.core.gate.state is GateState.DRIVING
    real_time.core.command(*again, 1)
    assert real_time.core.gate.reason.startswith("commands of two publishers")


def test_a_publisher_that_starts_anew_while_nothing_is_driven_is_one(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    zero = real_time.core.clock.zero_stamp_ns or 0
    for counter, number in ((1, 700), (2, 1), (3, 2)):
        real_time.cycle(counter)
        zero = real_time.core.clock.zero_stamp_ns
        stamp_ns = zero + counter * PERIOD
        if number == 1:
            real_time.core.gate.arm()
        real_time.core.command(stamp_ns, real_time.codec.valve_names, (1.0, 0.0), number)
    assert real_time.core.gate.state is GateState.DRIVING


@pytest.mark.parametrize("name", ["real_time", "lockstep"])
def test_a_bad_command_stops_at_once(name: str, request: pytest.FixtureRequest) -> None:
    bench = request.getfixturevalue(name)
    bench.start()
    bench.cycle(1)
    bench.command(1, 1.0)
    bench.cycle(2)
    step = bench.command(2, math.nan)
    command = bench.sent(step.answer)
    assert not command.enable
    assert command.voltages == (0.0, 0.0)
    assert command.answers(2)
    assert [s.voltages for s in step.valve_states] == [(0.0, 0.0)]


def test_a_lost_cycle_is_outdated_once_64_samples_came_after_it() -> None:
    """Until then its stamp is of no sample, and whoever made it up is no controller."""
    clock = SampleClock(PERIOD)
    clock.start(0, NOW)
    intake = CommandIntake(Gate(LIMITS), clock)
    for counter in (0, *range(2, 65)):
        intake.sampled(counter)
    names = LIMITS.valve_names
    assert intake.judge(NOW + PERIOD, names, (0.0, 0.0), None)[1] is None
    intake.sampled(65)
    assert intake.judge(NOW + PERIOD, names, (0.0, 0.0), None)[1] == 1
    assert intake.judge(NOW + 2 * PERIOD, names, (0.0, 0.0), None)[1] == 2
