"""The bridge's watchdogs at and around their limits: pure, without bus and wall clock.

With `test_bridge_core`, `test_supervision`, `test_command_intake` and `test_valve_frames` the line
and branch coverage of the modules of these names and of link.py is complete.
"""

from __future__ import annotations

import math
from typing import Any

import can
import pytest

from hydro_hw_bridge.bus.link import BUS_OFF, UNSENT, CommandLink
from hydro_hw_bridge.core.bridge_core import BridgeCore
from hydro_hw_bridge.core.supervision import IMPOSSIBLE, READ_LATE
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.bridge_step import NOTHING
from hydro_hw_bridge.protocol.codec import Codec

NAMES = ("lift_valve", "tilt_valve")
LIMITS = GateLimits(NAMES, (10.0, 10.0), 0.002, 1000.0, 5, 2.0e6)
NOW = 1_700_000_000_500_000_000
PERIOD = 2_000_000


# -- the link


@pytest.mark.parametrize("most", [0, 3])
def test_frames_that_are_refused_in_a_row_are_a_fault_above_the_limit(
    most: int, wire: Any
) -> None:
    link = CommandLink(wire, most)
    frame = can.Message()
    for _ in range(2):
        assert link.send(frame)
        assert dict(link.conditions()) == {BUS_OFF: "", UNSENT: ""}
        wire.taking = False
        for refused in range(1, most + 3):
            assert not link.send(frame)
            said = dict(link.conditions())[UNSENT]
            assert said == ("valve frames cannot be sent" if refused > most else "")
        wire.taking = True
    assert wire.sent == [frame, frame]


@pytest.mark.parametrize("most", [0, 3])
def test_the_first_frames_may_be_the_refused_ones(most: int, wire: Any) -> None:
    wire.taking = False
    link = CommandLink(wire, most)
    said = []
    for _ in range(most + 1):
        said.append(dict(link.conditions())[UNSENT])
        link.send(can.Message())
    assert said == [""] * (most + 1)
    assert dict(link.conditions())[UNSENT]


@pytest.mark.parametrize("most", [0, 3])
def test_other_frames_that_the_bus_takes_in_a_row_end_the_fault_as_well(
    most: int, wire: Any
) -> None:
    """An inactive bridge sends no valve frames, and claims its bus on."""
    wire.send(can.Message())  # claims of before say nothing
    link = CommandLink(wire, most)
    wire.taking = False
    for _ in range(most + 1):
        link.send(can.Message())
    wire.taking = True
    for _ in range(most + 1):
        assert dict(link.conditions())[UNSENT]
        wire.send(can.Message())
    assert dict(link.conditions())[UNSENT] == ""
    wire.taking = False
    for refused in range(1, most + 2):  # counted anew, from the next that is refused
        assert bool(dict(link.conditions())[UNSENT]) is (refused > most + 1)
        link.send(can.Message())
    assert dict(link.conditions())[UNSENT]


def test_claims_between_refused_valve_frames_do_not_end_the_fault(wire: Any) -> None:
    link = CommandLink(wire, 3)
    for _ in range(20):
        wire.taking = False
        link.send(can.Message())
        wire.taking = True
        for _ in range(3):
            wire.send(can.Message())
        said = dict(link.conditions())[UNSENT]
    assert said


def test_a_frame_is_news_until_somebody_has_looked_sent_or_refused(wire: Any) -> None:
    link = CommandLink(wire, 3)
    assert not link.tried
    for taking in (True, False):
        wire.taking = taking
        link.send(can.Message())
        assert link.tried
        link.conditions()
        assert not link.tried


def test_bus_off_is_said_as_long_as_it_is(wire: Any) -> None:
    link = CommandLink(wire, 3)
    for off in (True, False):
        wire.off = off
        said = dict(link.conditions())
        assert said[BUS_OFF] == ("bus-off: the CAN controller left the bus" if off else "")
        assert said[UNSENT] == ""


# -- the sample counter


def test_a_counter_that_stands_still_ends_driving_above_the_limit_only(
    real_time: Any,
) -> None:
    real_time.drive()
    for _ in range(LIMITS.max_age_cycles):
        step = real_time.cycle(1)
        assert (step.sample, step.answer) == (None, None)  # the amplifiers' watchdog runs
        assert real_time.core.gate.state is GateState.DRIVING
    step = real_time.cycle(1)
    assert real_time.core.gate.reason == "the device's sample counter stood still for 6 cycles"
    command = real_time.sent(step.answer)
    assert (command.voltages, command.enable) == ((0.0, 0.0), False)
    assert command.answers(1)


def test_a_counter_that_goes_on_is_counted_anew(real_time: Any) -> None:
    real_time.drive()
    for counter in range(1, 6):
        for _ in range(LIMITS.max_age_cycles):
            real_time.cycle(counter)
        assert real_time.core.gate.state is GateState.DRIVING
        real_time.cycle(counter + 1)
        real_time.command(counter + 1, 1.0)


def test_a_counter_that_stands_still_is_no_trip_where_nothing_is_driven(
    real_time: Any,
) -> None:
    real_time.core.activate(ready=True)
    for _ in range(3 * LIMITS.max_age_cycles):
        real_time.cycle(1)
    assert real_time.core.gate.state is GateState.WAITING


def test_in_lockstep_a_counter_may_stand_still(lockstep: Any) -> None:
    lockstep.drive()
    for _ in range(3 * LIMITS.max_age_cycles):
        assert lockstep.sent(lockstep.cycle(1).answer).enable
    assert lockstep.core.gate.state is GateState.DRIVING


# -- silence


def test_silence_ends_driving_at_its_limit_in_real_time(real_time: Any) -> None:
    real_time.drive()
    assert real_time.core.silence(LIMITS.max_age_s) is NOTHING
    step = real_time.core.silence(math.nextafter(LIMITS.max_age_s, 1.0))
    assert real_time.core.gate.reason == "nothing from the device for 10 ms"
    assert real_time.sent(step.answer).voltages == (0.0, 0.0)
    assert real_time.core.silence(10.0 * LIMITS.max_age_s) is NOTHING
    assert real_time.core.gate.trips == 1


def test_silence_is_no_trip_where_nothing_is_driven(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(1)
    assert real_time.core.silence(10.0 * LIMITS.max_age_s) is NOTHING
    assert real_time.core.gate.state is GateState.WAITING


def test_a_reader_that_lags_ends_driving_at_its_limit(real_time: Any) -> None:
    real_time.drive()
    assert real_time.core.waited(LIMITS.max_age_s) is NOTHING
    assert real_time.core.read_late == 0
    step = real_time.core.waited(4.0)
    assert real_time.core.gate.reason == f"{READ_LATE} for 4000 ms to be read (limit 10 ms)"
    assert real_time.sent(step.answer).voltages == (0.0, 0.0)
    assert real_time.core.waited(4.1) is NOTHING
    assert (real_time.core.gate.trips, real_time.core.read_late) == (1, 2)


def test_a_reader_that_lags_begins_nothing(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(1)
    assert real_time.core.waited(math.nextafter(LIMITS.max_age_s, 1.0)) is NOTHING
    assert real_time.command(1, 1.0) is NOTHING
    assert real_time.core.gate.state is GateState.WAITING
    assert real_time.core.commands.outdated == 1
    real_time.cycle(2)
    assert real_time.core.waited(0.0) is NOTHING
    assert real_time.sent(real_time.command(2, 1.0).answer).enable


def test_in_lockstep_the_machine_waits_with_its_frames(lockstep: Any) -> None:
    lockstep.drive()
    assert lockstep.core.waited(1000.0) is NOTHING
    assert lockstep.core.gate.state is GateState.DRIVING
    assert lockstep.core.read_late == 0


def test_a_device_of_which_no_cycle_was_whole_is_told_0_v_for_what_it_began(
    real_time: Any,
) -> None:
    real_time.drive()
    real_time.core.sample = None
    step = real_time.core.silence(2.0 * LIMITS.max_age_s)
    assert step.valve_states == ()
    assert real_time.sent(step.answer).answers(1)
    assert not real_time.sent(step.answer).enable
    assert real_time.core.gate.state is GateState.TRIPPED


# -- readings


def test_a_position_that_jumps_ends_driving(real_time: Any) -> None:
    real_time.drive()
    step = real_time.cycle(2, positions=(0.9, -0.5))
    assert "position jumped" in real_time.core.gate.reason
    assert not real_time.sent(step.answer).enable
    real_time.cycle(3, positions=(0.9, -0.5))
    assert real_time.core.gate.clear()[0]


def test_a_position_that_jumps_while_waiting_keeps_a_drive_from_beginning(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(1)
    real_time.cycle(2, positions=(0.9, -0.5))
    assert "position jumped" in real_time.core.gate.reason
    assert real_time.core.watch.counters.jumps == 1
    real_time.command(2, 1.0)
    assert real_time.core.gate.state is GateState.TRIPPED


def test_a_position_that_jumps_is_counted_where_the_bridge_is_inactive(real_time: Any) -> None:
    real_time.cycle(1)
    real_time.cycle(2, positions=(0.9, -0.5))
    assert real_time.core.gate.state is GateState.WAITING
    assert real_time.core.watch.counters.jumps == 1


def test_a_pressure_that_cannot_be_is_a_fault_until_it_can(real_time: Any) -> None:
    real_time.drive()
    wrong = (5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 3.2e7)
    step = real_time.cycle(2, pressures_pa=wrong)
    assert "pressure tank cannot be" in real_time.core.gate.reason
    assert not real_time.sent(step.answer).enable
    assert IMPOSSIBLE in real_time.core.gate.faults
    assert not real_time.core.gate.clear()[0]
    real_time.cycle(3)
    assert IMPOSSIBLE not in real_time.core.gate.faults
    assert real_time.core.gate.clear()[0]


def test_a_pressure_that_cannot_be_keeps_from_being_activated(real_time: Any) -> None:
    real_time.cycle(1, pressures_pa=(5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 3.2e7))
    assert real_time.core.gate.trips == 0
    real_time.core.activate(ready=True)
    assert "pressure tank cannot be" in real_time.core.gate.reason


def test_an_encoder_is_held_against_what_is_on_the_wire(real_time: Any) -> None:
    real_time.drive(9.0)
    last = NOTHING
    for counter in range(2, 300):
        last = real_time.cycle(counter)
        if real_time.core.gate.state is not GateState.DRIVING:
            break
        real_time.command(counter, 9.0)
    assert real_time.core.gate.reason.startswith("lift: encoder stuck")
    assert not real_time.sent(last.answer).enable


# -- frames


def test_frames_before_the_first_sync_are_nothing(real_time: Any) -> None:
    messages = real_time.codec.encode_cycle(real_time.readings(1))
    for message in messages[1:]:
        frame = real_time.codec.receive(message)
        assert frame is not None
        assert real_time.core.receive(frame, NOW) is NOTHING
    assert real_time.core.clock.zero_stamp_ns is None
    assert real_time.core.send_zero() is None


def test_without_a_bus_every_frame_is_taken(codec: Codec, real_time: Any) -> None:
    machine = real_time
    machine.core = BridgeCore(codec, LIMITS, lockstep=False)
    assert (machine.core.spoke, machine.core.active, machine.core.ready) == (False,) * 3
    machine.core.activate()
    assert not machine.core.ready
    assert machine.cycle(1).answer is not None
    assert machine.core.spoke


def test_a_fault_that_stands_trips_but_once(real_time: Any) -> None:
    real_time.drive()
    assert real_time.core.condition("x", "why").answer is not None
    assert real_time.core.stop_now().answer is not None
    assert real_time.core.condition("x", "why") is NOTHING
    assert real_time.core.fault("y", "another") is NOTHING
    assert (real_time.core.gate.trips, real_time.core.gate.reason) == (1, "why")
    real_time.core.deactivate()
    assert real_time.core.stop_now() is NOTHING


def test_a_machine_that_restarts_is_told_zero_until_driven_anew(real_time: Any) -> None:
    real_time.cycle(40_000)
    real_time.core.activate(ready=True)
    real_time.command(40_000, 5.0)
    assert real_time.core.gate.state is GateState.DRIVING
    real_time.cycle(0)
    step = real_time.cycle(1)
    assert real_time.core.gate.reason == "the device restarted: its sample counter went back"
    assert not real_time.sent(step.answer).enable
    assert [state.voltages for state in step.valve_states] == [(0.0, 0.0)]


def test_closing_ends_after_its_cycles(real_time: Any) -> None:
    real_time.drive()
    assert real_time.core.deactivate() is not None
    answers = [real_time.cycle(counter).answer for counter in range(2, 10)]
    assert [answer is not None for answer in answers] == [True] * 5 + [False] * 3
    assert not real_time.core.ready


def test_a_machine_that_restarts_may_stand_elsewhere(real_time: Any) -> None:
    real_time.cycle(40_000)
    real_time.core.activate(ready=True)
    real_time.cycle(0, positions=(0.9, -1.5))
    real_time.cycle(0, positions=(0.9, -1.5))
    assert real_time.core.watch.counters.jumps == 0
    assert real_time.command(0, 1.0).answer is not None
    assert real_time.core.gate.state is GateState.DRIVING


def test_the_valves_of_a_machine_that_restarts_are_at_zero(real_time: Any) -> None:
    real_time.drive(1.0)
    real_time.wire.taking = False
    for counter in range(30_000, 30_003):
        real_time.cycle(counter)
    steps = [real_time.cycle(counter) for counter in (0, 0, 1)]
    assert [s.voltages for step in steps for s in step.valve_states] == [(0.0, 0.0)]


def test_a_machine_that_restarts_is_told_of_from_its_first_cycle(real_time: Any) -> None:
    real_time.cycle(5000)
    real_time.cycle(0)
    step = real_time.cycle(0)
    assert step.sample is not None
    assert [state.stamp_ns for state in step.valve_states] == [step.sample.stamp_ns]


@pytest.mark.parametrize("first", [0, 1])
def test_in_lockstep_no_cycle_is_answered_before_a_command(lockstep: Any, first: int) -> None:
    lockstep.core.activate(ready=True)
    for counter in (first, first, first + 1):
        assert lockstep.cycle(counter).answer is None


@pytest.mark.parametrize("restart", [(0, 0, 1, 2), (0, 1, 2, 2)])
def test_in_lockstep_answers_of_before_a_restart_answer_nothing(
    lockstep: Any, restart: tuple[int, ...]
) -> None:
    lockstep.core.activate(ready=True)
    lockstep.cycle(2)
    lockstep.command(2, 1.0)
    assert lockstep.command(2, 0.0).answer is not None  # taken back: it waits again
    for counter in restart:
        assert lockstep.cycle(counter).answer is None
    assert lockstep.command(2, 1.0).answer is not None


def test_a_late_command_says_nothing_of_the_newest_cycle(real_time: Any) -> None:
    real_time.drive()
    real_time.cycle(2)
    real_time.cycle(3)
    step = real_time.command(2, 1.5)
    assert step.answer is not None
    assert step.valve_states == ()


def test_what_a_word_means_is_always_said(codec: Codec) -> None:
    with pytest.raises(TypeError):
        BridgeCore(codec, LIMITS, True)  # type: ignore[call-arg, misc]
    core = BridgeCore(codec, LIMITS, lockstep=True)
    with pytest.raises(TypeError):
        core.activate(True)  # type: ignore[call-arg, misc]
