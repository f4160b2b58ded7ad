"""Encoders, pressure transducers and spool sensors: the truth as a device reports it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from hydro_hw_bridge.rig.extras import SensorExtras
from hydro_hw_bridge.rig.plant import Plant
from hydro_model.robot import FloatArray, Robot

SPOOL_RESOLUTION = 1.0e-4
STROKE_RESOLUTION_M = 1.0e-6


@dataclass(frozen=True, slots=True)
class Measurement:
    """One cycle of all instruments.

    Attributes
    ----------
    encoder_counts : tuple of int
        Per joint. A prismatic joint has as many counts per metre
        as a revolute one has per turn.
    positions : tuple of float
        The same in rad or m.
    strokes_m : tuple of float
        Per cylinder that has a stroke sensor.
    pressures_pa : tuple of float
        Gauge, by `Robot.pressure_names`.
    spools : tuple of float
        Per valve, in [-1, 1].
    oil_temperature_c : float
    """

    encoder_counts: tuple[int, ...]
    positions: tuple[float, ...]
    strokes_m: tuple[float, ...]
    pressures_pa: tuple[float, ...]
    spools: tuple[float, ...]
    oil_temperature_c: float


class Instruments:
    """Reads a plant with noise from one generator, a fixed number of draws per cycle.

    Parameters
    ----------
    plant : Plant
    seed : int
        The same seed gives the same noise, cycle by cycle, on any machine.
    """

    def __init__(self, plant: Plant, seed: int) -> None:
        robot, sensors = plant.robot, plant.truth.sensors
        self._plant = plant
        self._random = np.random.default_rng(seed)
        self._sensors = sensors
        self._count = np.array([_count(robot, j.prismatic) for j in robot.joints])
        self._offset = np.array([sensors.encoder_offset.get(n, 0.0) for n in robot.joint_names])
        self._bias = np.array([sensors.pressure_bias_pa.get(n, 0.0) for n in robot.pressure_names])
        self._extras = plant.truth.extras.sensors
        self._history: deque[FloatArray] = deque(maxlen=_depth(robot, self._extras))
        self._cycle_s, self._cycles = 1.0 / robot.sensors.rate_hz, 0
        self._wander = np.zeros(len(self._bias))
        names = [c.name for c in robot.cylinders]
        self._valve_cylinder = [names.index(v.cylinder) for v in robot.valves]
        self._measured = [i for i, c in enumerate(robot.cylinders) if c.stroke_sensor]

    def measure(self, *, depressurised: bool) -> Measurement:
        """Sample everything once.

        Parameters
        ----------
        depressurised : bool
            The pump is off and the oil of the standing machine has drained: every true pressure
            is atmospheric.
        """
        plant, sensors = self._plant, self._sensors
        n, m = plant.robot.dof, len(plant.robot.cylinders)
        noise = self._random.standard_normal(n + len(self._bias) + 2 * m)
        position = plant.q + self._offset + noise[:n] * sensors.encoder_noise_counts * self._count
        pressure = np.zeros(len(self._bias)) if depressurised else self._true_pressures()
        if self._extras.any:
            position, pressure = self._with_extras(position, pressure)
        pressure = pressure + self._bias
        pressure += sensors.pressure_noise_pa * noise[n : n + len(self._bias)]
        spool = plant.spools + sensors.spool_noise * noise[-m:] if m else plant.spools
        stroke = (
            plant.strokes()
            + STROKE_RESOLUTION_M * sensors.encoder_noise_counts * noise[-2 * m :][:m]
        )
        counts = np.rint(position / self._count)
        if sensors.quantised:
            position = counts * self._count
            limit = plant.robot.sensors.pressure_range_pa
            pressure = _rounded(pressure, plant.robot.sensors.pressure_resolution_pa)
            pressure = np.clip(pressure, -plant.robot.atmospheric_pressure_pa, limit)
            spool = _rounded(spool, SPOOL_RESOLUTION)
            stroke = _rounded(stroke, STROKE_RESOLUTION_M)
        return Measurement(
            encoder_counts=tuple(int(c) for c in counts),
            positions=tuple(position.tolist()),
            strokes_m=tuple(float(stroke[i]) for i in self._measured),
            pressures_pa=tuple(pressure.tolist()),
            spools=tuple(float(spool[i]) for i in self._valve_cylinder),
            oil_temperature_c=sensors.oil_temperature_c,
        )

    def _with_extras(
        self, position: FloatArray, pressure: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Encoders off their centres; transducers late, off in span, and humming."""
        extras, robot = self._extras, self._plant.robot
        swing = [extras.encoder_swing.get(n, 0.0) for n in robot.joint_names]
        turns = [extras.encoder_swing_count.get(n, 0.0) for n in robot.joint_names]
        position = position + np.array(swing) * np.sin(np.array(turns) * self._plant.q)
        self._history.append(pressure)
        past = np.array(self._history)
        age = self._cycle_s * np.arange(1 - len(past), 1)
        shown = np.empty_like(pressure)
        for k, name in enumerate(robot.pressure_names):
            late = np.interp(-extras.pressure_delay_s.get(name, 0.0), age, past[:, k])
            turn = 2.0 * np.pi * extras.hum_hz.get(name, 0.0) * self._cycle_s * self._cycles
            hum = extras.hum_pa.get(name, 0.0) * np.sin(turn)
            shown[k] = late * (1.0 + extras.pressure_gain.get(name, 0.0)) + hum
        self._cycles += 1
        if extras.wander_pa > 0.0:
            keep = np.exp(-self._cycle_s / extras.wander_time_s)
            fresh = self._random.standard_normal(len(shown))
            self._wander = keep * self._wander
            self._wander += extras.wander_pa * np.sqrt(1.0 - keep * keep) * fresh
        return position, shown + self._wander

    def _true_pressures(self) -> FloatArray:
        plant = self._plant
        chambers = np.column_stack([plant.pressures_a, plant.pressures_b]).ravel()
        return np.concatenate([chambers, [plant.supply_pa, plant.tank_pa]])


def _depth(robot: Robot, extras: SensorExtras) -> int:
    """Cycles of pressures to remember for the oldest reading."""
    oldest = max(extras.pressure_delay_s.values(), default=0.0)
    return int(np.ceil(oldest * robot.sensors.rate_hz)) + 2


def _count(robot: Robot, prismatic: bool) -> float:
    """Size of an encoder count, rad or m."""
    return (1.0 if prismatic else 2.0 * np.pi) / robot.sensors.encoder_counts_per_rev


def _rounded(values: FloatArray, resolution: float) -> FloatArray:
    return np.asarray(np.rint(values / resolution) * resolution)
