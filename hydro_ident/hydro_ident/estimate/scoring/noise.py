"""What the sensors' noise alone leaves in the residuals: the floor no model can go below."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hydro_ident.estimate.flows.chambers import Chamber, WindowSettings
from hydro_ident.estimate.forces.inertial import ForceModel
from hydro_ident.estimate.signals.derivatives import (
    FilterSettings,
    central_differences,
    low_pass,
)
from hydro_ident.estimate.signals.signal_survey import Sensor, SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.rigid_body import mass_matrix
from hydro_model.robot import FloatArray, Robot


def force_noise(
    model: ForceModel,
    seen: Sequence[Trace] | SignalSurvey,
    settings: FilterSettings,
    fitted: Robot | None = None,
) -> FloatArray:
    """Noise floor of the force channels, shape (n,).

    Noise of pressures, or of measured torques, through the filters, and encoder noise through the
    filters, the second derivative and the mass matrix at the mean pose; where recordings have
    several rates, each with the filters that it bears, the rms over them by their time.

    Parameters
    ----------
    model : ForceModel
    seen : sequence of Trace, or SignalSurvey
        Where the sensors' noise is taken from.
    settings : FilterSettings
    fitted : Robot, optional
        The robot with inertia that was fitted; by default the model's own.
    """
    robot = model.robot
    survey = seen if isinstance(seen, SignalSurvey) else SignalSurvey.of(robot, seen)
    smooth = math.sqrt(survey.mean_over_rates(lambda step_s: _gains(step_s, settings)[0] ** 2))
    pose = survey.pose
    inertia = np.asarray(mass_matrix(fitted or robot, pose))
    variance = (inertia**2) @ acceleration_noise(survey, settings) ** 2
    measured = range(robot.dof) if model.torque else robot.dry_joints
    for joint in measured:
        variance[joint] += (survey.effort[joint].noise(0.0) * smooth) ** 2
    for i, cylinder in enumerate(robot.cylinders if not model.torque else ()):
        joint = robot.joint_index(cylinder.joint)
        variance[joint] /= float(lever(cylinder, pose[joint])) ** 2
        sensors = (survey.p_a[i], cylinder.area_a_m2), (survey.p_b[i], cylinder.area_b_m2)
        for sensor, area in sensors:
            noise = pressure_noise(robot, sensor)
            variance[joint] += (area * noise * smooth) ** 2
    return np.asarray(np.sqrt(variance))


def acceleration_noise(survey: SignalSurvey, settings: FilterSettings) -> FloatArray:
    """Deviations that the positions' noise makes of the joints' accelerations, (n,).

    Parameters
    ----------
    survey : SignalSurvey
    settings : FilterSettings
    """
    gain = math.sqrt(survey.mean_over_rates(lambda step_s: _gains(step_s, settings)[1] ** 2))
    return encoder_noise(survey) * gain


def flow_noise(
    robot: Robot,
    chamber: Chamber,
    seen: Sequence[Trace] | SignalSurvey,
    windows: WindowSettings,
    inverse_bulk: float,
) -> float:
    """Noise floor of a balance in m^3/s: position and pressure noise at a window's ends.

    `seen` is a survey, or the traces to make one of; `inverse_bulk` in 1/Pa.
    """
    survey = seen if isinstance(seen, SignalSurvey) else SignalSurvey.of(robot, seen)
    cylinder, i = chamber.cylinder, chamber.index
    span = math.sqrt(1.0 / survey.mean_over_rates(lambda h: 1.0 / _span_s(windows, h) ** 2))
    area = cylinder.area_a_m2 if chamber.side == "a" else cylinder.area_b_m2
    piston = survey.mean_arm(i) * encoder_noise(survey)[robot.joint_index(cylinder.joint)]
    sensor = (survey.p_a if chamber.side == "a" else survey.p_b)[i]
    pressure = pressure_noise(robot, sensor)
    volume = survey.mean_volume(i, chamber.side)
    ends = (area * piston) ** 2 + (volume * inverse_bulk * pressure) ** 2
    return float(np.sqrt(2.0 * ends) / span)


def _span_s(windows: WindowSettings, step_s: float) -> float:
    """Length of a window of whole sampling intervals, s."""
    return max(1, round(windows.length_s / step_s)) * step_s


def pressure_noise(robot: Robot, sensor: Sensor) -> float:
    """Standard deviation of a pressure by its transducer's noise and by the log's steps, Pa.

    Parameters
    ----------
    robot : Robot
        Whose transducers have a resolution.
    sensor : Sensor
        What was seen of the pressure.
    """
    return sensor.noise(sensor.step(robot.sensors.pressure_resolution_pa))


def encoder_noise(survey: SignalSurvey) -> FloatArray:
    """Standard deviations of the joints' positions by their encoders' noise, (n,), rad or m.

    Parameters
    ----------
    survey : SignalSurvey
    """
    # Of a slide nothing is declared, and a log may have been rounded behind the encoder: what was
    # seen of either stands for it.
    steps = survey.robot.encoder_steps
    return np.array(
        [
            sensor.noise(max(sensor.smallest_change, step))
            for sensor, step in zip(survey.q, steps, strict=True)
        ]
    )


def _gains(step_s: float, settings: FilterSettings) -> tuple[float, float]:
    """Noise gains of the two filters in series, and of these with the second derivative."""
    settings = settings.borne_at(step_s)
    count = 2 * (settings.edge_samples(step_s) + round(1.0 / (settings.parallel_hz * step_s))) + 1
    impulse = np.zeros(count)
    impulse[count // 2] = 1.0
    smooth = low_pass(impulse, step_s, settings.differentiation_hz, settings.order)
    _, curved = central_differences(smooth, step_s)
    through = [low_pass(d, step_s, settings.parallel_hz, settings.order) for d in (smooth, curved)]
    return float(np.linalg.norm(through[0])), float(np.linalg.norm(through[1]))
