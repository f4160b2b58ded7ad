"""Readings of a whole run at once: pressures and spools as the transducers show them."""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.following import Track
from hydro_hw_bridge.rig.plant import Plant
from hydro_model.robot import FloatArray


def true_pressures(plant: Plant, states: FloatArray) -> FloatArray:
    """Gauge pressures in the order of `Robot.pressure_names`, (N, 2 m + 2).

    `states` are rows of `Plant.state`.
    """
    n, m = plant.robot.dof, len(plant.robot.cylinders)
    out = np.empty((len(states), 2 * m + 2))
    out[:, 0 : 2 * m : 2] = states[:, 2 * n : 2 * n + m]
    out[:, 1 : 2 * m : 2] = states[:, 2 * n + m : 2 * n + 2 * m]
    out[:, 2 * m :] = states[:, plant.lines_index : plant.lines_index + 2]
    return out


def shown_pressures(plant: Plant, pressures: FloatArray, cycle_s: float) -> FloatArray:
    """True pressures (N, 2 m + 2) as the transducers see them, before noise and rounding."""
    sensors, extras = plant.truth.sensors, plant.truth.extras.sensors
    time = np.arange(len(pressures)) * cycle_s
    shown = np.array(pressures)
    for k, name in enumerate(plant.robot.pressure_names):
        late = extras.pressure_delay_s.get(name, 0.0)
        if late > 0.0:
            shown[:, k] = np.interp(time - late, time, pressures[:, k])
        shown[:, k] *= 1.0 + extras.pressure_gain.get(name, 0.0)
        shown[:, k] += sensors.pressure_bias_pa.get(name, 0.0)
        if name in extras.hum_pa:
            turn = 2.0 * np.pi * extras.hum_hz.get(name, 0.0)
            shown[:, k] += extras.hum_pa[name] * np.sin(turn * time)
    return shown


def shown_rises(plant: Plant, rises: FloatArray, cycle_s: float) -> FloatArray:
    """Time derivatives (N, 2 m + 2) of true pressures as the transducers would show them.

    `rises` are those, in the order of `Robot.pressure_names`, Pa/s.
    """
    extras = plant.truth.extras.sensors
    time = np.arange(len(rises)) * cycle_s
    shown = np.array(rises)
    for k, name in enumerate(plant.robot.pressure_names):
        late = extras.pressure_delay_s.get(name, 0.0)
        if late > 0.0:
            shown[:, k] = np.interp(time - late, time, rises[:, k])
        shown[:, k] *= 1.0 + extras.pressure_gain.get(name, 0.0)
        if name in extras.hum_pa:
            turn = 2.0 * np.pi * extras.hum_hz.get(name, 0.0)
            shown[:, k] += extras.hum_pa[name] * turn * np.cos(turn * time)
    return shown


def shown_positions(
    plant: Plant, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint motion (N, n) as the encoders would show it, before noise and rounding."""
    robot, sensors = plant.robot, plant.truth.sensors
    extras = plant.truth.extras.sensors
    names = robot.joint_names
    offset = np.array([sensors.encoder_offset.get(name, 0.0) for name in names])
    swing = np.array([extras.encoder_swing.get(name, 0.0) for name in names])
    turn = np.array([extras.encoder_swing_count.get(name, 0.0) for name in names])
    slope = 1.0 + swing * turn * np.cos(turn * q)
    bend = swing * turn**2 * np.sin(turn * q)
    return q + offset + swing * np.sin(turn * q), qd * slope, qdd * slope - bend * qd**2


def read_pressures(plant: Plant, track: Track, seed: int) -> FloatArray:
    """Gauge pressures as reported, with noise, rounding and range, (N, 2 m + 2).

    Parameters
    ----------
    plant : Plant
        The machine of the run.
    track : Track
    seed : int
        Of the noise.
    """
    robot, sensors = plant.robot, plant.truth.sensors
    shown = shown_pressures(plant, true_pressures(plant, track.states), track.cycle_s)
    random = np.random.default_rng(seed)
    shown += sensors.pressure_noise_pa * random.standard_normal(shown.shape)
    extras = plant.truth.extras.sensors
    if extras.wander_pa > 0.0:
        keep = np.exp(-track.cycle_s / extras.wander_time_s)
        width, spread = shown.shape[1], extras.wander_pa * np.sqrt(1.0 - keep * keep)
        level = extras.wander_pa * random.standard_normal(width)
        for row in shown:
            row += level
            level = keep * level + spread * random.standard_normal(width)
    if not sensors.quantised:
        return shown
    step = robot.sensors.pressure_resolution_pa
    shown = np.rint(shown / step) * step
    return np.clip(shown, -robot.atmospheric_pressure_pa, robot.sensors.pressure_range_pa)
