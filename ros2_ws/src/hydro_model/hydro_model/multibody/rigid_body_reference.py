"""The rigid-body equations as one reads them: numpy over stacks of samples, no compilation.

The compiled kernels of `hydro_model.multibody.rigid_body` are tested against these. Joint vectors
have shape (N, n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_model.multibody.closed_chain import part_places
from hydro_model.multibody.spatial import (
    axis_rotation,
    body_regressor,
    cross_motion,
    motion_transform,
    spatial_inertia,
)
from hydro_model.robot import FloatArray, Joint, Robot


def joint_motion(joint: Joint) -> FloatArray:
    """The joint's motion vector s in the child frame, (6,)."""
    still = np.zeros(3)
    return np.concatenate([still, joint.axis] if joint.prismatic else [joint.axis, still])


def joint_transform(joint: Joint, q: FloatArray) -> FloatArray:
    """Transform X from the parent to the child frame at positions q (N,), (N, 6, 6)."""
    if joint.prismatic:
        shift = joint.translation_m + q[:, None] * (joint.rotation @ joint.axis)
        return motion_transform(np.broadcast_to(joint.rotation, (len(q), 3, 3)), shift)
    rotation = joint.rotation @ axis_rotation(joint.axis, q)
    return motion_transform(rotation, np.broadcast_to(joint.translation_m, (len(q), 3)))


@dataclass(frozen=True, slots=True)
class PartMotion:
    """A barrel or rod as a body on a joint that depends on another one; N samples.

    Attributes
    ----------
    host, joint : int
        Link that it hangs on (-1: the base), joint that it follows.
    transform : (N, 6, 6) array
        From the host's to its own frame, whose x axis is its line.
    rate, slope : (N,) array
        First and second derivative of its angle with respect to the joint's.
    inertia : (10,) array
        As a link's: a rod without thickness.
    """

    host: int
    joint: int
    transform: FloatArray
    rate: FloatArray
    slope: FloatArray
    inertia: FloatArray


#: Motion vector of a part in its own frame.
PART_AXIS = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def part_motions(robot: Robot, q: FloatArray) -> list[PartMotion]:
    """All barrels and rods at positions q (N, n), angles taken from the triangles' sides."""
    motions = []
    for place, (mass, first, second) in zip(
        part_places(robot), robot.part_parameters, strict=True
    ):
        own, other = place.own_m, place.other_m
        a = q[:, place.joint] + place.angle_rad
        square = own**2 + other**2 - 2.0 * own * other * np.cos(a)
        turned = np.arctan2(other * np.sin(a), other * np.cos(a) - own)
        towards = np.stack(
            [place.towards, np.cross(place.axis, place.towards), place.axis], axis=1
        )
        rotation = towards @ axis_rotation(np.array([0.0, 0.0, 1.0]), turned)
        pin = np.broadcast_to(place.pin_m, (len(q), 3))
        rate = (other**2 - own * other * np.cos(a)) / square
        slope = own * other * np.sin(a) * (own**2 - other**2) / square**2
        body = np.array([mass, first, 0.0, 0.0, 0.0, 0.0, 0.0, second, 0.0, second])
        transform = motion_transform(rotation, pin)
        motions.append(PartMotion(place.host, place.joint, transform, rate, slope, body))
    return motions


def required_torque(
    robot: Robot,
    q: FloatArray,
    qd: FloatArray,
    qd_r: FloatArray,
    qdd_r: FloatArray,
    k_v: float,
) -> FloatArray:
    """Counterpart of `rigid_body.required_torque` for stacks (eqs. 5 to 7, 20, 22).

    `k_v` is the gain on the required velocity's error.
    """
    forces, transforms = [], []
    velocity, required, acceleration = _still(robot, len(q))
    states = {-1: (velocity, required, acceleration)}
    for i, joint in enumerate(robot.joints):
        s, transform = joint_motion(joint), joint_transform(joint, q[:, i])
        own = s * qd[:, i : i + 1]
        velocity = _apply(transform, velocity) + own
        required = _apply(transform, required) + s * qd_r[:, i : i + 1]
        # d/dt (X v) = X vdot + v x (s qd): eq. 6 where v is the measured velocity.
        acceleration = (
            _apply(transform, acceleration) + s * qdd_r[:, i : i + 1] + cross_motion(required, own)
        )
        feedforward = body_regressor(acceleration, velocity) @ robot.link_inertia[i]
        forces.append(feedforward + k_v * (required - velocity))
        transforms.append(transform)
        states[i] = (velocity, required, acceleration)
    torque = qdd_r * [joint.armature for joint in robot.joints]
    for part in part_motions(robot, q):
        velocity, acceleration = _moved(part, states[part.host], qd, qd_r, qdd_r)
        force = body_regressor(acceleration, velocity) @ part.inertia
        torque[:, part.joint] += part.rate * (force @ PART_AXIS)
        if part.host >= 0:
            forces[part.host] += _apply(np.swapaxes(part.transform, -1, -2), force)
    carried = np.zeros((len(q), 6))
    for i in reversed(range(robot.dof)):
        force = forces[i] + carried
        torque[:, i] += force @ joint_motion(robot.joints[i])
        carried = _apply(np.swapaxes(transforms[i], -1, -2), force)
    return torque


def inverse_dynamics(robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """Counterpart of `rigid_body.inverse_dynamics` for stacks."""
    return required_torque(robot, q, qd, qd, qdd, 0.0)


def regressor(robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """Counterpart of `rigid_body.regressor` for stacks, (N, n, 10 n + 6 k)."""
    out = np.zeros((len(q), robot.dof, len(robot.parameter_names)))
    velocity, _, acceleration = _still(robot, len(q))
    states = {-1: (velocity, velocity, acceleration)}
    transforms: list[FloatArray] = []
    for i, joint in enumerate(robot.joints):
        s, transform = joint_motion(joint), joint_transform(joint, q[:, i])
        own = s * qd[:, i : i + 1]
        velocity = _apply(transform, velocity) + own
        acceleration = (
            _apply(transform, acceleration) + s * qdd[:, i : i + 1] + cross_motion(velocity, own)
        )
        transforms.append(transform)
        states[i] = (velocity, velocity, acceleration)
        columns = body_regressor(acceleration, velocity)
        _carry(robot, transforms, i, columns, out[..., 10 * i : 10 * i + 10])
    for k, part in enumerate(part_motions(robot, q)):
        velocity, acceleration = _moved(part, states[part.host], qd, qd, qdd)
        columns = body_regressor(acceleration, velocity)
        columns = np.stack(
            [columns[..., 0], columns[..., 1], columns[..., 7] + columns[..., 9]], -1
        )
        own = out[..., 10 * robot.dof + 3 * k : 10 * robot.dof + 3 * k + 3]
        own[:, part.joint] = part.rate[:, None] * (PART_AXIS @ columns)
        _carry(robot, transforms, part.host, np.swapaxes(part.transform, -1, -2) @ columns, own)
    return out


def mass_matrix(robot: Robot, q: FloatArray) -> FloatArray:
    """Counterpart of `rigid_body.mass_matrix` for stacks: the sum of J^T M J over the bodies."""
    out = np.zeros((len(q), robot.dof, robot.dof))
    jacobian = np.zeros((len(q), 6, robot.dof))
    jacobians = {-1: jacobian}
    for i, joint in enumerate(robot.joints):
        jacobian = joint_transform(joint, q[:, i]) @ jacobian
        jacobian[:, :, i] += joint_motion(joint)
        inertia = spatial_inertia(robot.link_inertia[i])
        out += np.swapaxes(jacobian, -1, -2) @ inertia @ jacobian
        jacobians[i] = jacobian
    for part in part_motions(robot, q):
        jacobian = part.transform @ jacobians[part.host]
        jacobian[:, :, part.joint] += part.rate[:, None] * PART_AXIS
        out += np.swapaxes(jacobian, -1, -2) @ spatial_inertia(part.inertia) @ jacobian
    return out + np.diag([joint.armature for joint in robot.joints])


def _still(robot: Robot, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Velocity, required velocity and acceleration of the base, gravity as an acceleration."""
    up = np.concatenate([np.zeros(3), -robot.gravity_m_s2])
    return np.zeros((count, 6)), np.zeros((count, 6)), np.tile(up, (count, 1))


def _moved(
    part: PartMotion,
    host: tuple[FloatArray, FloatArray, FloatArray],
    qd: FloatArray,
    qd_r: FloatArray,
    qdd_r: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Velocity and required acceleration of a part; eqs. 5 and 6 on its dependent joint."""
    velocity, required, acceleration = (_apply(part.transform, one) for one in host)
    turn = (part.rate * qd[:, part.joint])[:, None] * PART_AXIS
    required = required + (part.rate * qd_r[:, part.joint])[:, None] * PART_AXIS
    spin = part.rate * qdd_r[:, part.joint] + part.slope * qd[:, part.joint] * qd_r[:, part.joint]
    acceleration = acceleration + spin[:, None] * PART_AXIS + cross_motion(required, turn)
    return velocity + turn, acceleration


def _carry(
    robot: Robot, transforms: list[FloatArray], link: int, columns: FloatArray, out: FloatArray
) -> None:
    """Columns of forces in a link's frame projected on its joint and all before it."""
    for j in reversed(range(link + 1)):
        out[:, j] += joint_motion(robot.joints[j]) @ columns
        columns = np.swapaxes(transforms[j], -1, -2) @ columns


def _apply(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., None])[..., 0])
