"""Sensors that read the same throughout while their joint moves: nothing was measured there.

Many drivers fill `effort` with zeros, and a transducer that is not connected stands at an end of
its scale. The noise of such a reading is none, so that its equations would outweigh all others.
That holds of a parked joint's `effort`, too: what moves beside it changes its torque. A chamber's
pressure that stands still in between may be so: of a cylinder whose other side drives it, vented
or under a constant counter-pressure. `health` tells it all the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from hydro_ident.bag.recorded_run import Recording
from hydro_model.arrays import BoolArray, FloatArray
from hydro_model.multibody.joint_ranges import limits
from hydro_model.robot import Robot

#: A joint that goes through this share of its range changes what gravity and friction ask for by
#: far more than a torque's or a pressure's resolution.
_MOVES = 0.01


@dataclass(slots=True)
class SensorSpans:
    """What tells sensors of force apart from dead ones, of cycles that come stretch by stretch.

    Parameters
    ----------
    robot : Robot
    """

    robot: Robot
    _first: dict[str, float] = field(default_factory=dict)
    _spans: dict[str, tuple[float, float]] = field(default_factory=dict)
    #: From where to where every joint was while a sensor was read, (2, n).
    _travels: dict[str, FloatArray] = field(default_factory=dict)

    def add(self, recording: Recording) -> None:
        """Take in the next cycles."""
        for name, kind, column, _ in _sensors(recording):
            values = getattr(recording, kind)[:, column]
            there = np.isfinite(values)
            if not there.any():
                continue
            values, q = values[there], recording.q[there]
            self._first.setdefault(name, float(values[0]))
            least, most = self._spans.get(name, (np.inf, -np.inf))
            self._spans[name] = min(least, float(values.min())), max(most, float(values.max()))
            before = self._travels.get(name, np.full((2, q.shape[1]), np.nan))
            # Of positions that are not known nothing is told.
            low, high = np.fmin.reduce(q, axis=0), np.fmax.reduce(q, axis=0)
            self._travels[name] = np.stack([np.fmin(before[0], low), np.fmax(before[1], high)])

    def dead(self, known: Mapping[str, float] = MappingProxyType({})) -> dict[str, float]:
        """Sensors that are dead in these cycles, and their readings.

        Parameters
        ----------
        known : mapping of str to float
            As of `without_dead`.

        Returns
        -------
        dict of str to float
        """
        dead = {}
        for name, kind, _, joint in _every_sensor(self.robot):
            reading = self._first.get(name)
            if reading is None or self._spans[name][1] > self._spans[name][0]:
                continue
            if kind != "effort" and not _at_an_end(self.robot, reading):
                continue
            moved = self._moved(name)
            if known.get(name) == reading or (moved.any() if kind == "effort" else moved[joint]):
                dead[name] = reading
        return dead

    def _moved(self, name: str) -> BoolArray:
        """Which joints went somewhere while a sensor was read."""
        low, high = self._travels[name]
        lower, upper = limits(self.robot).T
        # What is nowhere known did not go anywhere.
        return np.asarray(high - low > _MOVES * (upper - lower))


def without_dead(recording: Recording, known: Mapping[str, float]) -> Recording:
    """A recording in which the readings of dead sensors are missing.

    Parameters
    ----------
    recording : Recording
    known : mapping of str to float
        Sensors that were found dead in earlier pieces, and their readings: a sensor that still
        reads so is dead although its joint stands still now.

    Returns
    -------
    Recording
        With the columns NaN, None where no other column of a field has a reading, and with what
        is dead in `dead`.
    """
    spans = SensorSpans(recording.robot)
    spans.add(recording)
    dead, fields = spans.dead(known), dict[str, FloatArray]()
    for name, kind, column, _ in _sensors(recording):
        if name in dead:
            fields.setdefault(kind, getattr(recording, kind).copy())[:, column] = np.nan
    left: dict[str, Any] = {
        f: None if np.isnan(values).all() else values for f, values in fields.items()
    }
    changed: Recording = replace(recording, dead={**known, **dead}, **left)
    return changed


def _sensors(recording: Recording) -> Iterator[tuple[str, str, int, int]]:
    """Name, field and column of every sensor of force that was recorded, and its joint."""
    for sensor in _every_sensor(recording.robot):
        if getattr(recording, sensor[1]) is not None:
            yield sensor


def _every_sensor(robot: Robot) -> Iterator[tuple[str, str, int, int]]:
    """Name, field and column of every sensor of force, and the joint that changes it."""
    for i, joint in enumerate(robot.joint_names):
        yield f"{joint} effort", "effort", i, i
    for side in "ab":
        for i, cylinder in enumerate(robot.cylinders):
            yield f"{cylinder.name}/{side}", f"p_{side}", i, robot.joint_index(cylinder.joint)


def _at_an_end(robot: Robot, gauge_pa: float) -> bool:
    """Whether a pressure is none, or all that its transducer can show."""
    nothing = gauge_pa + robot.atmospheric_pressure_pa <= 0.0
    return nothing or gauge_pa >= robot.sensors.pressure_range_pa
