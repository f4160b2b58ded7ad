"""Standard errors of every parameter before the run, by the estimators' own equations.

The designed motion is put through the same filters, regressors and windows that the recording will
pass; the residuals are taken as stated (`Residual`) with the sensors' noise added. What is
predicted is the scatter of the estimates. A bias from physics that the model leaves out is not in
it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro_ident.design.information import (
    ForceInformation,
    Residual,
    bare_trace,
    moments,
    required_forces,
    sandwich,
)
from hydro_ident.design.pressures import required_hydraulics
from hydro_ident.estimate.chambers import (
    INVERSE_BULK,
    Chamber,
    WindowSettings,
    chamber_rows,
    chambers_of,
    column_names,
)
from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.estimate.least_squares import collinearity
from hydro_ident.estimate.noise import flow_noise, force_noise
from hydro_ident.estimate.traces import Trace
from hydro_model.robot import STANDARD_PARAMETERS, STANDARD_UNITS, FloatArray, Robot

SCHEMA = "hydro_ident/predicted/1"
Motions = tuple[FloatArray, FloatArray, FloatArray]
#: A column that resembles the others this much is not told apart from them.
_MAX_COLLINEARITY = 1.0e3


@dataclass(frozen=True, slots=True)
class Expected:
    """Expected standard error of one parameter.

    Attributes
    ----------
    name, unit : str
    datasheet : float or None
        The robot file's value; None where it has none.
    std : float
        Infinite where the motion does not determine the parameter.
    """

    name: str
    unit: str
    datasheet: float | None
    std: float

    @property
    def relative(self) -> float | None:
        """Standard error over the datasheet's value; None without one."""
        return self.std / abs(self.datasheet) if self.datasheet else None


@dataclass(frozen=True, slots=True)
class Prediction:
    """What a run will tell.

    Attributes
    ----------
    parameters : tuple of Expected
        In the order and by the names of `identify`.
    condition : float
        Of the filtered base regressor as it is, in SI units, without friction.
    condition_scaled : float
        Of the force regressor with friction, columns of unit length.
    signal : (m,) array
        Greatest valve signal that the motion needs.
    pressure_low_pa, pressure_high_pa : (m,) array
        Range of both chambers' pressures, gauge.
    """

    parameters: tuple[Expected, ...]
    condition: float
    condition_scaled: float
    signal: FloatArray
    pressure_low_pa: FloatArray
    pressure_high_pa: FloatArray


def predict(robot: Robot, motion: Motions, residual: Residual, step_s: float) -> Prediction:
    """Predict the standard errors that a run gives.

    Parameters
    ----------
    robot : Robot
        Its numbers stand for the machine's.
    motion : tuple of (N, n) arrays
        q, qd and qdd at the sensors' rate.
    residual : Residual
    step_s : float

    Returns
    -------
    Prediction
    """
    information = ForceInformation(robot, residual)
    q, qd, qdd = motion
    filters, windows = FilterSettings(), WindowSettings()
    hydraulics = required_hydraulics(robot, step_s, q, qd, required_forces(robot, q, qd, qdd))
    trace = replace(
        bare_trace(robot, q, step_s),
        p_a=hydraulics.p_a,
        p_b=hydraulics.p_b,
        valve_signal=np.clip(hydraulics.signal, -1.0, 1.0),
    )
    rows, spacing = information.filtered(q, qd, qdd, step_s, filters)
    forces = _force_errors(information, rows, spacing, trace, filters)
    flows = _flow_errors(robot, trace, residual, windows)
    base = len(information.model.base.names)
    plain = (rows * information.channel_std[:, None]).reshape(-1, rows.shape[2])
    lengths = np.linalg.norm(plain, axis=0)
    lengths[lengths == 0.0] = 1.0
    return Prediction(
        parameters=(*forces, *flows),
        condition=_condition(plain[:, :base]),
        condition_scaled=_condition(plain / lengths),
        signal=_extreme(np.abs(hydraulics.signal)),
        pressure_low_pa=-_extreme(-np.minimum(hydraulics.p_a, hydraulics.p_b)),
        pressure_high_pa=_extreme(np.maximum(hydraulics.p_a, hydraulics.p_b)),
    )


def _condition(x: FloatArray) -> float:
    return float(np.linalg.cond(x)) if x.size else 1.0


def _extreme(values: FloatArray) -> FloatArray:
    return np.asarray(values.max(axis=0)) if len(values) else np.zeros(values.shape[1])


def _force_errors(
    information: ForceInformation,
    rows: FloatArray,
    spacing_s: float,
    trace: Trace,
    filters: FilterSettings,
) -> list[Expected]:
    robot, model = information.robot, information.model
    noise = force_noise(model, [trace], filters) / information.channel_std
    bread, middle = moments(rows, spacing_s, information.residual.correlation_s)
    noisy = rows * noise[:, None]
    middle = middle + np.einsum("tkp,tkq->pq", noisy, noisy)
    std = np.sqrt(np.diag(sandwich(bread, middle)))
    std[collinearity(rows.reshape(-1, rows.shape[2])) >= _MAX_COLLINEARITY] = np.inf
    values = model.base.combination @ robot.parameter_vector
    units = dict(zip(STANDARD_PARAMETERS, STANDARD_UNITS, strict=True))
    expected = [
        Expected(name, units[name.rsplit(".", 1)[-1]], float(value), float(error))
        for name, value, error in zip(model.base.names, values, std, strict=False)
    ]
    known = {f"{c.name}.viscous_friction": c.viscous_friction for c in robot.cylinders}
    turning = {f"{j.name}.viscous_friction" for j in robot.joints if not j.prismatic}
    for name, error in zip(model.names[len(values) :], std[len(values) :], strict=True):
        unit = "N m s/rad" if name in turning else "N s/m"
        expected.append(Expected(name, unit, known.get(name) or None, float(error)))
    return expected


def _flow_errors(
    robot: Robot, trace: Trace, residual: Residual, windows: WindowSettings
) -> list[Expected]:
    chambers = chambers_of(robot)
    expected = []
    for index in sorted({chamber.index for chamber in chambers}):
        both = [chamber for chamber in chambers if chamber.index == index]
        if np.isfinite(trace.p_a[:, index]).all():
            expected += _cylinder_errors(robot, both, trace, residual, windows)
    return expected


def _cylinder_errors(
    robot: Robot,
    chambers: Sequence[Chamber],
    trace: Trace,
    residual: Residual,
    windows: WindowSettings,
) -> list[Expected]:
    """Bulk modulus, which both chambers tell, and the four edges."""
    cylinder, valve = chambers[0].cylinder, chambers[0].valve
    edges = [edge for chamber in chambers for edge in chamber.edges]
    names = (INVERSE_BULK, *edges)
    values = np.array([1.0 / cylinder.bulk_modulus_pa, *(getattr(valve, e) for e in edges)])
    information = np.zeros((len(names), len(names)))
    for chamber in chambers:
        at = np.array([names.index(name) for name in column_names(chamber)])
        covariance = _chamber_covariance(robot, chamber, trace, residual, windows)
        # In units of the datasheet's values: 1 / beta and the edges are far apart.
        scaled = covariance / np.outer(values[at], values[at])
        information[np.ix_(at, at)] += np.linalg.pinv(scaled, rcond=1e-15, hermitian=True)
    relative = np.sqrt(np.diag(np.linalg.pinv(information, rcond=1e-15, hermitian=True)))
    bulk = cylinder.bulk_modulus_pa
    expected = [Expected(f"{cylinder.name}.bulk_modulus", "Pa", bulk, bulk * float(relative[0]))]
    for edge in ("c_pa", "c_at", "c_pb", "c_bt"):
        value, k = float(getattr(valve, edge)), names.index(edge)
        unit = "m^3/(s sqrt(Pa))"
        expected.append(Expected(f"{valve.name}.{edge}", unit, value, value * float(relative[k])))
    return expected


def _chamber_covariance(
    robot: Robot,
    chamber: Chamber,
    trace: Trace,
    residual: Residual,
    windows: WindowSettings,
) -> FloatArray:
    rows = chamber_rows(chamber, trace, robot.command_delay_s, windows)
    valve = chamber.valve
    rated = max(valve.c_pa, valve.c_at, valve.c_pb, valve.c_bt)
    level = residual.flow_share * rated * float(np.sqrt(0.5 * robot.supply_pressure_pa))
    floor = flow_noise(robot, chamber, [trace], windows, 1.0 / chamber.cylinder.bulk_modulus_pa)
    spacing = float(rows.time_s[1] - rows.time_s[0])
    bread, middle = moments(rows.x / level, spacing, residual.correlation_s)
    return sandwich(bread, middle + (floor / level) ** 2 * bread)


def predicted_json(
    robot: Robot, prediction: Prediction, residual: Residual, duration_s: float
) -> str:
    """The content of predicted.json: strict JSON, None where something is not determined."""
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "robot": robot.name,
        "duration_s": duration_s,
        "residual": {
            "force_share": residual.force_share,
            "flow_share": residual.flow_share,
            "correlation_s": residual.correlation_s,
        },
        "condition_number": prediction.condition,
        "condition_number_unit_columns": prediction.condition_scaled,
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "datasheet": p.datasheet,
                "std": _finite(p.std),
                "relative_std": _finite(p.relative),
                "identifiable": bool(np.isfinite(p.std)),
            }
            for p in prediction.parameters
        ],
        "cylinders": [
            {
                "name": cylinder.name,
                "greatest_valve_signal": _finite(prediction.signal[i]),
                "pressure_low_pa": _finite(prediction.pressure_low_pa[i]),
                "pressure_high_pa": _finite(prediction.pressure_high_pa[i]),
            }
            for i, cylinder in enumerate(robot.cylinders)
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None
