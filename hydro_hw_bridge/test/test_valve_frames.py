"""Frames on their way to the valves: what is told as on the wire, and whose they are."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from hydro_hw_bridge.bus.own_frames import KEPT, OwnFrames
from hydro_hw_bridge.core.valve_frames import ValveFrames
from hydro_hw_bridge.gate.gate import Gate
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.held_voltages import PATIENCE, WATCHDOG_S
from hydro_hw_bridge.gate.permissives import Inputs
from hydro_hw_bridge.protocol.bridge_step import NOTHING, Sample
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Echo

LIMITS = GateLimits(("lift_valve", "tilt_valve"), (10.0, 10.0), 0.002, 1000.0, 5, 2.0e6)
NOW = 1_700_000_000_500_000_000
PERIOD = 2_000_000


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
    frames = [number.to_bytes(8, "little") for number in range(4097)]
    for data in frames[:-1]:
        own.add(data)
    assert frames[0] in own
    own.add(frames[-1])
    assert frames[0] not in own
    assert all(data in own for data in frames[1:])
    assert KEPT * PERIOD >= 8e9


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


class Refused:
    """A bench that drove at 2 V when its bus began to refuse frames."""

    def __init__(self, bench: Any) -> None:
        self.bench, self.counter = bench, 1
        bench.drive(2.0)
        bench.wire.taking = False

    def applied(self, cycles: int, **status: bool) -> list[float]:
        """What /valve_state says of the lift in the cycles that come next."""
        said = []
        for _ in range(cycles):
            self.counter += 1
            step = self.bench.cycle(self.counter, **status)
            steps = (*self.bench.early, step)
            said += [state.voltages[0] for one in steps for state in one.valve_states]
        return said


@pytest.mark.parametrize("off", ["amplifier_watchdog", "amplifier_enabled"])
@pytest.mark.parametrize("active", [True, False])
def test_amplifiers_that_say_they_are_off_have_0_v_whatever_left_last(
    real_time: Any, off: str, active: bool
) -> None:
    """Analysis would take a voltage at rest for one that moves nothing, and a trip for none."""
    refused = Refused(real_time)
    if not active:
        real_time.core.deactivate()
    assert set(refused.applied(100)) == {2.0}  # they hold it for as long as they say
    said = refused.applied(10, **{off: off == "amplifier_watchdog"})
    # In the first of these cycles, that of the one before may be what is said.
    assert said in ([0.0] * 10, [2.0] + [0.0] * 9)
    # On again without a frame: nothing is at the valves all the same.
    assert set(refused.applied(10)) == {0.0}
    real_time.core.gate.clear()
    real_time.core.activate(ready=True)
    real_time.wire.taking = True
    for _ in range(2):
        refused.applied(1)
        step = real_time.command(refused.counter, 1.0)
    (state,) = step.valve_states
    assert state.voltages[0] == real_time.sent(step.answer).voltages[0] > 0.0


def test_amplifiers_that_say_nothing_have_0_v_after_their_watchdogs_time(
    codec: Codec, readings: Any, real_time: Any, tmp_path: Any
) -> None:
    content = yaml.safe_load(codec.mapping.source.read_text(encoding="utf-8"))
    for bit in ("amplifier_enabled", "amplifier_watchdog"):
        del content["sync"]["status"][bit]
    path = tmp_path / "silent.mapping.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    silent = Codec.load(codec.mapping.dbc, path, codec.robot)
    refused = Refused(type(real_time)(silent, readings, lockstep=False))
    # Cycle 1 was answered: 25 of 2 ms later it is 50 ms ago.
    assert refused.applied(40) == [2.0] * 24 + [0.0] * 15
    assert pytest.approx(WATCHDOG_S) == 0.05


def test_an_encoder_under_a_voltage_that_never_came_is_not_called_stuck(real_time: Any) -> None:
    refused = Refused(real_time)
    refused.applied(30)
    refused.applied(600, amplifier_enabled=False)
    assert real_time.core.watch.counters.stuck == 0


def test_a_wire_without_a_count_for_0_v_has_0_v_at_the_valves_while_it_is_off(
    coarse: Codec, readings: Any, wire: Any
) -> None:
    """The controller tells by it that its commands are withheld."""
    gate = Gate(LIMITS)
    frames = ValveFrames(coarse, gate, wire.send)
    gate.advance(1)
    gate.check(Inputs(True, True, True, False, 19.0e6))
    gate.arm()

    def told(counter: int) -> tuple[float, ...]:
        (state,) = frames.step(
            counter, Sample(NOW, counter, readings(counter), False), counter
        ).valve_states
        assert frames.on_wire_v == state.voltages
        return state.voltages

    assert told(1) == (0.0, 0.0)
    gate.command(1, LIMITS.valve_names, (0.0, 0.0))
    assert told(2) == (pytest.approx(0.02), 0.0)
    gate.trip("test")
    assert told(3) == (0.0, 0.0)


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


def test_before_the_first_answer_there_is_none_to_repeat(
    codec: Codec, readings: Any, wire: Any
) -> None:
    frames = ValveFrames(codec, Gate(LIMITS), wire.send)
    sample = Sample(NOW, 0, readings(0), False)
    for _ in range(2):
        assert (frames.answered, frames.on_wire_v) == (-1, (0.0, 0.0))
        assert [state.voltages for state in frames.state_of(sample)] == [(0.0, 0.0)]
        frames.forget()
    assert frames.repeat() is None
    assert wire.sent == []
    answer = frames.answer(0)
    assert answer is not None
    assert frames.repeat() is answer
    assert frames.answered == 0
    frames.forget()
    assert frames.answered == -1


@pytest.mark.parametrize("hears", [True, False])
def test_what_left_and_was_not_heard_is_lost(real_time: Any, hears: bool) -> None:
    real_time.start()
    for counter in range(1, 40):
        heard = len(real_time.wire.sent) if hears else 0
        real_time.cycle(counter, echo=Echo(heard, 0))
    counted = real_time.core.echo.counters
    sent = len(real_time.wire.sent)
    assert sent >= 39
    assert (counted.refused, counted.surplus) == (0, 0)
    assert 0 <= sent - counted.lost <= 2 * PATIENCE if not hears else counted.lost == 0


def test_a_device_that_counts_anew_is_not_held_to_what_left_before(
    codec: Codec, real_time: Any
) -> None:
    gate = Gate(LIMITS)
    frames = ValveFrames(codec, gate, real_time.wire.send)
    frames.echo.heard(Echo(0, 0), 1)
    frames.answer(1)
    frames.forget()
    for counter in range(2, 3 * PATIENCE):
        frames.echo.heard(Echo(0, 0), counter)
    assert frames.echo.counters.lost == 0


def test_amplifiers_that_count_nothing_are_driven_by_one_step_and_not_for_long(
    real_time: Any,
) -> None:
    """Whoever maps an echo that stands still is told so."""
    real_time.start()
    real_time.cycle(1, echo=Echo(0, 0))
    sent = []
    for counter in range(2, 40):
        real_time.cycle(counter, echo=Echo(0, 0))
        step = real_time.command(counter, 2.0 * min(counter - 1, 4))
        if step.answer is not None:
            sent.append(real_time.sent(step.answer).voltages[0])
    assert sent[:3] == [2.0, 4.0, 4.0]
    assert set(sent[1:]) == {4.0}
    # From the 0 V that nobody heard in cycle 1 on.
    assert len(sent) == 30
    assert real_time.core.gate.reason == "the amplifiers took no valve frame for 60 ms"


def test_what_a_device_that_counts_anew_held_before_holds_nothing_back(
    codec: Codec, real_time: Any
) -> None:
    gate = Gate(LIMITS)
    frames = ValveFrames(codec, gate, real_time.wire.send)
    frames.answer(1)
    assert gate.held.towards((9.0, 9.0), (0.0, 0.0), 1.0) == (1.0, 1.0)
    frames.forget()
    assert gate.held.towards((9.0, 9.0), (0.0, 0.0), 1.0) == (9.0, 9.0)
