"""Flows into a chamber by laws that look at the valve: held as the command is, and as late.

The edges' own flow is integrated over both parts of each sampling interval, before and after the
delayed signal changes (`edge_integrals`). What an underlap, a compensator, a cushion or a hose
adds is a part of that flow, so that it has to come at the same instants. As in a roll-out,
restrictions in series multiply (`hydro_model.effects.effect.Effect.needs_valve`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hydro_ident.estimate.flows.chambers import held_parts
from hydro_model.arrays import BoolArray
from hydro_model.effects.compiled import signals_read
from hydro_model.effects.law import FLOW
from hydro_model.effects.rows import set_valve_signal
from hydro_model.effects.signals import VALVE_FLOW_A, VALVE_FLOW_B, VALVE_SIGNAL
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot

_PASSED = {"a": VALVE_FLOW_A, "b": VALVE_FLOW_B}
_OF_VALVE = frozenset({VALVE_SIGNAL, VALVE_FLOW_A, VALVE_FLOW_B})


def looks_at_valve(one: ActiveEffect) -> bool:
    """Whether a flow into a chamber follows from the valve's signal by an effect's laws."""
    laws = [term.law for term in one.effect.terms if term.stage in FLOW.values()]
    if laws and one.effect.known_states is None:
        laws += [law for state in one.effect.states for law in (state.rate, state.initial)]
    return any(signals_read(law) & _OF_VALVE for law in laws)


@dataclass(frozen=True, eq=False)
class HeldRows:
    """A cylinder's signals in the parts of every sampling interval in which its valve is held.

    Attributes
    ----------
    parts : tuple of (N - 1, SIGNAL_COUNT) array
        In the middle of each part, with the flows of the edges.
    shares : tuple of float
        Of the interval.
    known : (N - 1,) bool array
        Intervals of which the valve's signal is known.
    """

    parts: tuple[FloatArray, ...]
    shares: tuple[float, ...]
    known: BoolArray

    @staticmethod
    def of(
        robot: Robot, cylinder: int, rows: FloatArray, delay_s: float, step_s: float
    ) -> HeldRows:
        """Those of signals at the samples.

        Parameters
        ----------
        robot : Robot
            With current edges.
        cylinder : int
        rows : (N, SIGNAL_COUNT) array
            The valve's signal without delay.
        delay_s : float
            From the stamp of a command to its effect.
        step_s : float
            Sampling interval.
        """
        from hydro_ident.mismatch.rows.row_kernels import between

        late, soon, share = held_parts(rows[:, VALVE_SIGNAL], delay_s, step_s)
        halves = ((late, share, 0.5 * share), (soon, 1.0 - share, 0.5 * (1.0 + share)))
        kept = [half for half in halves if half[1] > 0.0]
        parts = []
        for signal, _, at in kept:
            own = between(rows, at)
            set_valve_signal(own, robot, cylinder, signal)
            parts.append(own)
        known = np.all([np.isfinite(signal) for signal, _, _ in kept], axis=0)
        return HeldRows(tuple(parts), tuple(share for _, share, _ in kept), known)

    @cached_property
    def middle(self) -> FloatArray:
        """Mean signals of every interval, (N - 1, SIGNAL_COUNT)."""
        return self.mean(self.parts)

    @contextmanager
    def as_left(self, column: int, *, mean: bool) -> Iterator[tuple[FloatArray, ...]]:
        """The parts, and their `mean` where it is asked for, to write a column of.

        What that had is put back: whole copies take long.
        """
        changed = (*self.parts, self.middle) if mean else self.parts
        before = [rows[:, column].copy() for rows in changed]
        try:
            yield changed
        finally:
            for rows, values in zip(changed, before, strict=True):
                rows[:, column] = values

    def mean(self, values: Sequence[FloatArray]) -> FloatArray:
        """Mean over the parts of every interval of what each of them has, (N - 1, ...)."""
        result = self.shares[0] * values[0]
        for share, one in zip(self.shares[1:], values[1:], strict=True):
            result += share * one
        return result


def held_flows(
    laws: Sequence[ActiveEffect], side: str, held: HeldRows, step_s: float
) -> list[FloatArray]:
    """Volumes into a chamber per sampling interval by laws that look at the valve, in series.

    Parameters
    ----------
    laws : sequence of ActiveEffect
        In the order in which they act: each sees the valve's flow as those before have left it.
        Internal states, if any, are `averaged` over the intervals.
    side : str
        Of the chamber, ``a`` or ``b``.
    held : HeldRows
    step_s : float
        Sampling interval.

    Returns
    -------
    list of (N - 1,) array
        What each adds, m^3; unknown where the signal is.
    """
    if len(laws) == 1:
        return [_volume(laws[0], side, held, step_s)[0]]
    passed, result = _PASSED[side], []
    # Only what is followed from interval to interval looks at the mean.
    with held.as_left(passed, mean=any(one.effect.states for one in laws)) as left:
        for one in laws:
            volume, adds = _volume(one, side, held, step_s)
            for rows, add in zip(left, adds[: len(left)], strict=True):
                rows[:, passed] += add
            result.append(volume)
    return result


def _volume(
    one: ActiveEffect, side: str, held: HeldRows, step_s: float
) -> tuple[FloatArray, list[FloatArray]]:
    """What a law adds per interval, m^3, and to the flows of the parts and the middle, m^3/s."""
    stage = FLOW[side]
    if one.effect.states:
        # They are followed from interval to interval, driven by the mean of either's flow.
        law = one.effect.evaluate(held.middle, one.parameters, stage, step_s)
        adds = [law] * (len(held.parts) + 1)
    else:
        adds = [one.effect.evaluate(own, one.parameters, stage, step_s) for own in held.parts]
        adds.append(held.mean(adds))
    return np.where(held.known, step_s * adds[-1], np.nan), adds
