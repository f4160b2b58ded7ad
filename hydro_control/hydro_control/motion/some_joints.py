"""Paths of some joints as paths of all, the others at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro_control.errors import ControlError
from hydro_model.errors import RobotError
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_segments import Quintic, Segment
from hydro_model.robot import FloatArray, Robot


@dataclass(frozen=True, slots=True)
class _Spread:
    """A segment of some joints as one of all, the others at rest."""

    segment: Segment
    base: FloatArray
    columns: tuple[int, ...]
    duration_s: float
    polynomial: bool

    def sample(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration of all joints at `t`."""
        return self._of_all(self.segment.sample(t))

    def sample_many(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration of all joints at N times, (N, n) each."""
        return self._of_all(self.segment.sample_many(times_s))

    def _of_all(
        self, parts: tuple[FloatArray, FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        shape, columns = (*parts[0].shape[:-1], len(self.base)), list(self.columns)
        whole = (np.zeros(shape) + self.base, np.zeros(shape), np.zeros(shape))
        for target, part in zip(whole, parts, strict=True):
            target[..., columns] = part
        return whole


def _of_all_joints(segment: Segment, base: FloatArray, columns: tuple[int, ...]) -> Segment:
    """A segment of some joints as one of all; a quintic stays one, which is quick to check."""
    if not isinstance(segment, Quintic):
        return _Spread(segment, base, columns, segment.duration_s, segment.polynomial)
    coefficients = np.zeros((len(segment.coefficients), len(base)))
    coefficients[0] = base
    coefficients[:, list(columns)] = segment.coefficients
    return Quintic(coefficients, segment.duration_s, segment.polynomial)


def for_all_joints(
    robot: Robot, path: JointPath, at: FloatArray
) -> tuple[tuple[Segment, ...], FloatArray]:
    """Segments of all joints in the robot's order, and their first position.

    Parameters
    ----------
    robot : Robot
    path : JointPath
    at : (n,) array
        Where the joints stay that the path does not name, rad or m.

    Returns
    -------
    segments : tuple of Segment
    first : (n,) array

    Raises
    ------
    ControlError
        A joint is not the robot's.
    """
    try:
        columns = tuple(robot.joint_index(name) for name in path.joints)
    except RobotError as error:
        raise ControlError(str(error)) from error
    base = np.array(at, dtype=float)
    segments = tuple(_of_all_joints(segment, base, columns) for segment in path.segments)
    whole = replace(path, segments=segments, start_delay_s=0.0)
    return segments, whole.sample(0.0)[0]
