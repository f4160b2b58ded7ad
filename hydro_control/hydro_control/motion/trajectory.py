"""Waypoints of a trajectory message to a path, and a path to waypoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hydro_control.errors import ControlError
from hydro_model.motion.paths import Path
from hydro_model.motion.paths_segments import Quintic, Sample, Segment
from hydro_model.robot import FloatArray

#: Spacing of waypoints where a segment is no polynomial: a quintic through exact position,
#: velocity and acceleration every 50 ms follows a 3 Hz chirp to 1e-5 of its amplitude.
WAYPOINT_STEP_S = 0.05
#: Largest position, velocity or acceleration of a point, in m or rad and s: more than any machine
#: reaches, and little enough for sums and squares to stay within the range of numbers.
LARGEST = 1e6


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A point of a trajectory.

    Attributes
    ----------
    time_s : float
        From the start.
    position, velocity, acceleration : (k,) array
        An empty velocity or acceleration means 0.
    """

    time_s: float
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


def segments_through(start: FloatArray, waypoints: Sequence[Waypoint]) -> tuple[Segment, ...]:
    """Quintics from rest at `start` through the waypoints to rest.

    Parameters
    ----------
    start : (k,) array
        Where the reference stands now; left out where the first waypoint is at time 0.
    waypoints : sequence of Waypoint

    Returns
    -------
    tuple of Segment

    Raises
    ------
    ControlError
        No waypoints, times that do not grow from 0 s, wrong sizes, values that are not finite or
        larger than `LARGEST`, or a velocity left at the end.
    """
    size = len(start)
    states = [_state(i, point, size) for i, point in enumerate(waypoints)]
    still = np.zeros(size)
    times = [point.time_s for point in waypoints]
    if not states or (len(states) == 1 and times[0] == 0.0):
        raise ControlError("a trajectory should have a point after time 0, found none")
    if times[0] < 0.0:  # a single point has no pair of times to look at
        raise ControlError(
            f"times of a trajectory should grow from 0 s, found {times[0]:g} s at point 0"
        )
    for index, (before, after) in enumerate(pairwise(times)):
        if not before < after:
            raise ControlError(
                f"times of a trajectory should grow from 0 s, found {after:g} s after"
                f" {before:g} s at point {index + 1}"
            )
    if times[0] > 0.0:
        states.insert(0, (start, still, still))
        times.insert(0, 0.0)
    for name, value in zip(("velocity", "acceleration"), states[-1][1:], strict=True):
        if np.any(value != 0.0):
            raise ControlError(f"a trajectory should end at rest, its last {name} is {value}")
    if np.any(states[0][1] != 0.0) or np.any(states[0][2] != 0.0):
        raise ControlError("a trajectory should start at rest")
    spans = np.diff(times).tolist()
    legs = zip(states[:-1], states[1:], spans, strict=True)
    return tuple(_leg(index, *leg) for index, leg in enumerate(legs))


def _leg(index: int, before: Sample, after: Sample, span_s: float) -> Segment:
    segment = Quintic.between(before, after, span_s)
    if not np.all(np.isfinite(segment.coefficients)):
        raise ControlError(f"leg {index + 1} of the trajectory is beyond the range of numbers")
    return segment


def _state(index: int, point: Waypoint, size: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    parts = []
    for name in ("position", "velocity", "acceleration"):
        value = np.asarray(getattr(point, name), dtype=float)
        if name != "position" and value.size == 0:
            value = np.zeros(size)
        if value.shape != (size,):
            raise ControlError(
                f"point {index} of the trajectory should have {size} values of {name},"
                f" found {value.size}"
            )
        if not np.all(np.isfinite(value)) or not np.isfinite(point.time_s):
            raise ControlError(f"point {index} of the trajectory has a {name} that is not finite")
        if not np.all(np.abs(value) <= LARGEST):
            raise ControlError(
                f"point {index} of the trajectory has a {name} of"
                f" {value[np.argmax(np.abs(value))]:.3g}, expected at most {LARGEST:g}"
            )
        parts.append(value)
    return parts[0], parts[1], parts[2]


def waypoints_of(path: Path) -> list[Waypoint]:
    """Waypoints that give a path back.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of Waypoint
        The first at time 0. Polynomial segments by their ends, others sampled.
    """
    times = [0.0]
    for begin, end, segment in zip(
        path.breaks_s[:-1], path.breaks_s[1:], path.segments, strict=True
    ):
        if begin > times[-1]:
            times.append(begin)
        pieces = 1 if segment.polynomial else max(1, round((end - begin) / WAYPOINT_STEP_S))
        times += np.linspace(begin, end, pieces + 1)[1:].tolist()
    return [Waypoint(t, *path.sample(t)) for t in times]
