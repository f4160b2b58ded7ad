"""Expected standard errors of the hydraulics: bulk modulus, valve edges and listed effects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.design.expected import Expected
from hydro_ident.design.information import Residual, moments, sandwich
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.chambers import (
    INVERSE_BULK,
    OVER_BULK,
    Chamber,
    WindowSettings,
    chamber_rows,
    chambers_of,
    column_names,
)
from hydro_ident.estimate.scoring.noise import flow_noise
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.least_squares import MAX_COLLINEARITY, collinearity
from hydro_ident.parameters.parameters import effect_unit, listed_value
from hydro_model.robot import FloatArray

_EDGES = ("c_pa", "c_at", "c_pb", "c_bt")
_EDGE_UNIT = "m^3/(s sqrt(Pa))"


@dataclass(frozen=True, slots=True)
class _Told:
    """What one chamber tells.

    Attributes
    ----------
    names : tuple of str
        Of the balance's columns.
    covariance : (p, p) array
    collinearity : (p,) array
    """

    names: tuple[str, ...]
    covariance: FloatArray
    collinearity: FloatArray


def flow_errors(
    effects: ListedEffects, trace: Trace, residual: Residual, windows: WindowSettings
) -> list[Expected]:
    """Expected errors of every cylinder that a valve feeds.

    Parameters
    ----------
    effects : ListedEffects
        Of the robot; its numbers stand for the machine's.
    trace : Trace
        The motion with the pressures and valve signals that it needs.
    residual : Residual
    windows : WindowSettings

    Returns
    -------
    list of Expected
        Per cylinder bulk modulus, the four edges and the linear parameters of listed effects.
    """
    chambers = chambers_of(effects.robot)
    expected = []
    for index in sorted({chamber.index for chamber in chambers}):
        both = [chamber for chamber in chambers if chamber.index == index]
        if np.isfinite(trace.p_a[:, index]).all():
            told = [_told(effects, chamber, trace, residual, windows) for chamber in both]
            expected += _cylinder_errors(effects, both[0], told)
    return expected


def _cylinder_errors(
    effects: ListedEffects, chamber: Chamber, told: Sequence[_Told]
) -> list[Expected]:
    """What both chambers tell together."""
    cylinder, valve, robot = chamber.cylinder, chamber.valve, effects.robot
    std = _combined(chamber, told)
    bulk, inverse_std = cylinder.bulk_modulus_pa, std.pop(INVERSE_BULK)
    expected = [Expected(f"{cylinder.name}.bulk_modulus", "Pa", bulk, bulk * inverse_std)]
    for edge in _EDGES:
        value = float(getattr(valve, edge))
        name = f"{valve.name}.{edge}"
        expected.append(Expected(name, _EDGE_UNIT, value, value * std.pop(edge)))
    for column, error in std.items():
        name = f"{cylinder.name}.{column.removesuffix(OVER_BULK)}"
        value = listed_value(robot, name)
        if column.endswith(OVER_BULK):
            # Fitted is V0 / beta: the volume is as uncertain as the modulus, too.
            error = math.hypot(bulk * error, value * inverse_std)
        expected.append(Expected(name, effect_unit(robot, name), value, error))
    return expected


def _combined(chamber: Chamber, told: Sequence[_Told]) -> dict[str, float]:
    """Errors by column, of bulk modulus and edges over the robot file's values.

    As the fit combines them: parameters of the same name are one, weighted by information.
    """
    cylinder, valve = chamber.cylinder, chamber.valve
    edges = [name for one in told for name in one.names if name in _EDGES]
    others = [name for one in told for name in one.names if name != INVERSE_BULK]
    names = tuple(dict.fromkeys((INVERSE_BULK, *edges, *others)))
    # Columns in units of such values: 1 / beta, edges and effects are far apart.
    values = np.array([1.0 / cylinder.bulk_modulus_pa, *(getattr(valve, e) for e in edges)])
    known = len(values)
    values = np.append(values, [_largest_std(told, name) for name in names[known:]])
    information, collinear = np.zeros((len(names), len(names))), np.zeros(len(names))
    for one in told:
        at = np.array([names.index(name) for name in one.names])
        scaled = one.covariance / np.outer(values[at], values[at])
        information[np.ix_(at, at)] += np.linalg.pinv(scaled, rcond=1e-15, hermitian=True)
        collinear[at] = np.maximum(collinear[at], one.collinearity)
    relative = np.sqrt(np.diag(np.linalg.pinv(information, rcond=1e-15, hermitian=True)))
    relative[known:] *= values[known:]
    relative[collinear >= MAX_COLLINEARITY] = np.inf
    return dict(zip(names, relative.tolist(), strict=True))


def _largest_std(told: Sequence[_Told], name: str) -> float:
    both = [one for one in told if name in one.names]
    variance = [one.covariance[(i := one.names.index(name)), i] for one in both]
    return float(np.sqrt(max(variance)))


def _told(
    effects: ListedEffects,
    chamber: Chamber,
    trace: Trace,
    residual: Residual,
    windows: WindowSettings,
) -> _Told:
    robot, valve = effects.robot, chamber.valve
    listed, extra = effects.chamber_columns(chamber, trace)
    rows = chamber_rows(chamber, trace, robot.command_delay_s, windows, extra)
    rated = max(valve.c_pa, valve.c_at, valve.c_pb, valve.c_bt)
    level = residual.flow_share * rated * float(np.sqrt(0.5 * robot.supply_pressure_pa))
    floor = flow_noise(robot, chamber, [trace], windows, 1.0 / chamber.cylinder.bulk_modulus_pa)
    spacing = float(rows.time_s[1] - rows.time_s[0])
    bread, middle = moments(rows.x / level, spacing, residual.correlation_s)
    return _Told(
        column_names(chamber, listed),
        sandwich(bread, middle + (floor / level) ** 2 * bread),
        collinearity(rows.x[:, 0]),
    )
