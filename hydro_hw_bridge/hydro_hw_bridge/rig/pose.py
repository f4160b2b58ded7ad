"""Initial poses: joint positions for a tip position, by damped least squares."""

from __future__ import annotations

import itertools

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_model.robot import FloatArray, Robot

TOLERANCE_M = 1.0e-10
STARTS_PER_JOINT = (0.5, 0.2, 0.8)
MAX_STARTS = 81
#: A joint without an end is looked for, and begins, within half a turn, or this many metres.
ENDLESS_M = 1.0


def middle_pose(robot: Robot) -> FloatArray:
    """The middle of every joint's range, (n,), rad or m; 0 of one without an end.

    Parameters
    ----------
    robot : Robot
    """
    lower, upper = _ranges(robot)
    return np.asarray(0.5 * (lower + upper))


def tip_frame(robot: Robot, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Tip position (3,) in the base frame and its Jacobian (3, n) at joint positions q (n,)."""
    rotation, origin = np.eye(3), np.zeros(3)
    axes, origins = [], []
    for joint, value in zip(robot.joints, q, strict=True):
        origin = origin + rotation @ joint.translation_m
        rotation = rotation @ joint.rotation
        axis = rotation @ joint.axis
        if joint.prismatic:
            origin = origin + axis * value
        else:
            cross = np.cross(np.eye(3), joint.axis)
            rotation = rotation @ (
                np.eye(3) + np.sin(value) * cross + (1.0 - np.cos(value)) * cross @ cross
            )
        axes.append(axis)
        origins.append(origin)
    tip = origin + rotation @ robot.tip_offset_m
    columns = [
        axis if joint.prismatic else np.cross(axis, tip - at)
        for joint, axis, at in zip(robot.joints, axes, origins, strict=True)
    ]
    return tip, np.array(columns).T


def joints_for_tip(robot: Robot, tip_m: FloatArray) -> FloatArray:
    """Joint positions within their limits that put the tip at a point.

    Parameters
    ----------
    robot : Robot
    tip_m : (3,) array
        In the base frame.

    Returns
    -------
    (n,) array

    Raises
    ------
    BridgeError
        No pose within the joint limits reaches it.
    """
    lower, upper = _ranges(robot)
    starts = itertools.product(STARTS_PER_JOINT, repeat=robot.dof)
    closest = np.inf
    for shares in itertools.islice(starts, MAX_STARTS):
        q, miss = _descend(robot, tip_m, lower + np.array(shares) * (upper - lower))
        inside = bool(np.all(q >= lower - 1e-9) and np.all(q <= upper + 1e-9))
        if miss < TOLERANCE_M and inside:
            return np.clip(q, lower, upper)
        if inside:
            closest = min(closest, miss)
    far = f"closest pose misses by {closest:.3f} m" if np.isfinite(closest) else "none comes near"
    raise BridgeError(
        f"robot {robot.name}: no pose within the joint limits puts the tip at"
        f" {np.array2string(np.asarray(tip_m), precision=3)} m ({far})"
    )


def _ranges(robot: Robot) -> tuple[FloatArray, FloatArray]:
    """Lower and upper end of every joint, finite, (n,) each, rad or m."""
    reach = np.array([ENDLESS_M if j.prismatic else np.pi for j in robot.joints])
    lower = np.array([j.lower for j in robot.joints])
    upper = np.array([j.upper for j in robot.joints])
    return np.where(np.isfinite(lower), lower, -reach), np.where(np.isfinite(upper), upper, reach)


def _descend(robot: Robot, target: FloatArray, q: FloatArray) -> tuple[FloatArray, float]:
    damping = 1.0e-2
    tip, jacobian = tip_frame(robot, q)
    miss = float(np.linalg.norm(target - tip))
    for _ in range(200):
        if miss < TOLERANCE_M:
            break
        square = jacobian.T @ jacobian + damping * np.eye(robot.dof)
        trial = q + np.linalg.solve(square, jacobian.T @ (target - tip))
        trial_tip, trial_jacobian = tip_frame(robot, trial)
        trial_miss = float(np.linalg.norm(target - trial_tip))
        if trial_miss < miss:
            q, tip, jacobian, miss = trial, trial_tip, trial_jacobian, trial_miss
            damping = max(damping * 0.1, 1.0e-14)
        else:
            damping *= 10.0
            if damping > 1.0e6:
                break
    # Whole turns more or less are the same pose.
    turns = [0.0 if j.prismatic else 2.0 * np.pi for j in robot.joints]
    middle = middle_pose(robot)
    wrapped = [
        v if turn == 0.0 else v - turn * np.rint((v - mid) / turn)
        for v, turn, mid in zip(q, turns, middle, strict=True)
    ]
    return np.array(wrapped), miss
