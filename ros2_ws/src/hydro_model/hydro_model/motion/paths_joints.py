"""Joint motion along a path: the poses that put the tip where the path has it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from hydro_model.errors import RobotError
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.motion.paths_segments import Sample
from hydro_model.motion.row_pieces import always
from hydro_model.multibody.joint_ranges import limits, middle
from hydro_model.multibody.kinematics import tip_position, tip_state
from hydro_model.robot import FloatArray, Robot

#: The tip counts as reached within this distance.
REACH_TOLERANCE_M = 1e-6
_RCOND = 1e-6
_ITERATIONS = 60
_LONGEST_STEP = 0.3


def joints_at_tip(robot: Robot, tip_m: FloatArray, near: FloatArray | None = None) -> FloatArray:
    """Joint positions that put the tip somewhere: numeric inverse kinematics.

    Parameters
    ----------
    robot : Robot
    tip_m : (3,) array
        In the base frame.
    near : (n,) array, optional
        Where to start looking; the solution is of that branch. Without it several starts
        spread over the joints' ranges are tried, and the solution lies inside the limits.

    Returns
    -------
    (n,) array

    Raises
    ------
    RobotError
        No pose reaches it; the message says how near the tip came.
    """
    starts: Iterator[FloatArray] | list[FloatArray]
    starts = _starts(robot) if near is None else [np.asarray(near, dtype=float)]
    best = np.inf
    for start in starts:
        q, miss = _newton(robot, np.asarray(tip_m, dtype=float), start)
        best = min(best, miss)
        if miss <= REACH_TOLERANCE_M and (near is not None or _inside(robot, q)):
            return q
    why = f"the nearest try missed by {best:.3f} m"
    if best <= REACH_TOLERANCE_M:
        why = "only poses outside its joint limits reach it"
    place = ", ".join(f"{v:.3f}" for v in tip_m)
    raise RobotError(f"robot {robot.name} cannot put its tip at [{place}] m: {why}")


def _starts(robot: Robot) -> Iterator[FloatArray]:
    lower, upper = limits(robot).T
    shares = (0.5, 0.2, 0.8) if robot.dof <= 4 else (0.3, 0.7)
    for share in product(shares, repeat=robot.dof):
        yield lower + np.array(share) * (upper - lower)


def _inside(robot: Robot, q: FloatArray) -> bool:
    return all(j.lower <= x <= j.upper for j, x in zip(robot.joints, q, strict=True))


def _newton(robot: Robot, tip: FloatArray, q: FloatArray) -> tuple[FloatArray, float]:
    """Newton's method with limited steps; the position and the distance left."""
    still = np.zeros_like(q)
    for _ in range(_ITERATIONS):
        position, jacobian, _rate = tip_state(robot, q, still)
        error = tip - position
        if np.linalg.norm(error) <= 0.01 * REACH_TOLERANCE_M:
            break
        step = np.linalg.pinv(jacobian, rcond=_RCOND) @ error
        longest = float(np.max(np.abs(step)))
        if longest == 0.0:
            break
        q = q + step * min(1.0, _LONGEST_STEP / longest)
    return q, float(np.linalg.norm(tip - tip_position(robot, q)))


def joint_motion(
    robot: Robot,
    path: TipPath | JointPath,
    times_s: FloatArray,
    near: FloatArray | None = None,
    go_on: Callable[[], None] = always,
) -> Sample:
    """Joint position, velocity and acceleration along a path.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    times_s : (N,) array
        Ascending, close enough together for the inverse kinematics to stay on its branch.
    near : (n,) array, optional
        Joint positions at the start: branch of the inverse kinematics, and where joints stay
        that the path does not name (by default the middle of their range).
    go_on : callable
        Called at every time of a path of the tip, which takes some tenths of a millisecond each:
        what it raises ends the work.

    Returns
    -------
    q, qd, qdd : (N, n) array

    Raises
    ------
    RobotError
        A joint is unknown, the path is of another tip, or a tip position cannot be reached.
    """
    if isinstance(path, JointPath):
        return _spread(robot, path, path.sample_many(times_s), near)
    if path.tip_link != robot.tip_link:
        raise RobotError(
            f"the path is of '{path.tip_link}', the tip of robot {robot.name} is"
            f" '{robot.tip_link}'"
        )
    rows = []
    q = joints_at_tip(robot, path.sample(float(times_s[0]))[0], near)
    for t in times_s:
        go_on()
        position, velocity, acceleration = path.sample(float(t))
        q = joints_at_tip(robot, position, q)
        _, jacobian, _ = tip_state(robot, q, np.zeros_like(q))
        inverse = np.linalg.pinv(jacobian, rcond=_RCOND)
        qd = inverse @ velocity
        _, _, rate = tip_state(robot, q, qd)
        rows.append((q, qd, inverse @ (acceleration - rate @ qd)))
    positions, velocities, accelerations = zip(*rows, strict=True)
    return np.array(positions), np.array(velocities), np.array(accelerations)


def _spread(robot: Robot, path: JointPath, sample: Sample, near: FloatArray | None) -> Sample:
    """The samples of some joints in columns of all, the others at rest."""
    columns = [robot.joint_index(name) for name in path.joints]
    shape = (len(sample[0]), robot.dof)
    q = np.tile(middle(robot) if near is None else np.asarray(near, dtype=float), (shape[0], 1))
    qd, qdd = np.zeros(shape), np.zeros(shape)
    q[:, columns], qd[:, columns], qdd[:, columns] = sample
    return q, qd, qdd
