"""What `/valve_state` tells, against what amplifiers have at their outputs, cycle by cycle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.rig.amplifier import Amplifier

PERIOD_S = 0.002


class Driven:
    """A bridge with amplifiers behind it, driven by a controller that never tires."""

    def __init__(self, bench: Any) -> None:
        self.bench = bench
        self.amplifier = Amplifier(2, PERIOD_S, 0)
        self.outputs: dict[int, tuple[float, ...]] = {}
        self.told: dict[int, tuple[float, ...]] = {}
        bench.core.activate(ready=True)

    def runs(self, cycles: Sequence[int], lift_v: float) -> None:
        """Cycles by their counters, each with a command."""
        for counter in cycles:
            status = {
                "amplifier_enabled": self.amplifier.enabled,
                "amplifier_watchdog": self.amplifier.tripped,
            }
            sent = len(self.bench.wire.sent)
            steps = [self.bench.cycle(counter, **status), self.bench.command(counter, lift_v)]
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
