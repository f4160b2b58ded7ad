"""What the sensors' noise alone leaves in the residuals: the floor no model can go below."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hydro_ident.estimate.chambers import Chamber, WindowSettings
from hydro_ident.estimate.derivatives import (
    FilterSettings,
    central_differences,
    low_pass,
)
from hydro_ident.estimate.inertial import ForceModel
from hydro_ident.estimate.traces import Trace
from hydro_model.cylinder import chamber_volumes, lever
from hydro_model.rigid_body import mass_matrix
from hydro_model.robot import FloatArray, Robot


def sensor_noise(samples: Sequence[FloatArray], resolution: float) -> float:
    """Standard deviation of a sensor's white noise, from its third differences.

    Third differences of the motion of a crane vanish beside those of the noise. The 68th
    percentile keeps shocks out; a quantised sensor at rest still has its rounding.

    Parameters
    ----------
    samples : sequence of (N,) array
        Readings of one sensor, piece by piece.
    resolution : float
        Quantisation step.

    Returns
    -------
    float
    """
    differences = [np.diff(s, 3) for s in samples if s.size > 3 and np.isfinite(s).all()]
    rounding = resolution / math.sqrt(12.0)
    if not differences:
        return rounding
    spread = float(np.quantile(np.abs(np.concatenate(differences)), 0.6827))
    # The third difference of white noise has 1 + 9 + 9 + 1 times its variance.
    return max(spread / math.sqrt(20.0), rounding)


def force_noise(
    model: ForceModel, traces: Sequence[Trace], settings: FilterSettings
) -> FloatArray:
    """Noise floor of the force channels, shape (n,).

    Pressure noise through the filters, and encoder noise through the filters, the second
    derivative and the mass matrix at the mean pose.
    """
    robot, step = model.robot, traces[0].step_s
    smooth, accelerate = _gains(step, settings)
    count = 2.0 * np.pi / robot.sensors.encoder_counts_per_rev
    encoder = np.array(
        [sensor_noise([t.q[:, j] for t in traces], count) for j in range(robot.dof)]
    )
    pose = np.concatenate([t.q for t in traces]).mean(axis=0)
    inertia = np.asarray(mass_matrix(robot, pose))
    variance = (inertia**2) @ (encoder * accelerate) ** 2
    for i, cylinder in enumerate(robot.cylinders if not model.torque else ()):
        joint = robot.joint_index(cylinder.joint)
        variance[joint] /= float(lever(cylinder, pose[joint])) ** 2
        for pressures, area in (("p_a", cylinder.area_a_m2), ("p_b", cylinder.area_b_m2)):
            noise = _pressure_noise(robot, traces, pressures, i)
            variance[joint] += (area * noise * smooth) ** 2
    return np.asarray(np.sqrt(variance))


def flow_noise(
    robot: Robot,
    chamber: Chamber,
    traces: Sequence[Trace],
    windows: WindowSettings,
    inverse_bulk: float,
) -> float:
    """Noise floor of a balance in m^3/s: position and pressure noise at a window's ends."""
    cylinder, i = chamber.cylinder, chamber.index
    span = max(1, round(windows.length_s / traces[0].step_s)) * traces[0].step_s
    area = cylinder.area_a_m2 if chamber.side == "a" else cylinder.area_b_m2
    q = np.concatenate([t.q[:, robot.joint_index(cylinder.joint)] for t in traces])
    count = 2.0 * np.pi / robot.sensors.encoder_counts_per_rev
    arm = float(np.nanmean(np.abs(lever(cylinder, q)))) if np.isfinite(q).any() else 0.0
    piston = arm * sensor_noise([t.q[:, robot.joint_index(cylinder.joint)] for t in traces], count)
    stroke = np.concatenate([t.stroke[:, i] for t in traces])
    volume = float(np.nanmean(chamber_volumes(cylinder, stroke)[0 if chamber.side == "a" else 1]))
    pressure = _pressure_noise(robot, traces, f"p_{chamber.side}", i)
    ends = (area * piston) ** 2 + (volume * inverse_bulk * pressure) ** 2
    return float(np.sqrt(2.0 * ends) / span)


def _pressure_noise(robot: Robot, traces: Sequence[Trace], field: str, index: int) -> float:
    readings = [getattr(t, field)[:, index] for t in traces]
    return sensor_noise(readings, robot.sensors.pressure_resolution_pa)


def _gains(step_s: float, settings: FilterSettings) -> tuple[float, float]:
    """Noise gains of the two filters in series, and of these with the second derivative."""
    count = 2 * (settings.edge_samples(step_s) + round(1.0 / (settings.parallel_hz * step_s))) + 1
    impulse = np.zeros(count)
    impulse[count // 2] = 1.0
    smooth = low_pass(impulse, step_s, settings.differentiation_hz, settings.order)
    _, curved = central_differences(smooth, step_s)
    through = [low_pass(d, step_s, settings.parallel_hz, settings.order) for d in (smooth, curved)]
    return float(np.linalg.norm(through[0])), float(np.linalg.norm(through[1]))
