"""Required joint motion from a reference of the tip or of the joints (eq. 19 and its rate)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hydro_model.multibody.kinematics import tip_position, tip_state
from hydro_model.robot import FloatArray, Robot

#: Singular values of the Jacobian below this share of the largest are inverted with damping.
SINGULAR_RATIO = 0.03
#: Below this share a direction is one the chain cannot move in at all, such as out of the
#: plane of a planar crane: left alone, and nothing to warn about.
RANK_RATIO = 1e-9
#: Required joint acceleration is kept within this many velocity limits per second.
ACCELERATION_PER_VELOCITY_1_S = 20.0

#: What a motion was limited by, in words.
DAMPED_NOTE = "near a singular pose, tip motion is damped"
SPEED_NOTE = "required joint velocity is at its limit"


@dataclass(frozen=True, slots=True)
class Reference:
    """What to follow at one instant.

    Attributes
    ----------
    space : {"tip", "joint"}
    position, velocity, acceleration : array
        (3,) in the base frame in m, or (n,) in rad or m.
    """

    space: Literal["tip", "joint"]
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, slots=True)
class JointMotion:
    """Desired and required motion of the joints.

    Attributes
    ----------
    q_d, qd_d : (n,) array
        Desired, without feedback. In tip space q_d is one Newton step from the measured
        position, exact to the second order of the tracking error.
    qd_r, qdd_r : (n,) array
        Required velocity (eq. 19) and its time derivative.
    tip_d_m : (3,) array
        Desired tip position.
    notes : tuple of str
        What was limited, in words.
    inverse : (n, 3) array or None
        Of the tip's Jacobian; None in joint space.
    """

    q_d: FloatArray
    qd_d: FloatArray
    qd_r: FloatArray
    qdd_r: FloatArray
    tip_d_m: FloatArray
    notes: tuple[str, ...] = ()
    inverse: FloatArray | None = None


def damped_inverse(jacobian: FloatArray) -> tuple[FloatArray, bool]:
    """Inverse of a Jacobian in the directions the chain can move in.

    Singular values s are inverted as 1/s down to ``e = SINGULAR_RATIO * s_max`` and as s/e^2
    below, which is continuous, never above 1/e and 0 at s = 0. So a planar crane's Jacobian
    of rank 2 needs no special case, and near a singular pose the required velocity fades in
    the lost direction instead of growing without bound.

    Parameters
    ----------
    jacobian : (3, n) array

    Returns
    -------
    inverse : (n, 3) array
    damped : bool
        A direction the chain can move in is being damped.
    """
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    edge = SINGULAR_RATIO * s[0]
    if edge == 0.0:
        return np.zeros_like(jacobian.T), True
    gain = np.where(s >= edge, 1.0 / np.maximum(s, edge), s / edge**2)
    damped = bool(np.any((s < edge) & (s > RANK_RATIO * s[0])))
    return np.asarray((vt.T * gain) @ u.T), damped


def required_motion(
    robot: Robot, q: FloatArray, qd: FloatArray, reference: Reference, k_p_1_s: float
) -> JointMotion:
    """Required joint velocity and its time derivative.

    In tip space (eq. 19) ``qd_r = J^-1 (pd_d + k_p (p_d - p))`` and, differentiated
    analytically rather than numerically,
    ``qdd_r = J^-1 (pdd_d + k_p (pd_d - J qd) - Jdot qd_r)``; in joint space the same with
    J = 1. Both are kept within the joints' velocity limits.

    Parameters
    ----------
    robot : Robot
    q, qd : (n,) array
        Measured position and velocity.
    reference : Reference
    k_p_1_s : float

    Returns
    -------
    JointMotion
    """
    if reference.space == "tip":
        motion = _from_tip(robot, q, qd, reference, k_p_1_s)
    else:
        motion = _from_joints(robot, q, qd, reference, k_p_1_s)
    return _within_limits(robot, motion)


def desired_at(
    robot: Robot, q: FloatArray, reference: Reference, near: JointMotion
) -> JointMotion:
    """A motion with the desired part of another sample, a few milliseconds away.

    Parameters
    ----------
    robot : Robot
    q : (n,) array
        Measured there.
    reference : Reference
        There.
    near : JointMotion
        Its Jacobian serves: over a few milliseconds that changes q_d by less than 1 % of the
        tracking error.

    Returns
    -------
    JointMotion
    """
    if near.inverse is None or reference.space == "joint":
        tip = np.asarray(tip_position(robot, reference.position))
        return replace(near, q_d=reference.position, qd_d=reference.velocity, tip_d_m=tip)
    error = reference.position - np.asarray(tip_position(robot, q))
    q_d, qd_d = q + near.inverse @ error, near.inverse @ reference.velocity
    return replace(near, q_d=q_d, qd_d=qd_d, tip_d_m=reference.position)


def _from_tip(
    robot: Robot, q: FloatArray, qd: FloatArray, ref: Reference, k_p: float
) -> JointMotion:
    position, jacobian, rate = tip_state(robot, q, qd)
    inverse, damped = damped_inverse(jacobian)
    error = ref.position - position
    qd_r = inverse @ (ref.velocity + k_p * error)
    qdd_r = inverse @ (ref.acceleration + k_p * (ref.velocity - jacobian @ qd) - rate @ qd_r)
    notes = (DAMPED_NOTE,) if damped else ()
    q_d, qd_d = q + inverse @ error, inverse @ ref.velocity
    return JointMotion(q_d, qd_d, qd_r, qdd_r, ref.position, notes, inverse)


def _from_joints(
    robot: Robot, q: FloatArray, qd: FloatArray, ref: Reference, k_p: float
) -> JointMotion:
    return JointMotion(
        q_d=ref.position,
        qd_d=ref.velocity,
        qd_r=ref.velocity + k_p * (ref.position - q),
        qdd_r=ref.acceleration + k_p * (ref.velocity - qd),
        tip_d_m=np.asarray(tip_position(robot, ref.position)),
    )


def _within_limits(robot: Robot, motion: JointMotion) -> JointMotion:
    """Scale the whole required velocity, so that its direction stays, and clip its rate."""
    limit = np.array([joint.velocity_limit for joint in robot.joints])
    excess = float(np.max(np.abs(motion.qd_r) / limit))
    if excess <= 1.0:
        scale, notes = 1.0, motion.notes
    else:
        scale, notes = 1.0 / excess, (*motion.notes, SPEED_NOTE)
    rate_limit = ACCELERATION_PER_VELOCITY_1_S * limit
    return replace(
        motion,
        qd_r=motion.qd_r * scale,
        qdd_r=np.clip(motion.qdd_r * scale, -rate_limit, rate_limit),
        notes=notes,
    )
