"""Faults on their way through the bridge: silence, permissives, clocks, other senders."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.core.supervision import FOREIGN, Supervision
from hydro_hw_bridge.gate.gate import Gate, GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.permissives import Inputs
from hydro_hw_bridge.protocol.bridge_step import NOTHING
from hydro_hw_bridge.protocol.codec import Codec
from hydro_model.robot import Robot

LIMITS = GateLimits(("lift_valve", "tilt_valve"), (10.0, 10.0), 0.002, 1000.0, 5, 2.0e6)
NOW = 1_700_000_000_500_000_000


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
    # From then on each that begins is told 0 V: any one frame may be lost.
    assert [answer is None for answer in answers] == [True] * 5 + [False, False]
    for counter, answer in ((7, answers[5]), (8, answers[6])):
        assert not real_time.sent(answer).enable
        assert real_time.sent(answer).answers(counter)


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


@pytest.mark.parametrize("bit", ["emergency_stop_ok", "enable_switch", "pump_on"])
def test_a_permissive_acts_by_its_frame_alone(real_time: Any, bit: str) -> None:
    """Whether or not the rest of the cycle comes."""
    real_time.drive()
    steps = real_time.without(2, 3, **{bit: False})
    answers = [step.answer for step in steps if step.answer is not None]
    assert len(answers) == 1
    assert not real_time.sent(answers[0]).enable
    assert real_time.core.gate.state is GateState.TRIPPED


def test_a_permissive_of_a_frame_of_the_past_says_nothing(real_time: Any) -> None:
    real_time.drive()
    real_time.cycle(2)
    real_time.cycle(3)
    assert all(step is NOTHING for step in real_time.without(2, 3, emergency_stop_ok=False))
    assert real_time.core.gate.state is GateState.DRIVING


def test_without_samples_driving_ends(real_time: Any) -> None:
    real_time.drive()
    for counter in range(2, 9):
        real_time.without(counter, 3)
    said = "no whole cycle for 12 ms, missing PRESSURES_2 (limit 10 ms)"
    assert real_time.core.gate.reason == said


def test_two_different_frames_of_one_cycle_end_driving(real_time: Any) -> None:
    real_time.drive()
    messages = real_time.codec.encode_cycle(real_time.readings(2))
    other = real_time.codec.encode_cycle(real_time.readings(2, positions=(0.31, -0.5)))
    frames = [real_time.codec.receive(m) for m in (*messages[:2], other[1], *messages[2:])]
    steps = [real_time.core.receive(frame, NOW) for frame in frames]
    assert all(step.sample is None for step in steps)
    assert "two different frames ENCODERS of one cycle" in real_time.core.gate.reason
    assert [real_time.sent(s.answer).enable for s in steps if s.answer is not None] == [False]


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


def test_after_silence_no_old_sample_begins_to_drive(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(1)
    assert real_time.core.silence(10.0) is NOTHING
    assert real_time.command(1, 1.0) is NOTHING
    assert real_time.core.commands.outdated == 1
    assert real_time.core.gate.state is GateState.WAITING
    real_time.cycle(2)
    assert real_time.command(2, 1.0).answer is not None


def test_commands_that_waited_out_a_stall_drive_nothing(real_time: Any, lockstep: Any) -> None:
    """Read before what the device said meanwhile, they look fresh by its counter."""
    for bench, driven in ((real_time, False), (lockstep, True)):
        bench.drive()
        bench.cycle(2)
        assert (bench.command(2, 1.5, unheard_s=0.011).answer is not None) is driven
        assert bench.core.commands.outdated == (not driven)
    # The trip that follows is the reader's, with its reason.
    assert real_time.core.gate.state is GateState.DRIVING
    assert real_time.command(2, 1.5, unheard_s=0.010).answer is not None


def test_an_emergency_stop_while_nothing_is_driven_latches(real_time: Any) -> None:
    real_time.cycle(1, emergency_stop_ok=False)
    assert real_time.core.gate.state is GateState.WAITING  # of no bridge that is to drive
    real_time.start()
    real_time.cycle(2)
    for bit in ("enable_switch", "pump_on"):
        real_time.cycle(3, **{bit: False})
        assert real_time.core.gate.state is GateState.WAITING
    real_time.cycle(4, emergency_stop_ok=False)
    assert real_time.core.gate.reason == "emergency stop"
    assert real_time.core.gate.clear() == (False, "still there: emergency stop")
    real_time.cycle(5)
    assert real_time.command(5, 1.0) is NOTHING
    assert real_time.core.gate.clear()[0]
    assert real_time.command(5, 1.0).answer is not None


def test_an_emergency_stop_latches_by_its_frame_alone_while_nothing_is_driven(
    real_time: Any,
) -> None:
    real_time.start()
    real_time.cycle(1)
    real_time.without(2, 3, emergency_stop_ok=False)
    assert real_time.core.gate.reason == "emergency stop"


def test_an_emergency_stop_latches_before_any_cycle_was_whole(real_time: Any) -> None:
    real_time.without(1, 1, emergency_stop_ok=False)
    assert real_time.core.gate.trips == 0  # of no bridge that is to drive
    real_time.start()
    for counter in (2, 3):
        real_time.without(counter, 1)
    assert real_time.core.gate.trips == 0
    (stop,) = [s for s in real_time.without(4, 1, emergency_stop_ok=False) if s.answer]
    assert not real_time.sent(stop.answer).enable
    assert real_time.core.gate.reason == "emergency stop"
    refused = (False, "still there: no complete cycle from the device yet")
    assert real_time.core.gate.clear() == refused


def test_an_emergency_stop_latches_before_a_device_that_restarts_has_a_whole_cycle(
    real_time: Any,
) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(5000)
    real_time.without(0, 1)
    real_time.without(1, 1)
    assert real_time.core.assembler.counters.restarts == 1
    real_time.without(2, 1, emergency_stop_ok=False)
    assert real_time.core.gate.reason == "emergency stop"


def test_a_permissive_that_goes_stops_with_its_own_cycle(real_time: Any) -> None:
    real_time.start()
    real_time.cycle(1)
    real_time.command(1, 1.0)
    assert not real_time.sent(real_time.cycle(2, emergency_stop_ok=False).answer).enable
    assert real_time.core.gate.reason == "emergency stop"


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


def test_what_a_word_means_is_always_said_to_supervision(codec: Codec, readings: Any) -> None:
    gate, usual = Gate(LIMITS), readings(1)
    with pytest.raises(TypeError):
        Supervision(codec, gate, False)  # type: ignore[call-arg, misc]
    supervision = Supervision(codec, gate, lockstep=False)
    with pytest.raises(TypeError):
        supervision.silence(0.0, True)  # type: ignore[call-arg, misc]
    for call, arguments in (
        (supervision.cycle, (usual, 1, (0.0, 0.0))),
        (supervision.compare_clocks, (usual.status,)),
        (supervision.fault, ("x", "why")),
        (supervision.condition, ("x", "why")),
    ):
        call(*arguments, active=False)
        with pytest.raises(TypeError):
            call(*arguments, True)
    assert gate.trips == 0


def test_after_a_restart_no_trip_is_cleared_before_a_whole_cycle(real_time: Any) -> None:
    """Not with the permissives of a new sync frame and the supply of before."""
    real_time.cycle(5000)
    real_time.core.activate(ready=True)
    real_time.command(5000, 1.0)
    for counter in (0, 1):
        real_time.without(counter, 3)
    assert "restarted" in real_time.core.gate.reason
    assert real_time.core.gate.clear() == (
        False,
        "still there: no complete cycle from the device yet",
    )
    real_time.cycle(2)
    assert real_time.core.gate.clear()[0]


def _driving(limits: GateLimits) -> Gate:
    gate = Gate(limits)
    gate.advance(1)
    gate.check(Inputs(True, True, True, False, 19.0e6))
    gate.command(1, limits.valve_names, (0.0, 0.0))
    assert gate.state is GateState.DRIVING
    return gate


def test_reasons_give_the_limit(codec: Codec) -> None:
    limits = replace(LIMITS, max_age_cycles=1000)
    silent, late = _driving(limits), _driving(limits)
    Supervision(codec, silent, lockstep=False).silence(3.0)
    Supervision(codec, late, lockstep=False).waited(3.0)
    assert silent.reason == "nothing from the device for 2000 ms"
    assert late.reason == "the device's frames waited for 3000 ms to be read (limit 2000 ms)"


def test_a_counter_may_stand_from_the_first_cycle_on_for_as_long_as_later(
    codec: Codec, readings: Any
) -> None:
    gate = _driving(LIMITS)
    supervision = Supervision(codec, gate, lockstep=False)
    sync = codec.receive(codec.encode_cycle(readings(1))[0])
    assert sync is not None
    for _ in range(LIMITS.max_age_cycles):
        supervision.sync(sync, 1, advanced=False, active=True)
        assert gate.state is GateState.DRIVING
    supervision.sync(sync, 1, advanced=False, active=True)
    assert gate.reason == "the device's sample counter stood still for 6 cycles"


@pytest.mark.parametrize("tells", [True, False])
def test_amplifiers_are_waited_for_where_the_machine_tells_of_them(
    codec: Codec, readings: Any, tells: bool
) -> None:
    """A bit that the mapping leaves out is not one that says no."""
    told = copy.copy(codec)
    told.tells_amplifiers = tells
    gate = _driving(LIMITS)
    supervision = Supervision(told, gate, lockstep=False)
    for counter in range(2, 60):
        gate.advance(counter)
        supervision.cycle(
            readings(counter, amplifier_enabled=False), counter, (0.0, 0.0), active=True
        )
        gate.command(counter, LIMITS.valve_names, (1.0, 0.0))
    assert gate.reason == ("the amplifiers did not come on within 100 ms" if tells else "")
    assert gate.output.voltages == ((0.0, 0.0) if tells else (1.0, 0.0))


def test_a_mapping_says_whether_the_machine_tells_of_its_amplifiers(
    codec: Codec, robot: Robot
) -> None:
    assert codec.tells_amplifiers
    status = {k: v for k, v in codec.mapping.status.items() if k != "amplifier_enabled"}
    silent = Codec(robot, replace(codec.mapping, status=status), codec.layout)
    assert not silent.tells_amplifiers
