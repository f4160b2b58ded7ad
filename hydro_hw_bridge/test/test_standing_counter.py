"""A device whose sample counter does not go on, and emergency stops in frames from afar."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.bridge_step import NOTHING

LIMITS = GateLimits(("lift_valve", "tilt_valve"), (10.0, 10.0), 0.002, 1000.0, 5, 2.0e6)
NOW = 1_700_000_000_500_000_000


def _syncs(bench: Any, counters: list[int], **changes: Any) -> list[Any]:
    """Steps of sync frames alone."""
    messages = [bench.codec.encode_cycle(bench.readings(c, **changes))[0] for c in counters]
    return [bench.core.receive(bench.codec.receive(message), NOW) for message in messages]


#: No two of which are in a row, nor near the first.
WILD = [(1 + k * 1_600_000) % 2**32 for k in range(1, 12)]


@pytest.mark.parametrize("name", ["real_time", "lockstep"])
def test_an_emergency_stop_in_two_frames_in_a_row_from_afar_latches(
    name: str, request: pytest.FixtureRequest
) -> None:
    bench = request.getfixturevalue(name)
    bench.drive()
    pressed = {"emergency_stop_ok": False}
    _syncs(bench, WILD[:1], **pressed)
    # One that came late or is noise says nothing, nor do two with another between them.
    assert bench.core.gate.state is GateState.DRIVING
    _syncs(bench, WILD[1:2])
    _syncs(bench, WILD[2:3], **pressed)
    bench.cycle(2)
    _syncs(bench, WILD[3:4], **pressed)
    assert bench.core.gate.state is GateState.DRIVING
    (stop,) = _syncs(bench, WILD[4:5], **pressed)
    assert bench.core.gate.reason == "emergency stop"
    assert not bench.sent(stop.answer).enable
    assert bench.core.gate.clear() == (False, "still there: emergency stop")


def test_a_frame_whose_counters_do_not_fit_says_nothing_of_an_emergency_stop(
    real_time: Any,
) -> None:
    real_time.drive()
    message = real_time.codec.encode_cycle(real_time.readings(2, emergency_stop_ok=False))[0]
    frame = replace(real_time.codec.receive(message), alive=3)
    for broken in (frame, frame, replace(frame, alive=2, intact=False)):
        real_time.core.receive(broken, NOW)
        real_time.core.receive(broken, NOW)
    assert real_time.core.gate.state is GateState.DRIVING
    _syncs(real_time, WILD[:1], emergency_stop_ok=False)
    assert real_time.core.gate.state is GateState.DRIVING
    # A sync frame without protection has no alive counter to fit.
    real_time.core.receive(replace(frame, alive=None), NOW)
    assert real_time.core.gate.reason == "emergency stop"


def _stands(bench: Any, kind: str, counter: int, k: int) -> None:
    """What a device sends in a cycle whose counter does not go on."""
    if kind == "wild":
        _syncs(bench, WILD[k : k + 1])
    elif kind == "sync alone":
        _syncs(bench, [counter])
    elif kind == "lacking":
        bench.without(counter, 2)
    else:
        bench.cycle(counter)


STANDING = ("sync alone", "lacking", "whole", "wild")


@pytest.mark.parametrize("kind", STANDING)
def test_a_counter_that_does_not_go_on_ends_driving_whatever_else_comes(
    real_time: Any, kind: str
) -> None:
    real_time.drive()
    before = real_time.core.assembler.counters.begun_again
    for k in range(LIMITS.max_age_cycles):
        _stands(real_time, kind, 1, k)
        assert real_time.core.gate.state is GateState.DRIVING
    sent = len(real_time.wire.sent)
    _stands(real_time, kind, 1, LIMITS.max_age_cycles)
    assert real_time.core.gate.reason == "the device's sample counter stood still for 6 cycles"
    assert not real_time.sent(real_time.wire.sent[sent]).enable
    counters = real_time.core.assembler.counters
    grown = counters.out_of_order if kind == "wild" else counters.begun_again - before
    assert grown == LIMITS.max_age_cycles + 1


@pytest.mark.parametrize("kind", STANDING)
def test_a_counter_that_does_not_go_on_begins_nothing(real_time: Any, kind: str) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(1)
    for k in range(LIMITS.max_age_cycles + 1):
        _stands(real_time, kind, 1, k)
    assert real_time.command(1, 1.0) is NOTHING
    assert real_time.core.commands.outdated == 1
    real_time.cycle(2)
    assert real_time.sent(real_time.command(2, 1.0).answer).enable


@pytest.mark.parametrize("kind", STANDING)
def test_in_lockstep_a_counter_that_does_not_go_on_is_the_devices_right(
    lockstep: Any, kind: str
) -> None:
    lockstep.drive()
    for k in range(2 * LIMITS.max_age_cycles):
        _stands(lockstep, kind, 1, k)
    assert lockstep.core.gate.state is GateState.DRIVING
    lockstep.cycle(2)
    assert lockstep.sent(lockstep.command(2, 1.0).answer).enable


def test_one_late_sync_frame_and_one_that_came_twice_end_nothing(real_time: Any) -> None:
    real_time.drive()
    for counter in range(2, 40):
        real_time.cycle(counter)
        _syncs(real_time, [max(counter - 7, 0), counter, counter])
        real_time.command(counter, 1.0)
    assert real_time.core.gate.state is GateState.DRIVING


def test_silence_says_what_came_instead(real_time: Any) -> None:
    for syncs, others, said in (
        (0, False, "nothing from the device for 10 ms"),
        (0, True, "no sync frame from the device for 10 ms"),
        (1, False, "the device's sample counter did not go on for 10 ms"),
        (1, True, "the device's sample counter did not go on for 10 ms"),
    ):
        counter = 1 if real_time.core.sample is None else real_time.core.sample.counter + 1
        real_time.core.activate(ready=True)
        real_time.cycle(counter)
        real_time.core.gate.clear()
        real_time.command(counter, 1.0)
        _syncs(real_time, [counter] * syncs)
        real_time.core.silence(0.011, others=others)
        assert real_time.core.gate.reason == said


def test_silence_is_over_with_the_next_cycle_and_not_before(real_time: Any) -> None:
    real_time.core.activate(ready=True)
    real_time.cycle(1)
    real_time.core.silence(0.011)
    real_time.core.silence(0.001)
    _syncs(real_time, [1])
    assert real_time.command(1, 1.0) is NOTHING
    assert real_time.core.commands.outdated == 1
    real_time.cycle(2)
    assert real_time.command(2, 1.0).answer is not None
