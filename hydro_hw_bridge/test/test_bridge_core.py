"""The bridge's state machine without bus and ROS: real time, lockstep, restarts, its ends."""

from __future__ import annotations

from typing import Any

import pytest

from hydro_hw_bridge.core.bridge_core import CLOSING_CYCLES, BridgeCore
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.node.bridge_report import summary
from hydro_hw_bridge.protocol.bridge_step import NOTHING
from hydro_hw_bridge.protocol.codec import Codec

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


def test_a_new_core_takes_over_a_trip(lockstep: Any, real_time: Any) -> None:
    real_time.drive()
    assert real_time.command(2, 99.0).answer is not None
    new = lockstep.core
    new.carry_over(real_time.core)
    assert (new.gate.state, new.gate.reason) == (GateState.TRIPPED, real_time.core.gate.reason)


@pytest.mark.parametrize("name", ["real_time", "lockstep"])
def test_a_new_core_gives_no_stamp_again(
    name: str, codec: Codec, readings: Any, request: pytest.FixtureRequest
) -> None:
    """Its first cycle is told to come before the last of the core before it."""
    bench = request.getfixturevalue(name)
    last = [bench.cycle(counter).sample.stamp_ns for counter in (1, 500)][-1]
    core = BridgeCore(codec, bench.core.gate.limits, lockstep=bench.core.lockstep)
    core.carry_over(bench.core)
    bench.core = core
    assert bench.cycle(501).sample.stamp_ns > last


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


def _told(bench: Any, steps: list[Any]) -> list[int]:
    """Answered counters of what left; all of it 0 V."""
    sent = [bench.sent(step.answer) for step in steps if step.answer is not None]
    assert all(one.voltages == (0.0, 0.0) and not one.enable for one in sent)
    return [one.answered for one in sent]


@pytest.mark.parametrize("driven", [True, False])
def test_cycles_that_lack_a_frame_are_told_zero_as_they_begin(
    real_time: Any, driven: bool
) -> None:
    """Tripped or waiting; and no cycle twice once they are whole again."""
    real_time.core.activate(ready=True)
    real_time.cycle(1)
    if driven:
        real_time.command(1, 5.0)
    told = [_told(real_time, real_time.without(counter, 1)) for counter in range(2, 12)]
    first = 5 if driven else 1  # the first one that lacks a frame is not known to as it begins
    assert told == [[]] * first + [[counter] for counter in range(2 + first, 12)]
    assert real_time.core.gate.state is (GateState.TRIPPED if driven else GateState.WAITING)
    assert [len(real_time.early) for c in range(12, 15) if real_time.cycle(c).answer] == [1, 0, 0]


def test_cycles_that_lack_a_frame_are_not_told_zero_while_driving_or_inactive(
    real_time: Any,
) -> None:
    for counter in range(1, 5):
        assert _told(real_time, real_time.without(counter, 1)) == []
    real_time.core.activate(ready=True)
    real_time.cycle(5)
    real_time.command(5, 5.0)
    for counter in range(6, 10):
        assert _told(real_time, real_time.without(counter, 1)) == []
    assert real_time.core.stop_now() is NOTHING
    assert real_time.core.gate.state is GateState.DRIVING


def test_before_the_first_cycle_there_is_nothing_to_answer(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    assert real_time.core.stop_now() is NOTHING
    assert real_time.core.deactivate() is None
    with pytest.raises(TypeError):
        real_time.core.silence(0.0, True)


def test_closing_goes_on_where_cycles_lack_a_frame(real_time: Any) -> None:
    real_time.drive(5.0)
    real_time.without(2, 1)
    assert real_time.sent(real_time.core.deactivate()).answers(2)
    told = [t for counter in range(3, 12) for t in _told(real_time, real_time.without(counter, 1))]
    assert told == list(range(3, 3 + CLOSING_CYCLES))


def test_a_stop_answers_the_cycle_that_has_begun(real_time: Any, lockstep: Any) -> None:
    """Amplifiers may take none for an older one; in lockstep they wait for one that is whole."""
    for bench, answered in ((real_time, 3), (lockstep, 1)):
        bench.drive(5.0)
        bench.without(3, 1, lockstep=bench.core.lockstep)
        bench.core.gate.trip("test")
        step = bench.core.stop_now()
        assert _told(bench, [step]) == [answered]


def test_in_lockstep_a_cycle_that_lacks_a_frame_is_not_answered(lockstep: Any) -> None:
    lockstep.drive(5.0)
    lockstep.core.gate.trip("test")
    for counter in range(2, 5):
        assert _told(lockstep, lockstep.without(counter, 1)) == []


def test_a_restart_is_told_zero_from_its_second_cycle_on_whether_whole_or_not(
    real_time: Any,
) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(5000)
    told = [_told(real_time, real_time.without(counter, 1)) for counter in range(5)]
    assert told == [[], [], [2], [3], [4]]


def test_where_a_sender_never_hears_itself_its_own_frame_is_anothers(
    codec: Codec, real_time: Any
) -> None:
    core = BridgeCore(codec, real_time.core.gate.limits, lockstep=False, send=real_time.wire.send)
    real_time.core = core
    real_time.drive()
    own = codec.receive(real_time.wire.sent[-1])
    assert own is not None
    assert not real_time.sent(core.hear_command(own).answer).enable
    assert core.commands.foreign == 1
    assert core.gate.reason == "valve frames of another sender are on the bus"


@pytest.mark.parametrize("period_s", [0.001, 0.002, 1.0])
def test_stamps_are_a_period_of_the_device_apart(codec: Codec, period_s: float) -> None:
    limits = GateLimits(codec.valve_names, (10.0, 10.0), period_s, 1000.0, 5, 2.0e6)
    core = BridgeCore(codec, limits, lockstep=False)
    assert core.clock.period_ns == period_s * 1e9
