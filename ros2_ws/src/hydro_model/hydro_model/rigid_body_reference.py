"""The rigid-body equations as one reads them: numpy over stacks of samples, no compilation.

The compiled kernels of `hydro_model.rigid_body` are tested against these. Joint vectors have
shape (N, n).
"""

from __future__ import annotations

import numpy as np

from hydro_model.robot import FloatArray, Joint, Robot
from hydro_model.spatial import (
    axis_rotation,
    body_regressor,
    cross_motion,
    motion_transform,
    spatial_inertia,
)


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


def required_torque(
    robot: Robot,
    q: FloatArray,
    qd: FloatArray,
    qd_r: FloatArray,
    qdd_r: FloatArray,
    k_v: float,
) -> FloatArray:
    """Counterpart of `rigid_body.required_torque` for stacks (eqs. 5 to 7, 20, 22)."""
    forces, transforms = [], []
    velocity, required = np.zeros((len(q), 6)), np.zeros((len(q), 6))
    acceleration = np.tile(np.concatenate([np.zeros(3), -robot.gravity_m_s2]), (len(q), 1))
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
    torque = np.empty_like(q)
    carried = np.zeros((len(q), 6))
    for i in reversed(range(robot.dof)):
        force = forces[i] + carried
        torque[:, i] = force @ joint_motion(robot.joints[i])
        carried = _apply(np.swapaxes(transforms[i], -1, -2), force)
    return torque


def inverse_dynamics(robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """Counterpart of `rigid_body.inverse_dynamics` for stacks."""
    return required_torque(robot, q, qd, qd, qdd, 0.0)


def regressor(robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """Counterpart of `rigid_body.regressor` for stacks, (N, n, 10 n)."""
    out = np.zeros((len(q), robot.dof, 10 * robot.dof))
    velocity = np.zeros((len(q), 6))
    acceleration = np.tile(np.concatenate([np.zeros(3), -robot.gravity_m_s2]), (len(q), 1))
    transforms: list[FloatArray] = []
    for i, joint in enumerate(robot.joints):
        s, transform = joint_motion(joint), joint_transform(joint, q[:, i])
        own = s * qd[:, i : i + 1]
        velocity = _apply(transform, velocity) + own
        acceleration = (
            _apply(transform, acceleration) + s * qdd[:, i : i + 1] + cross_motion(velocity, own)
        )
        transforms.append(transform)
        columns = body_regressor(acceleration, velocity)
        for j in reversed(range(i + 1)):
            out[:, j, 10 * i : 10 * i + 10] = joint_motion(robot.joints[j]) @ columns
            columns = np.swapaxes(transforms[j], -1, -2) @ columns
    return out


def mass_matrix(robot: Robot, q: FloatArray) -> FloatArray:
    """Counterpart of `rigid_body.mass_matrix` for stacks: the sum of J^T M J over the links."""
    out = np.zeros((len(q), robot.dof, robot.dof))
    jacobian = np.zeros((len(q), 6, robot.dof))
    for i, joint in enumerate(robot.joints):
        jacobian = joint_transform(joint, q[:, i]) @ jacobian
        jacobian[:, :, i] += joint_motion(joint)
        inertia = spatial_inertia(robot.link_inertia[i])
        out += np.swapaxes(jacobian, -1, -2) @ inertia @ jacobian
    return out


def _apply(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., None])[..., 0])
