"""Standard errors of every parameter before the run, by the estimators' own equations.

The designed motion is put through the same filters, regressors and windows that the recording will
pass, with the columns of the effects that the robot lists; the residuals are taken as stated
(`Residual`) with the sensors' noise added. What is predicted is the scatter of the estimates. A
bias from physics that the model leaves out is not in it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro_ident.design.expected import Expected
from hydro_ident.design.flow_errors import flow_errors
from hydro_ident.design.information import (
    ForceInformation,
    Residual,
    bare_trace,
    moments,
    required_forces,
    sandwich,
)
from hydro_ident.design.pressures import Hydraulics, required_hydraulics
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.forces.inertial import Motion
from hydro_ident.estimate.scoring.noise import force_noise
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.least_squares import MAX_COLLINEARITY, collinearity
from hydro_ident.json_numbers import finite
from hydro_ident.parameters.parameters import effect_unit, listed_value, viscous_unit
from hydro_model.robot import STANDARD_PARAMETERS, STANDARD_UNITS, FloatArray, Robot

__all__ = [
    "Expected",
    "Motions",
    "Prediction",
    "cavitating",
    "expected_trace",
    "predict",
    "predicted_json",
]

SCHEMA = "hydro_ident/predicted/1"
Motions = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Prediction:
    """What a run will tell.

    Attributes
    ----------
    parameters : tuple of Expected
        By the names of `identify`: base parameters of the links, friction, then hydraulics, each
        with the listed effects'. Without the command delay, and without the parameters of barrels
        and rods, which no run may show.
    condition : float
        Of the filtered base regressor as it is, in SI units, without friction.
    condition_scaled : float
        Of the force regressor with friction, listed effects' too, columns of unit length.
    signal : (m,) array
        Greatest valve signal that the motion needs.
    pressure_low_pa, pressure_high_pa : (m,) array
        Range of both chambers' pressures, gauge, held between tank and supply.
    pressure_unheld_pa : (m,) array
        The lowest where nothing held them; below absolute zero the oil cavitates.
    """

    parameters: tuple[Expected, ...]
    condition: float
    condition_scaled: float
    signal: FloatArray
    pressure_low_pa: FloatArray
    pressure_high_pa: FloatArray
    pressure_unheld_pa: FloatArray


def predict(robot: Robot, motion: Motions, residual: Residual, step_s: float) -> Prediction:
    """Predict the standard errors that a run gives.

    Parameters
    ----------
    robot : Robot
        Its numbers stand for the machine's, the listed effects' among them.
    motion : tuple of (N, n) arrays
        q, qd and qdd at the sensors' rate.
    residual : Residual
    step_s : float

    Returns
    -------
    Prediction
    """
    effects = ListedEffects.of(robot)
    information = ForceInformation(robot, residual, effects)
    filters, windows = FilterSettings(), WindowSettings()
    hydraulics, trace = expected_trace(effects, motion, step_s)
    rows, spacing = information.filtered(*motion, trace, filters)
    forces = _force_errors(information, rows, spacing, trace, filters)
    flows = flow_errors(effects, trace, residual, windows)
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
        pressure_unheld_pa=-_extreme(-hydraulics.unheld),
    )


def expected_trace(
    effects: ListedEffects, motion: Motions, step_s: float
) -> tuple[Hydraulics, Trace]:
    """Pressures and valve signals along a motion, and what would be recorded of it.

    The forces include the listed friction; leakage, dead volumes and air are taken for too small
    to move the pressures.

    Parameters
    ----------
    effects : ListedEffects
    motion : tuple of (N, n) arrays
    step_s : float

    Returns
    -------
    hydraulics : Hydraulics
    trace : Trace
        Its valve signals stay within +-1.
    """
    robot, bare = effects.robot, bare_trace(effects.robot, motion[0], step_s)
    forces = required_forces(robot, *motion)
    hydraulics, trace = _with_hydraulics(bare, robot, motion, forces)
    if not effects.force_names:
        return hydraulics, trace
    # Seal friction looks at pressures: those without it are near enough.
    columns = effects.force_columns(trace, Motion(*motion))
    listed = columns @ np.array([listed_value(robot, name) for name in effects.force_names])
    driven = [robot.joint_index(cylinder.joint) for cylinder in robot.cylinders]
    return _with_hydraulics(bare, robot, motion, forces + listed[:, driven])


def _with_hydraulics(
    bare: Trace, robot: Robot, motion: Motions, forces: FloatArray
) -> tuple[Hydraulics, Trace]:
    found = required_hydraulics(robot, bare.step_s, motion[0], motion[1], forces)
    signal = np.clip(found.signal, -1.0, 1.0)
    return found, replace(bare, p_a=found.p_a, p_b=found.p_b, valve_signal=signal)


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
    std[collinearity(rows.reshape(-1, rows.shape[2])) >= MAX_COLLINEARITY] = np.inf
    values = model.base.combination @ robot.parameter_vector
    units = dict(zip(STANDARD_PARAMETERS, STANDARD_UNITS, strict=True))
    expected = [
        Expected(name, units[name.rsplit(".", 1)[-1]], float(value), float(error))
        for name, value, error in zip(model.base.names, values, std, strict=False)
    ]
    for name, error in zip(model.names[len(values) :], std[len(values) :], strict=True):
        expected.append(_friction(robot, name, float(error)))
    return expected


def _friction(robot: Robot, name: str, std: float) -> Expected:
    """Viscous friction or a listed effect's parameter, of a cylinder or a joint without one."""
    dry = [robot.joints[j] for j in robot.dry_joints]
    viscous = {f"{one.name}.viscous_friction": one.viscous_friction for one in robot.cylinders}
    viscous |= {f"{joint.name}.viscous_friction": joint.viscous_friction for joint in dry}
    if name in viscous:
        unit, datasheet = viscous_unit(robot, name), viscous[name] or None
    else:
        unit, datasheet = effect_unit(robot, name), listed_value(robot, name)
    return Expected(name, unit, datasheet, std)


def cavitating(robot: Robot, prediction: Prediction) -> tuple[str, ...]:
    """Cylinders of which a chamber is emptied faster than its edge fills it.

    Parameters
    ----------
    robot : Robot
    prediction : Prediction

    Returns
    -------
    tuple of str
        Whose lowest pressure, unheld, is below absolute zero.
    """
    lowest = zip(robot.cylinders, prediction.pressure_unheld_pa.tolist(), strict=True)
    return tuple(c.name for c, pressure in lowest if pressure < -robot.atmospheric_pressure_pa)


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
        "condition_number": finite(prediction.condition),
        "condition_number_unit_columns": finite(prediction.condition_scaled),
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "datasheet": p.datasheet,
                "std": finite(p.std),
                "relative_std": finite(p.relative),
                "identifiable": bool(np.isfinite(p.std)),
            }
            for p in prediction.parameters
        ],
        "cylinders": [
            {
                "name": cylinder.name,
                "greatest_valve_signal": finite(prediction.signal[i]),
                "pressure_low_pa": finite(prediction.pressure_low_pa[i]),
                "pressure_high_pa": finite(prediction.pressure_high_pa[i]),
                "pressure_unheld_pa": finite(prediction.pressure_unheld_pa[i]),
                "cavitates": cylinder.name in cavitating(robot, prediction),
            }
            for i, cylinder in enumerate(robot.cylinders)
        ],
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"
