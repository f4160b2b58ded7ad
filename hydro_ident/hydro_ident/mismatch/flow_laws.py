"""Flows into a chamber by laws that look at the valve: held as the command is, and as late.

The edges' own flow is integrated over both parts of each sampling interval, before and after the
delayed signal changes (`edge_integrals`). What an underlap, a compensator, a cushion or a hose
adds is a part of that flow, so that it has to come at the same instants. As in a roll-out,
restrictions in series multiply (`hydro_model.effects.effect.Effect.needs_valve`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.estimate.chambers import held_parts
from hydro_ident.estimate.in_series import FLOW
from hydro_model.effects.compiled import signals_read
from hydro_model.effects.rows import set_valve_signal
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot
from hydro_model.signals import (
    PRESSURE_A,
    PRESSURE_B,
    SIGNAL_COUNT,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    VALVE_FLOW_A,
    VALVE_FLOW_B,
    VALVE_SIGNAL,
)

_PASSED = {"a": VALVE_FLOW_A, "b": VALVE_FLOW_B}
_FLOWS = (VALVE_FLOW_A, VALVE_FLOW_B)
_OF_VALVE = frozenset({VALVE_SIGNAL, *_FLOWS})
_PRESSURES = (PRESSURE_A, PRESSURE_B, SUPPLY_PRESSURE, TANK_PRESSURE)


def looks_at_valve(one: ActiveEffect) -> bool:
    """Whether a flow into a chamber follows from the valve's signal by an effect's laws."""
    laws = [term.law for term in one.effect.terms if term.stage in FLOW.values()]
    if laws and one.effect.known_states is None:
        laws += [law for state in one.effect.states for law in (state.rate, state.initial)]
    return any(signals_read(law) & _OF_VALVE for law in laws)


def held_flows(
    laws: Sequence[ActiveEffect],
    side: str,
    robot: Robot,
    cylinder: int,
    rows: FloatArray,
    delay_s: float,
    step_s: float,
) -> list[FloatArray]:
    """Volumes into a chamber per sampling interval by laws that look at the valve, in series.

    Parameters
    ----------
    laws : sequence of ActiveEffect
        In the order in which they act: each sees the valve's flow as those before have left it.
        Internal states, if any, are `averaged` over the intervals.
    side : str
        Of the chamber, ``a`` or ``b``.
    robot : Robot
        With current edges.
    cylinder : int
    rows : (N, SIGNAL_COUNT) array
        Signals of the cylinder at the samples, the valve's without delay.
    delay_s : float
        From the stamp of a command to its effect.
    step_s : float
        Sampling interval.

    Returns
    -------
    list of (N - 1,) array
        What each adds; unknown where the signal is.
    """
    late, soon, fraction = held_parts(rows[:, VALVE_SIGNAL], delay_s, step_s)
    halves = [(late, fraction, 0.5 * fraction), (soon, 1.0 - fraction, 0.5 * (1.0 + fraction))]
    parts = [half for half in halves if half[1] > 0.0]
    shares = [share for _, share, _ in parts]
    stage, passed = FLOW[side], _PASSED[side]
    read = set[int]().union(*(signals_read(one.effect.term(stage).law) for one in laws))
    flows = len(laws) > 1 or bool(laws[0].effect.states) or bool(read.intersection(_FLOWS))
    others = frozenset(read.difference(_OF_VALVE).union(_PRESSURES if flows else ()))
    seen = [_between(rows, at, others) for _, _, at in parts]
    for own, (signal, _, _) in zip(seen, parts, strict=True):
        own[:, VALVE_SIGNAL] = signal
        if flows:
            set_valve_signal(own, robot, cylinder, signal)
    known = np.all([np.isfinite(signal) for signal, _, _ in parts], axis=0)
    result = []
    for one in laws:
        if one.effect.states:
            # They are followed from interval to interval, driven by the mean of either's flow.
            mean = _between(rows, 0.5, others)
            for column in (VALVE_SIGNAL, *_FLOWS):
                mean[:, column] = _mean(shares, [own[:, column] for own in seen])
            adds = [one.effect.evaluate(mean, one.parameters, stage, step_s)] * len(parts)
        else:
            adds = [one.effect.evaluate(own, one.parameters, stage, step_s) for own in seen]
        if flows:
            for own, add in zip(seen, adds, strict=True):
                own[:, passed] += add
        result.append(np.where(known, step_s * _mean(shares, adds), np.nan))
    return result


def _mean(shares: Sequence[float], values: Sequence[FloatArray]) -> FloatArray:
    """Mean over the parts of every interval, (N - 1,)."""
    return np.asarray(sum(share * one for share, one in zip(shares, values, strict=True)))


def _between(rows: FloatArray, at: float, read: frozenset[int]) -> FloatArray:
    """What a law reads at some part of every interval, (N - 1, SIGNAL_COUNT); the rest is open."""
    result = np.empty((len(rows) - 1, SIGNAL_COUNT))
    for column in read:
        own = rows[:, column]
        result[:, column] = own[:-1] + at * (own[1:] - own[:-1])
    return result
