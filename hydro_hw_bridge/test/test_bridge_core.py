"""The bridge's state machine without bus and ROS: real time, lockstep, valve states, restarts."""

from __future__ import annotations

import copy
import math
from typing import Any

import pytest

from hydro_hw_bridge.bridge_core import CLOSING_CYCLES, FOREIGN
from hydro_hw_bridge.bridge_report import summary
from hydro_hw_bridge.bridge_step import NOTHING
from hydro_hw_bridge.gate import GateState
from hydro_hw_bridge.own_frames import KEPT, OwnFrames

NOW = 1_700_000_000_500_000_000
PERIOD = 2_000_000


@pytest.mark.parametrize("name", ["real_time", "lockstep"])
def test_inactive_reads_and_never_sends(name: str, request: pytest.FixtureRequest) -> None:
    bench = request.getfixturevalue(name)
    for counter in range(3, 10):
        step = bench.cycle(counter)
        assert step.answer is None
        assert step.sample.counter == counter
        assert step.sample.stamp_ns == bench.core.clock.zero_stamp_ns + counter * PERIOD
        stated = counter - 1 if bench.core.lockstep else counter
        if stated >= 3:
            assert [s.voltages for s in step.valve_states] == [(0.0, 0.0)]
            since = step.sample.stamp_ns - step.valve_states[0].stamp_ns
            assert since == (counter - stated) * PERIOD
        assert bench.command(counter, 1.0) is NOTHING
    assert bench.core.commands.not_driving == 7


def test_samples_carry_one_stamp_from_the_first_cycle_on(real_time: Any) -> None:
    assert real_time.cycle(3).sample.stamp_ns == NOW
    assert real_time.cycle(7).sample.stamp_ns == NOW + 4 * PERIOD


def test_real_time_tells_the_device_zero_while_it_waits(real_time: Any) -> None:
    real_time.cycle(3)
    real_time.core.activate()
    command = real_time.sent(real_time.cycle(4).answer)
    assert command.answers(4)
    assert not command.enable
    assert command.voltages == (0.0, 0.0)
    assert real_time.command(4, 1.0) is NOTHING  # subscribers are not there yet
    assert real_time.core.commands.not_driving == 1


def test_a_bridge_that_waits_says_for_what(real_time: Any) -> None:
    def said(*missing: str) -> str:
        return summary(real_time.core, list(missing), silent=False)[1]

    real_time.cycle(3)
    assert said() == "inactive: reading"
    real_time.core.activate()
    assert said("/joint_states (0 of 1)") == "waiting for subscribers: /joint_states (0 of 1)"
    assert said() == "waiting for the next sample"  # the subscribers are there
    real_time.core.ready = True
    assert said() == "waiting for a first command"
    real_time.cycle(4)
    real_time.command(4, 1.0)
    assert said() == "driving"


def test_silence_is_an_error_in_real_time_and_waiting_in_lockstep(
    real_time: Any, lockstep: Any
) -> None:
    def said(bench: Any) -> tuple[str, str]:
        return summary(bench.core, [], silent=True)

    assert said(real_time) == ("error", "nothing from the device")
    assert said(lockstep) == ("warn", "inactive: no device")
    for bench in (real_time, lockstep):
        bench.drive()
    assert said(real_time) == ("error", "nothing from the device")
    assert said(lockstep) == ("warn", "waiting for the device")


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


def test_valve_state_of_a_cycle_is_what_the_wire_carried(real_time: Any) -> None:
    real_time.start()
    states = [*real_time.cycle(1).valve_states]
    states += real_time.command(1, 1.0).valve_states  # cycle 1 was answered with 0 V already
    states += real_time.cycle(2).valve_states
    states += real_time.command(2, 2.0).valve_states
    states += real_time.cycle(3).valve_states  # no command for 3: held
    states += real_time.cycle(4).valve_states
    states += real_time.command(3, 2.5).valve_states  # late: in force from cycle 4 on
    states += real_time.cycle(5).valve_states
    zero = real_time.core.clock.zero_stamp_ns or 0
    counters = [(state.stamp_ns - zero) // PERIOD for state in states]
    assert counters == [1, 2, 3, 4]
    assert [state.voltages[0] for state in states] == [0.0, 2.0, 2.0, 2.5]
    assert states[0].spools == pytest.approx((0.1, -0.2))


def test_real_time_silence_of_the_controller_ends_at_zero(real_time: Any) -> None:
    real_time.start()
    real_time.cycle(1)
    real_time.command(1, 1.0)
    for counter in range(2, 7):
        assert real_time.cycle(counter).answer is None
        assert real_time.early == []
    answers = [real_time.cycle(7).answer]
    answers += [step.answer for step in real_time.early]
    assert len(answers) == 2  # at the sync frame already, not only when the cycle is complete
    for answer in answers:
        command = real_time.sent(answer)
        assert not command.enable
        assert command.voltages == (0.0, 0.0)
    assert "no command for 12 ms" in real_time.core.gate.reason
    real_time.cycle(8)
    assert real_time.command(8, 0.0) is NOTHING
    assert real_time.core.commands.denied == 1


def test_age_counts_on_though_cycles_are_incomplete(real_time: Any) -> None:
    real_time.start()
    real_time.cycle(1)
    real_time.command(1, 1.0)
    answers = []
    for counter in range(2, 9):
        sync = real_time.codec.encode_cycle(real_time.readings(counter))[0]
        frame = real_time.codec.receive(sync)
        assert frame is not None
        answers.append(real_time.core.receive(frame, NOW).answer)
    assert [answer is None for answer in answers] == [True] * 5 + [False, True]
    assert not real_time.sent(answers[5]).enable


def test_silence_of_the_device(real_time: Any, lockstep: Any) -> None:
    for bench in (real_time, lockstep):
        bench.start()
        bench.cycle(1)
        bench.command(1, 1.0)
        assert bench.core.silence(0.010) is NOTHING
    assert not real_time.sent(real_time.core.silence(0.011).answer).enable
    assert "nothing from the device for 10 ms" in real_time.core.gate.reason
    assert lockstep.core.silence(1000.0) is NOTHING
    assert lockstep.core.gate.state is GateState.DRIVING


def _without(bench: Any, counter: int, lost: int, **changes: Any) -> list[Any]:
    """Steps of a cycle that lacks one of its frames."""
    messages = bench.codec.encode_cycle(bench.readings(counter, **changes))
    frames = [bench.codec.receive(m) for k, m in enumerate(messages) if k != lost]
    return [bench.core.receive(frame, NOW) for frame in frames]


@pytest.mark.parametrize("bit", ["emergency_stop_ok", "enable_switch", "pump_on"])
def test_a_permissive_acts_by_its_frame_alone(real_time: Any, bit: str) -> None:
    """Whether or not the rest of the cycle comes."""
    real_time.drive()
    steps = _without(real_time, 2, 3, **{bit: False})
    answers = [step.answer for step in steps if step.answer is not None]
    assert len(answers) == 1
    assert not real_time.sent(answers[0]).enable
    assert real_time.core.gate.state is GateState.TRIPPED


def test_a_permissive_of_a_frame_of_the_past_says_nothing(real_time: Any) -> None:
    real_time.drive()
    real_time.cycle(2)
    real_time.cycle(3)
    assert all(step is NOTHING for step in _without(real_time, 2, 3, emergency_stop_ok=False))
    assert real_time.core.gate.state is GateState.DRIVING


def test_a_cycle_that_is_no_sample_cannot_be_answered(real_time: Any) -> None:
    """Of every cycle a frame is lost, and somebody goes on commanding by stamps he made up."""
    real_time.drive()
    for counter in range(2, 5):
        _without(real_time, counter, 3)
        real_time.command(counter, 1.0)
    assert "a stamp that is of no complete cycle" in real_time.core.gate.reason
    assert real_time.core.commands.accepted == 1


def test_an_answer_to_a_sample_before_a_lost_one_is_taken(real_time: Any) -> None:
    real_time.drive()
    real_time.cycle(2)
    _without(real_time, 3, 3)
    assert real_time.command(2, 1.0).answer is not None


def test_without_samples_driving_ends(real_time: Any) -> None:
    real_time.drive()
    for counter in range(2, 9):
        _without(real_time, counter, 3)
    assert "no command for 12 ms" in real_time.core.gate.reason


def test_two_different_frames_of_one_cycle_end_driving(real_time: Any) -> None:
    real_time.drive()
    messages = real_time.codec.encode_cycle(real_time.readings(2))
    other = real_time.codec.encode_cycle(real_time.readings(2, positions=(0.31, -0.5)))
    frames = [real_time.codec.receive(m) for m in (*messages[:2], other[1], *messages[2:])]
    steps = [real_time.core.receive(frame, NOW) for frame in frames]
    assert all(step.sample is None for step in steps)
    assert "two different frames ENCODERS of one cycle" in real_time.core.gate.reason
    assert [real_time.sent(s.answer).enable for s in steps if s.answer is not None] == [False]


def test_a_cycle_that_was_no_sample_cannot_be_answered_later(real_time: Any) -> None:
    real_time.drive()
    _without(real_time, 2, 3)
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
    _without(real_time, 2, 3)
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


def test_valve_frames_of_another_sender_end_driving_until_they_are_gone(real_time: Any) -> None:
    real_time.drive()
    own, codec = real_time.codec.receive(real_time.wire.sent[-1]), real_time.codec
    assert real_time.core.hear_command(own) is NOTHING  # as some buses let a sender hear itself
    other = codec.receive(codec.encode_command(1, (9.0, 0.0), enable=True))
    assert not real_time.sent(real_time.core.hear_command(other).answer).enable
    assert real_time.core.commands.foreign == 1
    assert "another sender" in real_time.core.gate.clear()[1]
    real_time.core.condition(FOREIGN, "")
    assert real_time.core.gate.clear()[0]


def test_a_new_core_knows_the_frames_of_the_one_before(lockstep: Any, real_time: Any) -> None:
    real_time.drive()
    own = [real_time.codec.receive(message) for message in real_time.wire.sent]
    assert len(own) > 1
    new = lockstep.core
    new.carry_over(real_time.core)
    assert all(new.hear_command(frame) is NOTHING for frame in own)
    assert new.commands.foreign == 0


def test_own_frames_are_known_for_seconds() -> None:
    own = OwnFrames()
    frames = [number.to_bytes(8, "little") for number in range(KEPT + 1)]
    for data in frames:
        own.add(data)
    assert frames[0] not in own
    assert all(data in own for data in frames[1:])
    assert KEPT * PERIOD >= 8e9


def test_a_new_core_takes_over_a_trip(lockstep: Any, real_time: Any) -> None:
    real_time.drive()
    assert real_time.command(2, 99.0).answer is not None
    new = lockstep.core
    new.carry_over(real_time.core)
    assert (new.gate.state, new.gate.reason) == (GateState.TRIPPED, real_time.core.gate.reason)


def test_after_silence_no_old_sample_begins_to_drive(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(1)
    assert real_time.core.silence(10.0) is NOTHING
    assert real_time.command(1, 1.0) is NOTHING
    assert real_time.core.commands.outdated == 1
    assert real_time.core.gate.state is GateState.WAITING
    real_time.cycle(2)
    assert real_time.command(2, 1.0).answer is not None


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


def test_a_permissive_that_goes_stops_with_its_own_cycle(real_time: Any) -> None:
    real_time.start()
    real_time.cycle(1)
    real_time.command(1, 1.0)
    assert not real_time.sent(real_time.cycle(2, emergency_stop_ok=False).answer).enable
    assert real_time.core.gate.reason == "emergency stop"


def test_lockstep_waits_for_subscribers_and_first_command(lockstep: Any) -> None:
    lockstep.cycle(0)
    lockstep.core.activate()
    step = lockstep.cycle(0)
    assert step.answer is None
    assert step.sample is not None
    assert step.sample.repeated
    assert lockstep.command(0, 1.0) is NOTHING
    lockstep.core.ready = True
    assert lockstep.cycle(0).answer is None
    command = lockstep.sent(lockstep.command(0, 1.0).answer)
    assert command.answers(0)
    assert command.enable


def test_lockstep_repeats_the_sample_until_answered_then_the_answer(lockstep: Any) -> None:
    lockstep.start()
    first = lockstep.cycle(0)
    again = lockstep.cycle(0)
    assert again.sample is not None
    assert first.sample is not None
    assert again.sample.stamp_ns == first.sample.stamp_ns
    assert again.sample.readings == first.sample.readings
    assert again.valve_states == ()
    answer = lockstep.command(0, 1.0).answer
    assert lockstep.command(0, 1.0) is NOTHING  # the controller answers repeats alike
    step = lockstep.cycle(0)
    assert step.sample is None
    assert step.answer is answer
    assert lockstep.core.commands.repeated == 1


def test_lockstep_goes_on_while_tripped(lockstep: Any) -> None:
    lockstep.start()
    lockstep.cycle(0)
    lockstep.command(0, 1.0)
    lockstep.cycle(1)
    lockstep.core.gate.trip("test")
    command = lockstep.sent(lockstep.cycle(1).answer)
    assert command.answers(1)
    for counter in range(2, 20):
        command = lockstep.sent(lockstep.cycle(counter).answer)
        assert command.answers(counter)
        assert not command.enable
    assert lockstep.core.gate.clear()[0]
    assert lockstep.cycle(20).answer is None
    assert lockstep.sent(lockstep.command(20, 0.5).answer).enable


def test_a_controller_that_stops_releases_in_lockstep(lockstep: Any) -> None:
    lockstep.start()
    lockstep.cycle(0)
    lockstep.command(0, 1.0)
    assert not lockstep.sent(lockstep.command(0, 0.0).answer).enable
    assert lockstep.core.gate.state is GateState.WAITING
    assert lockstep.cycle(1).answer is None


def test_deactivation_sends_zero_and_inactive_nothing(lockstep: Any) -> None:
    assert lockstep.core.deactivate() is None
    lockstep.start()
    lockstep.cycle(0)
    lockstep.command(0, 1.0)
    lockstep.cycle(1)
    command = lockstep.sent(lockstep.core.deactivate())
    assert command.answers(1)
    assert not command.enable
    # Any frame may be lost: some more cycles are answered, repeated ones too.
    for counter in (1, *range(2, CLOSING_CYCLES + 1)):
        command = lockstep.sent(lockstep.cycle(counter).answer)
        assert command.answers(counter)
        assert (command.voltages, command.enable) == ((0.0, 0.0), False)
    assert lockstep.cycle(CLOSING_CYCLES + 1).answer is None
    assert lockstep.core.deactivate() is None  # was it already
    assert lockstep.core.gate.state is GateState.WAITING


def test_a_restarted_device_trips_and_maps_anew(real_time: Any) -> None:
    real_time.start()
    last = real_time.cycle(5000).sample
    real_time.command(5000, 1.0)
    assert real_time.cycle(0) is NOTHING
    step = real_time.cycle(1)
    assert "restarted" in real_time.core.gate.reason
    assert not real_time.sent(step.answer).enable
    assert step.sample is not None
    assert last is not None
    assert step.sample.stamp_ns > last.stamp_ns
    assert step.sample.counter == 1
    assert real_time.core.gate.clear()[0]
    real_time.cycle(2)
    assert real_time.sent(real_time.command(2, 0.5).answer).enable


def test_a_restart_while_waiting_needs_no_clearing(lockstep: Any) -> None:
    lockstep.start()
    lockstep.cycle(5000)
    lockstep.cycle(0)
    step = lockstep.cycle(0)
    assert step.sample is not None
    assert not step.sample.repeated
    assert lockstep.core.gate.state is GateState.WAITING
    assert lockstep.sent(lockstep.command(0, 1.0).answer).enable


def test_faults_trip_at_once_when_active_and_on_activation_otherwise(real_time: Any) -> None:
    real_time.cycle(1)
    assert real_time.core.fault("second_bridge", "a second bridge is on the bus") is NOTHING
    assert real_time.core.gate.trips == 0
    real_time.core.activate()
    assert real_time.core.gate.trips == 1
    real_time.core.gate.end_fault("second_bridge")
    assert real_time.core.gate.clear()[0]
    real_time.core.ready = True
    real_time.cycle(2)
    real_time.command(2, 1.0)
    step = real_time.core.fault("second_bridge", "a second bridge is on the bus")
    assert not real_time.sent(step.answer).enable
    assert real_time.core.fault("second_bridge", "again") is NOTHING


def test_valve_state_says_what_left_not_what_was_meant(real_time: Any) -> None:
    real_time.start()
    real_time.cycle(1)
    states = [*real_time.cycle(2).valve_states]
    states += real_time.command(2, 1.0).valve_states
    states += real_time.cycle(3).valve_states
    states += real_time.command(3, 1.5).valve_states
    real_time.wire.taking = False
    states += real_time.cycle(4).valve_states
    step = real_time.command(4, 2.0)
    assert step.answer is None
    states += step.valve_states
    real_time.wire.taking = True
    states += real_time.cycle(5).valve_states
    states += real_time.command(5, 2.5).valve_states
    zero = real_time.core.clock.zero_stamp_ns or 0
    said = {(s.stamp_ns - zero) // PERIOD: s.voltages[0] for s in states}
    assert said == {2: 0.0, 3: 1.5, 4: 1.5, 5: 2.5}


def test_in_lockstep_an_answer_that_did_not_leave_is_sent_with_the_repeat(lockstep: Any) -> None:
    lockstep.start()
    lockstep.cycle(0)
    lockstep.wire.taking = False
    assert lockstep.command(0, 1.0).valve_states == ()
    lockstep.wire.taking = True
    step = lockstep.cycle(0)
    assert lockstep.sent(step.answer).voltages == (1.0, 0.0)
    assert [s.voltages for s in step.valve_states] == [(1.0, 0.0)]
    assert lockstep.cycle(0).valve_states == ()


def test_a_repeat_after_a_trip_gets_zero_whatever_was_refused(lockstep: Any) -> None:
    lockstep.start()
    lockstep.cycle(0)
    lockstep.command(0, 1.0)
    lockstep.wire.taking = False
    lockstep.core.condition("bus_off", "bus-off")
    lockstep.wire.taking = True
    command = lockstep.sent(lockstep.cycle(0).answer)
    assert (command.voltages, command.enable) == ((0.0, 0.0), False)


@pytest.mark.parametrize("name", ["real_time", "lockstep"])
def test_a_device_on_the_other_clock_is_a_fault(name: str, request: pytest.FixtureRequest) -> None:
    bench = request.getfixturevalue(name)
    other = not bench.core.lockstep
    bench.cycle(1, lockstep=other)
    bench.start()
    assert "the device's clock is " in bench.core.gate.reason
    assert bench.core.gate.reason.count("lockstep") == 1
    bench.cycle(2, lockstep=other)
    assert not bench.core.gate.clear()[0]
    bench.cycle(3)
    assert bench.core.gate.clear()[0]
    bench.cycle(4)
    assert bench.sent(bench.command(4, 1.0).answer).enable
    assert not bench.sent(bench.cycle(5, lockstep=other).answer).enable
    assert [s.voltages for s in bench.cycle(6).valve_states] == [(0.0, 0.0)]


def test_a_device_that_does_not_tell_its_clock_is_believed(real_time: Any) -> None:
    real_time.codec = copy.copy(real_time.codec)
    real_time.core.codec = real_time.codec
    real_time.codec.tells_clock = False
    real_time.start()
    real_time.cycle(1, lockstep=True)
    assert real_time.core.gate.state is GateState.WAITING


def test_conditions_trip_once_and_hold_until_they_end(real_time: Any) -> None:
    real_time.start()
    real_time.cycle(1)
    real_time.command(1, 1.0)
    assert real_time.core.condition("bus_off", "") is NOTHING
    assert not real_time.sent(real_time.core.condition("bus_off", "bus-off").answer).enable
    assert real_time.core.condition("bus_off", "bus-off") is NOTHING
    assert real_time.core.gate.clear() == (False, "still there: bus-off")
    real_time.core.condition("bus_off", "")
    assert real_time.core.gate.clear()[0]
