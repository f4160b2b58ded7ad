"""Tip position, its Jacobian and the Jacobian's rate, in the base frame.

Joint vectors have shape (n,) or (N, n); the tip is `robot.tip_link`'s origin. For a revolute
joint with axis z through o the Jacobian's column is ``z x (p - o)``, for a prismatic one z.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from hydro_model.errors import RobotError
from hydro_model.multibody.chain_arrays import chain_arrays, samples
from hydro_model.multibody.chain_kernels import SCRATCH, SHIFT, Array, place
from hydro_model.multibody.spatial import axis_rotation
from hydro_model.numerics.kernel import inlined, kernel
from hydro_model.numerics.triple_kernels import Triple, cross, dot, plus, to_child, triple
from hydro_model.robot import FloatArray, Robot

# Columns of the working memory behind a joint's place: its axis, origin and origin velocity in the
# base frame, and the angular velocity of the child frame.
_AXIS, _ORIGIN, _ORIGIN_RATE, _OMEGA = 12, 15, 18, 21


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


class TipPlace:
    """`tip_position` of one pose after the other, in memory of its own.

    Without what stacks of poses need it takes a third of the time, which counts in every cycle
    of a controller.

    Parameters
    ----------
    robot : Robot
    """

    def __init__(self, robot: Robot) -> None:
        chain, n = chain_arrays(robot), robot.dof
        self._name, self._chain = robot.name, (*chain.frames, chain.tip_offset_m)
        self._still, self._place = np.zeros(n), np.empty(3)
        self._work = np.empty((n, SCRATCH)), self._place, np.empty((3, n)), np.empty((3, n))

    def at(self, q: FloatArray) -> list[float]:
        """Position of the tip in the base frame.

        Parameters
        ----------
        q : (n,) array

        Returns
        -------
        list of float
            Three, m.

        Raises
        ------
        RobotError
            The shape does not fit the robot.
        """
        if q.shape != self._still.shape:  # kernels do not look at bounds
            raise RobotError(
                f"robot {self._name}: expected joint positions of shape {self._still.shape},"
                f" found {q.shape}"
            )
        tip_kernel(np.array(q, dtype=np.float64), self._still, *self._chain, *self._work)
        place: list[float] = self._place.tolist()
        return place


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


@kernel
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

    `scratch` is (n, SCRATCH), working memory.

    Arguments as in `hydro_model.multibody.rigid_body_kernels`; `tip_offset` (3,) in the last
    joint's frame.
    """
    place(q, rotation, translation, axis, prismatic, scratch)
    # Rows of the rotation from the frame reached so far to the base.
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    origin, velocity, omega = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(q.shape[0]):
        shift = triple(scratch, i, SHIFT)
        arm = (dot(x, shift), dot(y, shift), dot(z, shift))
        origin, velocity = plus(origin, 1.0, arm), plus(velocity, 1.0, cross(omega, arm))
        x, y, z = to_child(scratch, i, x), to_child(scratch, i, y), to_child(scratch, i, z)
        along = triple(axis, i, 0)
        turned = (dot(x, along), dot(y, along), dot(z, along))
        if prismatic[i]:
            velocity = plus(velocity, qd[i], turned)
        else:
            omega = plus(omega, qd[i], turned)
        _put(scratch, i, _AXIS, turned)
        _put(scratch, i, _ORIGIN, origin)
        _put(scratch, i, _ORIGIN_RATE, velocity)
        _put(scratch, i, _OMEGA, omega)
    offset = (tip_offset[0], tip_offset[1], tip_offset[2])
    arm = (dot(x, offset), dot(y, offset), dot(z, offset))
    tip, tip_rate = plus(origin, 1.0, arm), plus(velocity, 1.0, cross(omega, arm))
    position[0], position[1], position[2] = tip
    for i in range(q.shape[0]):
        _column(prismatic[i], scratch, i, tip, tip_rate, jacobian, rate)


@inlined
def _put(scratch: Array, row: int, column: int, a: Triple) -> None:
    scratch[row, column], scratch[row, column + 1], scratch[row, column + 2] = a


@kernel
def _column(
    prismatic: bool,
    scratch: Array,
    i: int,
    tip: Triple,
    tip_rate: Triple,
    jacobian: Array,
    rate: Array,
) -> None:
    """Column of the Jacobian and of its rate from the frames in the working memory."""
    axis = triple(scratch, i, _AXIS)
    axis_rate = cross(triple(scratch, i, _OMEGA), axis)
    column, slope = axis, axis_rate
    if not prismatic:
        lever = plus(tip, -1.0, triple(scratch, i, _ORIGIN))
        slip = plus(tip_rate, -1.0, triple(scratch, i, _ORIGIN_RATE))
        column = cross(axis, lever)
        slope = plus(cross(axis_rate, lever), 1.0, cross(axis, slip))
    jacobian[0, i], jacobian[1, i], jacobian[2, i] = column
    rate[0, i], rate[1, i], rate[2, i] = slope


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
