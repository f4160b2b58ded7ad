"""Listed effects moved to what was fitted, where rows of balances depend on it.

A null bias bends the edges' columns, air is in a dead volume as well, and rails give way to what
passes the edges: columns are made of what is known of them, fitted, and made anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.effects.listed_laws import NULL_BIAS, is_bias, linear_names
from hydro_ident.estimate.flows.chambers import INVERSE_BULK, OVER_BULK
from hydro_ident.estimate.flows.cylinder_fit import CylinderFit
from hydro_ident.estimate.flows.hydraulics import HydraulicFit
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Valve

#: Steps of edges count so much beside a null bias': rails that follow them to 1e-4 are settled.
_PER_EDGE = 1.0e-3
_EDGES = ("c_pa", "c_at", "c_pb", "c_bt")


def stepped(effects: ListedEffects, fit: HydraulicFit) -> tuple[ListedEffects, float]:
    """One step of what is iterated, and its largest size.

    Gauss-Newton of the listed null biases; dead volumes beside air are those fitted, and rails
    follow the flow of the edges as fitted.

    Parameters
    ----------
    effects : ListedEffects
    fit : HydraulicFit
        Of traces with these laws; its `NULL_BIAS` is the step of a null bias.

    Returns
    -------
    moved : ListedEffects
        With biases and dead volumes moved, and the fitted edges for the next slope and the
        rails.
    largest : float
        Of biases, and of volumes in m^3.
    """
    found = {c.cylinder: c for c in fit.cylinders}
    bent = {n: c for n, c in found.items() if NULL_BIAS in c.names}
    fitted = bent | {n: c for n, c in found.items() if effects.rails and not c.rejected}
    valves, largest = _followed(effects, fitted)
    active = []
    for one in effects.active:
        own, moved = found.get(effects.cylinder_name(one)), one.parameters
        bounds = one.effect.parameters
        if own is not None and is_bias(one) and NULL_BIAS in own.names:
            moved = moved + own.value(NULL_BIAS)[0]
        elif own is not None and effects.holds_air(one):
            moved = _dead_volumes(one, own)
        moved = np.clip(moved, [p.lower for p in bounds], [p.upper for p in bounds])
        largest = max(largest, float(np.abs(moved - one.parameters).max(initial=0.0)))
        active.append(replace(one, parameters=moved))
    moved_robot = replace(effects.robot, valves=valves)
    return replace(effects, robot=moved_robot, active=tuple(active)), largest


def _followed(
    effects: ListedEffects, found: Mapping[str, CylinderFit]
) -> tuple[tuple[Valve, ...], float]:
    """Valves with the edges of fits by cylinder, and by how much rails are yet to follow."""
    valves, most = [], 0.0
    for valve in effects.robot.valves:
        fresh = valve
        if valve.cylinder in found:
            fresh = _with_edges(valve, found[valve.cylinder])
        if effects.rails:
            pairs = [(getattr(fresh, e), getattr(valve, e)) for e in _EDGES]
            most = max(most, *(abs(new / old - 1.0) for new, old in pairs))
        valves.append(fresh)
    return tuple(valves), _PER_EDGE * most


def _with_edges(valve: Valve, fit: CylinderFit) -> Valve:
    c_pa, c_at, c_pb, c_bt = (
        fit.value(edge)[0] if edge in fit.names else float(getattr(valve, edge)) for edge in _EDGES
    )
    return replace(valve, c_pa=c_pa, c_at=c_at, c_pb=c_pb, c_bt=c_bt)


def _dead_volumes(one: ActiveEffect, fit: CylinderFit) -> FloatArray:
    """Dead volumes as fitted; those that were not, as they were."""
    inverse, result = fit.value(INVERSE_BULK)[0], one.parameters.copy()
    for i, name in enumerate(linear_names(one)):
        if inverse > 0.0 and f"{name}{OVER_BULK}" in fit.names:
            result[i] = fit.value(f"{name}{OVER_BULK}")[0] / inverse
    return result
