"""Tip position, its Jacobian and the Jacobian's rate, in the base frame.

Joint vectors have shape (n,) or (N, n); the tip is `robot.tip_link`'s origin. For a revolute
joint with axis z through o the Jacobian's column is ``z x (p - o)``, for a prismatic one z.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from hydro_model.chain_arrays import chain_arrays, samples
from hydro_model.chain_kernels import SCRATCH, SHIFT, Array, place
from hydro_model.robot import FloatArray, Robot
from hydro_model.spatial import axis_rotation


def tip_position(robot: Robot, q: ArrayLike) -> FloatArray:
    """Position of the tip in the base frame.

    Parameters
    ----------
    robot : Robot
    q : (n,) or (N, n) array

    Returns
    -------
    (3,) or (N, 3) array
        m.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    position, _, _ = _evaluate(robot, q, None)
    return position


def tip_jacobian(robot: Robot, q: ArrayLike) -> FloatArray:
    """Jacobian J of the tip position, ``pdot = J(q) qd`` (eq. 19).

    Parameters
    ----------
    robot : Robot
    q : (n,) or (N, n) array

    Returns
    -------
    (3, n) or (N, 3, n) array
        m/rad, or 1 for prismatic joints.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    _, jacobian, _ = _evaluate(robot, q, None)
    return jacobian


def tip_jacobian_rate(robot: Robot, q: ArrayLike, qd: ArrayLike) -> FloatArray:
    """Time derivative of `tip_jacobian`, so that ``pddot = J qdd + Jdot qd``.

    Parameters
    ----------
    robot : Robot
    q, qd : (n,) or (N, n) array

    Returns
    -------
    (3, n) or (N, 3, n) array
        m/(rad s), or 1/s for prismatic joints.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    _, _, rate = _evaluate(robot, q, qd)
    return rate


def tip_state(
    robot: Robot, q: ArrayLike, qd: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, Jacobian and Jacobian's rate in one go, for the controller.

    Parameters
    ----------
    robot : Robot
    q, qd : (n,) or (N, n) array

    Returns
    -------
    (3,) or (N, 3) array
        `tip_position`.
    (3, n) or (N, 3, n) array
        `tip_jacobian`.
    (3, n) or (N, 3, n) array
        `tip_jacobian_rate`.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    return _evaluate(robot, q, qd)


def link_frames(robot: Robot, q: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Where the links stand: the frame of every joint's child link, in the base frame.

    Parameters
    ----------
    robot : Robot
    q : (n,) array

    Returns
    -------
    origins : (n, 3) array
        m.
    rotations : (n, 3, 3) array
        Axes of the frames in their columns.

    Raises
    ------
    RobotError
        A shape does not fit the robot.
    """
    (positions,), _ = samples(robot, np.asarray(q, dtype=float))
    origins, rotations = np.empty((robot.dof, 3)), np.empty((robot.dof, 3, 3))
    origin, turn = np.zeros(3), np.eye(3)
    for i, (joint, value) in enumerate(zip(robot.joints, positions[0], strict=True)):
        origin = origin + turn @ joint.translation_m
        turn = turn @ joint.rotation
        if joint.prismatic:
            origin = origin + turn @ joint.axis * value
        else:
            turn = turn @ axis_rotation(joint.axis, value)
        origins[i], rotations[i] = origin, turn
    return origins, rotations


def _evaluate(
    robot: Robot, q: ArrayLike, qd: ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    chain = chain_arrays(robot)
    (qs, qds), single = samples(robot, q, np.zeros(robot.dof) if qd is None else qd)
    count, n = qs.shape
    position, jacobian = np.empty((count, 3)), np.empty((count, 3, n))
    rate = np.empty((count, 3, n))
    _tips(qs, qds, *chain.frames, chain.tip_offset_m, position, jacobian, rate)
    return (position[0], jacobian[0], rate[0]) if single else (position, jacobian, rate)


@njit(cache=True, error_model="numpy")
def _cross(a: Array, b: Array, out: Array) -> None:
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    out[0], out[1] = x, y


@njit(cache=True, error_model="numpy")
def tip_kernel(
    q: Array,
    qd: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    tip_offset: Array,
    scratch: Array,
    position: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    """Tip position (3,), Jacobian (3, n) and its rate (3, n) for one sample.

    `scratch` is (n, SCRATCH). In it, per joint: axis, origin and origin velocity in the base
    frame, then the angular velocity of the child frame.

    Arguments as in `hydro_model.rigid_body_kernels`; `tip_offset` (3,) in the last joint's
    frame.
    """
    n = q.shape[0]
    place(q, rotation, translation, axis, prismatic, scratch)
    turn, origin = np.eye(3), np.zeros(3)
    omega, velocity, arm = np.zeros(3), np.zeros(3), np.zeros(3)
    turned = np.empty((3, 3))
    for i in range(n):
        s = scratch[i]
        for r in range(3):
            arm[r] = 0.0
            for c in range(3):
                arm[r] += turn[r, c] * s[SHIFT + c]
                turned[r, c] = 0.0
                for k in range(3):
                    turned[r, c] += turn[r, k] * s[3 * k + c]
        _cross(omega, arm, s[18:21])
        for r in range(3):
            origin[r] += arm[r]
            velocity[r] += s[18 + r]
            s[12 + r] = 0.0
            for c in range(3):
                turn[r, c] = turned[r, c]
                s[12 + r] += turned[r, c] * axis[i, c]
            if prismatic[i]:
                velocity[r] += s[12 + r] * qd[i]
            else:
                omega[r] += s[12 + r] * qd[i]
        for r in range(3):
            s[15 + r], s[18 + r], s[21 + r] = origin[r], velocity[r], omega[r]
    for r in range(3):
        arm[r] = (
            turn[r, 0] * tip_offset[0] + turn[r, 1] * tip_offset[1] + turn[r, 2] * tip_offset[2]
        )
        position[r] = origin[r] + arm[r]
    _cross(omega, arm, arm)
    for r in range(3):
        velocity[r] += arm[r]
    _columns(n, prismatic, scratch, position, velocity, jacobian, rate)


@njit(cache=True, error_model="numpy")
def _columns(
    n: int,
    prismatic: Array,
    scratch: Array,
    position: Array,
    velocity: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    """Columns of the Jacobian and of its rate from the frames in the working memory."""
    lever, slip = np.empty(3), np.empty(3)
    axis_rate, first, second = np.empty(3), np.empty(3), np.empty(3)
    for i in range(n):
        s = scratch[i]
        _cross(s[21:24], s[12:15], axis_rate)
        if prismatic[i]:
            for r in range(3):
                jacobian[r, i], rate[r, i] = s[12 + r], axis_rate[r]
            continue
        for r in range(3):
            lever[r] = position[r] - s[15 + r]
            slip[r] = velocity[r] - s[18 + r]
        _cross(axis_rate, lever, first)
        _cross(s[12:15], slip, second)
        for r in range(3):
            rate[r, i] = first[r] + second[r]
        _cross(s[12:15], lever, first)
        for r in range(3):
            jacobian[r, i] = first[r]


@njit(cache=True, error_model="numpy")
def _tips(
    q: Array,
    qd: Array,
    rotation: Array,
    translation: Array,
    axis: Array,
    prismatic: Array,
    tip_offset: Array,
    position: Array,
    jacobian: Array,
    rate: Array,
) -> None:
    scratch = np.empty((q.shape[1], SCRATCH))
    for k in range(q.shape[0]):
        tip_kernel(
            q[k],
            qd[k],
            rotation,
            translation,
            axis,
            prismatic,
            tip_offset,
            scratch,
            position[k],
            jacobian[k],
            rate[k],
        )
