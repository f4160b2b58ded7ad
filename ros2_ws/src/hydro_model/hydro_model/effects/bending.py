"""A link that bends: how much of its load swings, and what that does along a recording.

A recording tells the whole load of a joint: what hangs on a hinge is moved by gravity and by other
joints, too, weighs on all joints before it, and makes the mode slower where it is stretched out.
Roll-outs have the same equations in `hydro_model.simulation.hinge_kernels`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hydro_model.errors import RobotError
from hydro_model.multibody.joint_ranges import middle
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.numerics.kernel import kernel
from hydro_model.robot import FloatArray, Robot

Array = Any  # numba types the kernels; mypy follows no numba import

#: Parts of a radian that a mode turns through per step at most.
_TURN = 0.1
#: Step of the torques' derivatives, rad and rad/s (m and m/s on a prismatic joint).
_STEP = 1.0e-4
#: Deflection beyond which nothing is followed, rad (m on a prismatic joint): a trial may buckle.
LARGEST = 1.0
#: Least of a mode's inertia that is on its spring in any pose.
_LEAST_ON_SPRING = 0.02
#: How far from one the cosine between axes may be that count as parallel.
_PARALLEL = 1.0e-6


class KnownTorques(Protocol):
    """What all joints' torques gain by what a recording tells of a joint's load, (N, n)."""

    def __call__(
        self,
        load: Load,
        parameters: FloatArray,
        step_s: float,
        begun: tuple[float, float] = (0.0, 0.0),
        /,
    ) -> FloatArray:
        """As `bent` has them."""


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """What a joint carries along a recording, as the robot's rigid bodies tell; N samples.

    Of k joints: the one that a link bends at, and the next one out where it turns about the same
    axis (`next_parallel`). A link that bends between the two turns both.

    Attributes
    ----------
    joint : int
    acceleration : (N,) array
        Of the joint, rad/s^2.
    torque : (N, k) array
        At the k joints, gravity included, N m.
    columns : (N, n, k) array
        Torques at all joints per acceleration of each of the k, kg m^2.
    by_position, by_velocity : (N, n, k) array
        Slopes of all joints' torques in position and velocity of each of the k.
    usual : (k, k) array
        Inertia about the k with all joints in the middle of their ranges (at 0 where they turn
        without end), kg m^2.
    """

    joint: int
    acceleration: FloatArray
    torque: FloatArray
    columns: FloatArray
    by_position: FloatArray
    by_velocity: FloatArray
    usual: FloatArray

    @staticmethod
    def of(robot: Robot, joint: int, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> Load:
        """The load of a joint over a motion.

        Parameters
        ----------
        robot : Robot
        joint : int
        q, qd, qdd : (N, n) array

        Returns
        -------
        Load

        Raises
        ------
        RobotError
            A shape does not fit the robot.
        """
        own = [joint] if next_parallel(robot, joint) < 0 else [joint, joint + 1]
        slopes = [
            [
                inverse_dynamics(robot, q + step, qd, qdd)
                - inverse_dynamics(robot, q - step, qd, qdd),
                inverse_dynamics(robot, q, qd + step, qdd)
                - inverse_dynamics(robot, q, qd - step, qdd),
            ]
            for step in _STEP * np.eye(robot.dof)[own]
        ]
        by_position, by_velocity = np.moveaxis(np.array(slopes), 0, -1) / (2.0 * _STEP)
        return Load(
            joint=joint,
            acceleration=qdd[:, joint],
            torque=inverse_dynamics(robot, q, qd, qdd)[:, own],
            columns=mass_matrix(robot, q)[:, :, own],
            by_position=by_position,
            by_velocity=by_velocity,
            usual=mass_matrix(robot, middle(robot))[np.ix_(own, own)],
        )


def next_parallel(robot: Robot, joint: int) -> int:
    """The next joint outwards if it and this one turn about parallel axes, else -1.

    Parameters
    ----------
    robot : Robot
    joint : int
    """
    own, after = robot.joints[joint], robot.joints[joint + 1 : joint + 2]
    if own.prismatic or not after or after[0].prismatic:
        return -1
    same = float(own.axis @ (after[0].rotation @ after[0].axis)) > 1.0 - _PARALLEL
    return joint + 1 if same else -1


def usual_inertia(robot: Robot, joint: int, place: float = 0.0) -> float:
    """Inertia that a deflection moves with all joints in the middle of their ranges, kg m^2.

    Parameters
    ----------
    robot : Robot
    joint : int
    place : float
        Where along the link it bends.
    """
    mass, shape = mass_matrix(robot, middle(robot)), np.zeros(robot.dof)
    shape[joint] = 1.0
    if next_parallel(robot, joint) >= 0:
        shape[joint : joint + 2] = 1.0 - place, place
    return float(shape @ mass @ shape)


@kernel
def on_spring(inertia: Any, share: Any, mass: Any, usual: Any) -> Any:
    """Inertia that swings on the spring in a pose, kg m^2; numbers, or arrays by ``py_func``.

    Parameters
    ----------
    inertia : float
    share : float
        h of `bent`.
    mass : float or (N,) array
        What the deflection moves, ``s^T M s``, in that pose.
    usual : float
        The same with all joints in the middle of their ranges.
    """
    return np.maximum(inertia + share * (mass - usual), _LEAST_ON_SPRING * inertia)


def bears(load: Load, parameters: FloatArray) -> bool:
    """Whether a mode has links with inertia to carry, or carries none.

    Parameters
    ----------
    load : Load
    parameters : (5,) array
        As of `bent`.
    """
    shape = _shape(load, parameters)
    return not (parameters[0] > 0.0 and parameters[3] > 0.0) or bool(
        shape @ load.usual @ shape > 0.0
    )


def _shape(load: Load, parameters: FloatArray) -> FloatArray:
    """How far a deflection moves its own joint's links and the next one's, s of `bent`."""
    place = parameters[4] if parameters[3] > 0.0 else 0.0
    return np.array([1.0 - place, place]) if load.usual.shape[0] > 1 else np.ones(1)


def bent(
    load: Load, parameters: FloatArray, step_s: float, begun: tuple[float, float] = (0.0, 0.0)
) -> FloatArray:
    """Torques that a mode takes beyond the rigid links, (N, n).

    A deflection e at the share d of the way to the next joint moves the links by ``h s e``, with
    ``s`` 1 - d at its own joint and d at the next one, and a further inertia r by
    ``e / (1 - d)`` more than its own joint. With the mass matrix M, the joints' torques T and
    ``mu = s^T M s``, U with the joints in the middle of their ranges:

    ``(h mu + r) e'' = -J W^2 e - 2 zeta W J e' - h s^T T - r qdd_i / (1 - d)``

    with ``h = c J / U`` and ``r = J - h U``. It takes ``h M s e''`` and h times what the torques T
    change by e and e', and at its own joint ``r e'' / (1 - d)``.

    Nothing of what is carried (c = 0) leaves a mode that its joint's own acceleration alone sets
    going. A hinge between the joint and all but H of the inertia has J = U - H and c = U / J
    (h = 1, r = -H: the hub does not swing).

    Parameters
    ----------
    load : Load
    parameters : (5,) array
        J in kg m^2, W / 2 pi in Hz, zeta, c, d.
    step_s : float
        Sampling interval.
    begun : tuple of float
        Deflection beyond where it rests, and its rate, at the first sample, rad and rad/s: of a
        recording that begins while the mode swings.

    Returns
    -------
    (N, n) array

    Raises
    ------
    RobotError
        Something is carried (c > 0) and the robot's links have no inertia about the joint.
    """
    inertia, frequency, damping, carried = parameters[:4]
    if inertia <= 0.0:
        return np.zeros(load.columns.shape[:2])
    shape = _shape(load, parameters)
    at, usual = slice(load.joint, load.joint + shape.size), float(shape @ load.usual @ shape)
    if not bears(load, parameters):
        raise RobotError(
            "structural_flexibility: expected links with inertia about the joint that carries"
            f" them, found {usual:g} kg m^2"
        )
    share = carried * inertia / usual if carried > 0.0 else 0.0
    ahead = min(share, 1.0)  # a trial of a larger mode bends no further than it deflects
    rest, column = inertia - share * usual, load.columns @ shape
    swings = on_spring.py_func(inertia, share, column[:, at] @ shape, usual)
    omega, by_position, by_velocity = (
        2.0 * math.pi * frequency, load.by_position @ shape, load.by_velocity @ shape
    )  # fmt: skip
    terms = [
        inertia * omega**2 + share * ahead * (by_position[:, at] @ shape),
        2.0 * damping * inertia * omega + share * ahead * (by_velocity[:, at] @ shape),
        share * (load.torque @ shape) + rest * load.acceleration / shape[0],
    ]
    swing = np.stack([term / swings for term in terms], axis=1)
    swung = np.empty_like(swing)
    _swing(swing, step_s, _parts(swing[:, 0], step_s), np.array(begun), swung)
    e, rate, acceleration = swung.T[:, :, None]
    torque = share * (column * acceleration + by_position * e + by_velocity * rate)
    torque[:, load.joint] += rest / shape[0] * swung[:, 2]
    return np.asarray(torque)


def _parts(stiffness: FloatArray, step_s: float) -> int:
    """Parts of a sample in which a mode turns through little."""
    stiffest = float(np.nanmax(stiffness, initial=0.0))
    return max(math.ceil(math.sqrt(stiffest) * step_s / _TURN), 1)


@kernel
def _swing(terms: Array, step: float, parts: int, begins: Array, out: Array) -> None:
    """Deflection, its rate and acceleration, (N, 3), by the trapezoidal rule.

    It begins so far from where it rests, at such a rate. Terms (N, 3) are its stiffness k,
    resistance c and drive d: ``e'' = -k e - c e' - d``. Between samples they move evenly, in so
    many parts; where one is unknown (NaN) it stays as it was, and it ends at `LARGEST`.
    """
    h, e, v, begun = step / parts, 0.0, 0.0, False
    for i in range(terms.shape[0]):
        now = terms[i]
        known = not math.isnan(now[0] + now[1] + now[2])
        if known and not begun:
            begun = True
            e, v = begins[0], begins[1]
            if now[0] > 0.0:
                e -= now[2] / now[0]
        out[i, 0], out[i, 1], out[i, 2] = e, v, -now[0] * e - now[1] * v - now[2]
        if not known or i + 1 == terms.shape[0]:
            continue
        after = terms[i + 1]
        if math.isnan(after[0] + after[1] + after[2]):
            continue
        for j in range(parts):
            low, high = j / parts, (j + 1) / parts
            k = now[0] + low * (after[0] - now[0])
            c = now[1] + low * (after[1] - now[1])
            d = now[2] + low * (after[2] - now[2])
            later_k = now[0] + high * (after[0] - now[0])
            later_c = now[1] + high * (after[1] - now[1])
            pull = -k * e - c * v - d
            pull -= later_k * (e + 0.5 * h * v) + now[2] + high * (after[2] - now[2])
            then = (v + 0.5 * h * pull) / (1.0 + 0.5 * h * later_c + 0.25 * h * h * later_k)
            e, v = e + 0.5 * h * (v + then), then
            if abs(e) > LARGEST:
                e, v = math.copysign(LARGEST, e), 0.0
