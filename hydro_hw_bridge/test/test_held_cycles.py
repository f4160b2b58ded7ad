"""The bridge's core while others are heard: a cycle that was held is over before the next."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.protocol.assembler import WARY_CYCLES

NOW = 1_700_000_000_500_000_000


def _noise(bench: Any) -> None:
    """A frame that is spoilt, before the next cycle begins."""
    frame = bench.codec.receive(bench.codec.encode_cycle(bench.readings(0))[-1])
    bench.core.receive(replace(frame, intact=False), NOW)


def _next(bench: Any, counter: int, **changes: Any) -> Any:
    """A cycle of which the last one's sample comes with the sync frame: that step."""
    bench.cycle(counter, **changes)
    (step,) = bench.early
    return step


@pytest.fixture
def wary(real_time: Any) -> Any:
    """A bench that drives 1 V; cycle 2 is held."""
    real_time.drive()
    _noise(real_time)
    assert real_time.cycle(2).sample is None
    return real_time


def test_held_samples_have_their_own_stamps_and_what_the_valves_had(wary: Any) -> None:
    first = _next(wary, 3)
    wary.command(2, 2.0)
    second = _next(wary, 4)
    assert [step.sample.counter for step in (first, second)] == [2, 3]
    assert second.sample.stamp_ns - first.sample.stamp_ns == 2_000_000
    assert wary.core.assembler.counters.held == 2
    assert wary.core.gate.state is GateState.DRIVING


@pytest.mark.parametrize("bit", ["pump_on", "enable_switch"])
def test_a_permissive_of_the_sync_frame_is_not_overruled_by_the_cycle_before(
    wary: Any, bit: str
) -> None:
    """The cycle that was held still had it: nothing begins to drive on that."""
    step = _next(wary, 3, **{bit: False})
    assert step.sample.counter == 2
    assert not wary.sent(step.answer).enable
    assert wary.core.gate.state is GateState.TRIPPED
    assert not wary.core.gate.clear()[0]
    # What the valves had in the cycle that is over stands in its state.
    assert wary.core.sample.counter == 2
    assert step.valve_states[0].voltages == (1.0, 0.0)


def test_amplifiers_that_come_on_meanwhile_have_not_gone_off(real_time: Any) -> None:
    """Newer words are not followed by older ones: off, on, and no off behind it."""
    real_time.drive()
    for counter in range(2, 10):
        real_time.cycle(counter, amplifier_enabled=False)
        real_time.command(counter, 1.0)
    _noise(real_time)
    real_time.cycle(10, amplifier_enabled=False)
    for counter in range(11, 20):
        assert _next(real_time, counter).sample.counter == counter - 1
        real_time.command(counter - 1, 1.0)
    assert real_time.core.gate.reason == ""
    assert real_time.core.gate.state is GateState.DRIVING


def test_in_lockstep_few_cycles_are_held_as_each_is_told_again_a_second_later(
    lockstep: Any,
) -> None:
    lockstep.drive()
    _noise(lockstep)
    held = []
    for counter in range(2, 20):
        sample = lockstep.cycle(counter).sample
        if sample is None:
            held.append(counter)
            lockstep.cycle(counter)
            (step,) = lockstep.early
            sample = step.sample
        assert sample.counter == counter
        lockstep.command(counter, 1.0)
    assert held == [2, 3, 4, 5]
    assert len(held) < WARY_CYCLES
