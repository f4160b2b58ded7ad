"""A sound publisher that uses the whole range: sines within the legal slew rate."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hydro_hw_bridge.faults.command_faults import Command
from hydro_hw_bridge.protocol.bridge_step import Sample

SHARES = (0.9, 0.6)


class Wave:
    """Large, quick, legal voltages: what the faults find at the valves is far from 0.

    Parameters
    ----------
    names : sequence of str
    rated_v : sequence of float
    step_v : float
        Largest legal change from one cycle to the next.
    frequency_hz, period_s : float
    """

    def __init__(
        self,
        names: Sequence[str],
        rated_v: Sequence[float],
        step_v: float,
        *,
        frequency_hz: float,
        period_s: float,
    ) -> None:
        self._names = tuple(names)
        self._size = tuple(SHARES[i % len(SHARES)] * rated for i, rated in enumerate(rated_v))
        self._step_v = step_v
        self._turn = 2.0 * math.pi * frequency_hz * period_s
        self._before = (0.0,) * len(self._names)

    def restart(self) -> None:
        """Begin at 0 V again."""
        self._before = (0.0,) * len(self._names)

    def answer(self, sample: Sample) -> Command:
        """The command of a sample, from its counter alone but for the slew limit."""
        wanted = (
            size * math.cos(self._turn * sample.counter + i) for i, size in enumerate(self._size)
        )
        self._before = tuple(
            before + min(max(value - before, -self._step_v), self._step_v)
            for value, before in zip(wanted, self._before, strict=True)
        )
        return Command(sample.stamp_ns, self._names, self._before)
