"""A link that bends, over a recording: what its mode carries is known there, and set in motion.

In a roll-out a mode is a law of its own joint alone (`structural_flexibility`). A recording tells
the whole load: what hangs on a hinge is moved by gravity and by other joints, too, weighs on all
joints before it, and makes the mode slower where it is stretched out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hydro_model.kernel import kernel
from hydro_model.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.robot import FloatArray, Robot

Array = Any  # numba types the kernels; mypy follows no numba import

#: Parts of a radian that a mode turns through per step at most.
_TURN = 0.1
#: Step of the torques' derivatives, rad and rad/s (m and m/s on a prismatic joint).
_STEP = 1.0e-4


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """What a joint carries along a recording, as the robot's rigid bodies tell; N samples.

    Attributes
    ----------
    joint : int
    acceleration : (N,) array
        Of the joint, rad/s^2.
    torque : (N,) array
        At the joint, gravity included, N m.
    column : (N, n) array
        Torques at all joints per acceleration of this one, kg m^2.
    by_position, by_velocity : (N, n) array
        Slopes of all joints' torques in this one's position and velocity.
    usual : float
        Inertia about the joint with all joints in the middle of their ranges (at 0 where they
        turn without end), kg m^2.
    """

    joint: int
    acceleration: FloatArray
    torque: FloatArray
    column: FloatArray
    by_position: FloatArray
    by_velocity: FloatArray
    usual: float

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
        step = np.zeros(robot.dof)
        step[joint] = _STEP
        slopes = []
        for ahead, behind in (((q + step, qd), (q - step, qd)), ((q, qd + step), (q, qd - step))):
            gained = inverse_dynamics(robot, *ahead, qdd) - inverse_dynamics(robot, *behind, qdd)
            slopes.append(gained / (2.0 * _STEP))
        return Load(
            joint=joint,
            acceleration=qdd[:, joint],
            torque=inverse_dynamics(robot, q, qd, qdd)[:, joint],
            column=mass_matrix(robot, q)[:, joint],
            by_position=slopes[0],
            by_velocity=slopes[1],
            usual=usual_inertia(robot, joint),
        )


def middle_pose(robot: Robot) -> FloatArray:
    """All joints in the middle of their ranges, (n,); at 0 where they turn without end."""
    ranges = np.array([(joint.lower, joint.upper) for joint in robot.joints])
    return np.asarray(np.where(np.isfinite(ranges).all(axis=1), ranges.mean(axis=1), 0.0))


def usual_inertia(robot: Robot, joint: int) -> float:
    """Inertia about a joint with all joints in the middle of their ranges, kg m^2 (kg)."""
    return float(mass_matrix(robot, middle_pose(robot))[joint, joint])


def bent(load: Load, parameters: FloatArray, step_s: float) -> FloatArray:
    """Torques that a mode takes beyond the rigid links, (N, n).

    With the deflection e: ``e'' = -W^2 e / m - 2 zeta W e' / m - qdd - c (T / M_ii - qdd)``, T with
    what it changes by e and e'; at its own joint it takes ``J m e''``, at the others
    ``c J / M M_ji e''``, and at all of them ``c J / M`` times what the load's torque changes by e
    and e'. There ``m = 1 + min(c, 1) (M_ii / M - 1)`` and M is M_ii with the joints in the middle
    of their ranges. Nothing of what is carried (c = 0) leaves a mode that its joint's own
    acceleration alone sets going. All of it (c = 1) is a hinge between the joint and nearly all
    that moves with it (J near M), to first order in its deflection.

    Parameters
    ----------
    load : Load
    parameters : (4,) array
        J in kg m^2, W / 2 pi in Hz, zeta, c.
    step_s : float
        Sampling interval.

    Returns
    -------
    (N, n) array
    """
    inertia, frequency, damping, carried = parameters
    at, mass, usual = load.joint, load.column[:, load.joint], load.usual
    grown = 1.0 + min(carried, 1.0) * (mass / usual - 1.0)
    omega = 2.0 * math.pi * frequency
    swing = np.stack(
        [
            omega**2 / grown + carried * load.by_position[:, at] / mass,
            2.0 * damping * omega / grown + carried * load.by_velocity[:, at] / mass,
            load.acceleration + carried * (load.torque / mass - load.acceleration),
        ],
        axis=1,
    )
    swung = np.empty_like(swing)
    _swing(swing, step_s, max(math.ceil(omega * step_s / _TURN), 1), swung)
    e, rate, acceleration = swung.T[:, :, None]
    share = carried * inertia / usual
    torque = share * (load.column * acceleration + load.by_position * e + load.by_velocity * rate)
    torque[:, at] += (inertia * grown - share * mass) * swung[:, 2]
    return np.asarray(torque)


@kernel
def _swing(terms: Array, step: float, parts: int, out: Array) -> None:
    """Deflection, its rate and acceleration, (N, 3), by the trapezoidal rule from where it rests.

    Terms (N, 3) are its stiffness k, resistance c and drive d: ``e'' = -k e - c e' - d``. Between
    samples they move evenly, in so many parts; where one is unknown (NaN) it stays as it was.
    """
    h, e, v, begun = step / parts, 0.0, 0.0, False
    for i in range(terms.shape[0]):
        now = terms[i]
        known = not math.isnan(now[0] + now[1] + now[2])
        if known and not begun:
            e, begun = -now[2] / now[0], True
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
