"""Flows into a chamber by laws that look at the valve: held as the command is, and as late.

The edges' own flow is integrated over both parts of each sampling interval, before and after the
delayed signal changes (`edge_integrals`). What an underlap, a compensator, a cushion or a hose
adds is a part of that flow, so that it has to come at the same instants.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.chambers import held_parts
from hydro_model.effects.compiled import signals_read
from hydro_model.effects.effect import Stage
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

FLOW = {"a": Stage.FLOW_A, "b": Stage.FLOW_B}
_FLOWS = (VALVE_FLOW_A, VALVE_FLOW_B)
_OF_VALVE = frozenset({VALVE_SIGNAL, *_FLOWS})
_PRESSURES = (PRESSURE_A, PRESSURE_B, SUPPLY_PRESSURE, TANK_PRESSURE)


def looks_at_valve(one: ActiveEffect) -> bool:
    """Whether a flow into a chamber follows from the valve's signal by an effect's laws."""
    laws = [term.law for term in one.effect.terms if term.stage in FLOW.values()]
    if laws and one.effect.known_states is None:
        laws += [law for state in one.effect.states for law in (state.rate, state.initial)]
    return any(signals_read(law) & _OF_VALVE for law in laws)


def held_flow(
    one: ActiveEffect,
    stage: Stage,
    robot: Robot,
    cylinder: int,
    rows: FloatArray,
    delay_s: float,
    step_s: float,
) -> FloatArray:
    """Volume into a chamber per sampling interval by a law that looks at the valve.

    Parameters
    ----------
    one : ActiveEffect
        Its internal states, if any, are `averaged` over the intervals.
    stage : Stage
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
    (N - 1,) array
        Unknown where the signal is.
    """
    late, soon, fraction = held_parts(rows[:, VALVE_SIGNAL], delay_s, step_s)
    halves = [(late, fraction, 0.5 * fraction), (soon, 1.0 - fraction, 0.5 * (1.0 + fraction))]
    parts = [half for half in halves if half[1] > 0.0]
    read = signals_read(one.effect.term(stage).law)
    flows = bool(one.effect.states) or bool(read.intersection(_FLOWS))
    read = read.difference(_OF_VALVE).union(_PRESSURES if flows else ())
    seen = [_between(rows, at, read) for _, _, at in parts]
    for own, (signal, _, _) in zip(seen, parts, strict=True):
        own[:, VALVE_SIGNAL] = signal
        if flows:
            set_valve_signal(own, robot, cylinder, signal)
    shares = [share for _, share, _ in parts]
    if one.effect.states:
        # They are followed from interval to interval, driven by the mean of either's flow.
        mean = _between(rows, 0.5, read)
        for column in (VALVE_SIGNAL, *_FLOWS):
            mean[:, column] = sum(
                share * own[:, column] for share, own in zip(shares, seen, strict=True)
            )
        seen, shares = [mean], [1.0]
    law = [one.effect.evaluate(own, one.parameters, stage, step_s) for own in seen]
    volume = step_s * sum(share * flow for share, flow in zip(shares, law, strict=True))
    known = np.all([np.isfinite(signal) for signal, _, _ in parts], axis=0)
    return np.where(known, volume, np.nan)


def _between(rows: FloatArray, at: float, read: frozenset[int]) -> FloatArray:
    """What a law reads at some part of every interval, (N - 1, SIGNAL_COUNT); the rest is open."""
    result = np.empty((len(rows) - 1, SIGNAL_COUNT))
    for column in read:
        own = rows[:, column]
        result[:, column] = own[:-1] + at * (own[1:] - own[:-1])
    return result
