"""What `/valve_state` tells, against what amplifiers have at their outputs, cycle by cycle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.rig.amplifier import Amplifier

RATED_V = np.array([10.0, 10.0])
PERIOD_S = 0.002


class Driven:
    """A bridge with amplifiers behind it, driven by a controller that never tires."""

    def __init__(self, bench: Any) -> None:
        self.bench = bench
        self.amplifier = Amplifier(RATED_V, PERIOD_S, 0)
        self.outputs: dict[int, tuple[float, ...]] = {}
        self.told: dict[int, tuple[float, ...]] = {}
        bench.core.activate(ready=True)

    def runs(self, cycles: Sequence[int], lift_v: float, **inputs: bool) -> None:
        """Cycles by their counters, each with a command."""
        for counter in cycles:
            status = inputs | {
                "amplifier_enabled": self.amplifier.enabled,
                "amplifier_watchdog": self.amplifier.tripped,
            }
            sent = len(self.bench.wire.sent)
            last = self.bench.cycle(counter, **status)
            steps = [*self.bench.early, last, self.bench.command(counter, lift_v)]
            heard = [self.bench.sent(message) for message in self.bench.wire.sent[sent:]]
            newest = heard[-1] if heard else None
            asked = (None, False) if newest is None else (newest.voltages, newest.enable)
            self.outputs[counter] = tuple(map(float, self.amplifier.step(*asked, permitted=True)))
            zero_ns = self.bench.core.clock.zero_stamp_ns
            for state in (state for step in steps for state in step.valve_states):
                self.told[round((state.stamp_ns - zero_ns) * 1e-9 / PERIOD_S)] = state.voltages

    def apart(self) -> list[int]:
        """Cycles in which it is told otherwise than it is."""
        return [k for k, v in self.told.items() if not np.allclose(v, self.outputs[k], atol=1e-9)]


@pytest.mark.parametrize("refused", [3, 20, 600])
def test_a_bus_that_takes_nothing_for_a_while_is_told_as_the_amplifiers_have_it(
    real_time: Any, refused: int
) -> None:
    driven = Driven(real_time)
    driven.runs(range(1, 50), 1.0)
    assert driven.outputs[49] == (1.0, 0.0)
    assert driven.apart() == []
    real_time.wire.taking = False
    driven.runs(range(50, 50 + refused), 1.0)
    real_time.wire.taking = True
    real_time.core.gate.clear()
    driven.runs(range(50 + refused, 1000), 1.0)
    assert len(driven.told) >= 998
    # When they are off by themselves they say so in the cycle that follows.
    assert driven.apart() == ([74] if refused > 24 else [])
    assert driven.outputs[74] == ((0.0, 0.0) if refused > 24 else driven.told[74])


def test_a_stop_by_the_next_cycles_sync_is_told_of_that_cycle(real_time: Any) -> None:
    """Up to it the valves had what was sent before: the one that is over did not stop."""
    driven = Driven(real_time)
    driven.runs(range(1, 20), 1.0)
    real_time.cycle(20)  # and no command for it
    driven.outputs[20] = tuple(map(float, driven.amplifier.step(None, False, permitted=True)))
    driven.runs(range(21, 22), 1.0, emergency_stop_ok=False)
    driven.runs(range(22, 24), 1.0)
    assert real_time.core.gate.reason == "emergency stop"
    assert driven.told[20] == driven.told[19] == (1.0, 0.0)
    assert driven.told[21] == driven.outputs[21] == (0.0, 0.0)
    assert driven.apart() == []


@pytest.mark.parametrize("stops", [False, True])
def test_a_command_that_comes_once_the_next_cycle_has_begun_is_told_of_that_one(
    real_time: Any, stops: bool
) -> None:
    real_time.drive(1.0)
    real_time.cycle(2)
    sync, *rest = real_time.codec.encode_cycle(real_time.readings(3))
    for message in (sync, *rest[:1]):
        assert real_time.core.receive(real_time.codec.receive(message), 0).valve_states == ()
    # 6 V at once are refused: a stop, by a command.
    step = real_time.command(2, 6.0 if stops else 2.0)
    assert [state.voltages for state in step.valve_states] == [(1.0, 0.0)]
    for message in rest[1:]:
        step = real_time.core.receive(real_time.codec.receive(message), 0)
    (state,) = (*step.valve_states, *real_time.cycle(4).valve_states)[:1]
    zero_ns = real_time.core.clock.zero_stamp_ns
    assert round((state.stamp_ns - zero_ns) * 1e-9 / PERIOD_S) == 3
    assert state.voltages == ((0.0, 0.0) if stops else (2.0, 0.0))
