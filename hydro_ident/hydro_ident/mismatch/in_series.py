"""Laws of the flow through a valve, one behind the other, as in a roll-out.

Restrictions in series multiply: each law sees the valve's flow as those before it have left it
(`hydro_model.effects.effect.Effect.needs_valve`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.law import Stage
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray
from hydro_model.signals import VALVE_FLOW_A, VALVE_FLOW_B

#: Stage of a chamber's flow laws.
FLOW = {"a": Stage.FLOW_A, "b": Stage.FLOW_B}
_PASSED = {"a": VALVE_FLOW_A, "b": VALVE_FLOW_B}
_ORDER = {name: k for k, name in enumerate(CATALOGUE)}


def valve_laws(terms: Sequence[ActiveEffect], index: int, side: str) -> list[ActiveEffect]:
    """Effects with a law of the flow between a chamber and its valve, in the order they act.

    Parameters
    ----------
    terms : sequence of ActiveEffect
        Of a model.
    index : int
        Of the cylinder.
    side : str
        Of the chamber, ``a`` or ``b``.
    """
    found = [
        one
        for one in terms
        if one.effect.needs_valve
        and one.cylinder in (None, index)
        and one.side in ("", side)
        and FLOW[side] in one.effect.stages
    ]
    return sorted(found, key=lambda one: _ORDER[one.effect.name])


def before(laws: Sequence[ActiveEffect], one: ActiveEffect) -> list[ActiveEffect]:
    """Those of some laws that act before another."""
    return [law for law in laws if _ORDER[law.effect.name] < _ORDER[one.effect.name]]


def passed(
    rows: FloatArray, laws: Sequence[ActiveEffect], side: str, step_s: float
) -> tuple[FloatArray, FloatArray]:
    """What some laws make of a valve's flow into a chamber.

    Parameters
    ----------
    rows : (N, SIGNAL_COUNT) array
        With the flows of the edges; not changed.
    laws : sequence of ActiveEffect
        In the order in which they act.
    side : str
        ``a`` or ``b``.
    step_s : float
        Sampling interval.

    Returns
    -------
    more : (N,) array
        What they add to the flow together, m^3/s.
    behind : (N, SIGNAL_COUNT) array
        Rows with the flow behind them.
    """
    more, behind = np.zeros(len(rows)), rows.copy() if laws else rows
    for one in laws:
        law = one.effect.evaluate(behind, one.parameters, FLOW[side], step_s)
        more += law
        behind[:, _PASSED[side]] += law
    return more, behind
