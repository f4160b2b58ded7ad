"""Spatial vectors of Featherstone, angular part first, as eqs. 1 to 8 and 25 to 29 write them.

Every function works on stacks: the last one or two axes are the vector or matrix, whatever comes
before is the stack.
"""

from __future__ import annotations

import numpy as np

from hydro_model.robot import FloatArray


def skew(vector: FloatArray) -> FloatArray:
    """Matrix of the cross product, ``skew(a) @ b = a x b``.

    Parameters
    ----------
    vector : (..., 3) array

    Returns
    -------
    (..., 3, 3) array
    """
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*vector.shape[:-1], 3, 3)


def inertia_rows(vector: FloatArray) -> FloatArray:
    """The dot operator of eq. 29: ``inertia_rows(w) @ (ixx, ixy, ixz, iyy, iyz, izz) = I w``.

    Parameters
    ----------
    vector : (..., 3) array

    Returns
    -------
    (..., 3, 6) array
    """
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [x, y, z, zero, zero, zero, zero, x, zero, y, z, zero, zero, zero, x, zero, y, z]
    return np.stack(rows, axis=-1).reshape(*vector.shape[:-1], 3, 6)


def cross_motion(velocity: FloatArray, motion: FloatArray) -> FloatArray:
    """Rate of change of a motion vector fixed in a moving body (the matrix of eq. 6).

    Parameters
    ----------
    velocity, motion : (..., 6) array
        rad/s and m/s; a motion vector.

    Returns
    -------
    (..., 6) array
    """
    angular, linear = velocity[..., :3], velocity[..., 3:]
    return np.concatenate(
        [
            np.cross(angular, motion[..., :3]),
            np.cross(linear, motion[..., :3]) + np.cross(angular, motion[..., 3:]),
        ],
        axis=-1,
    )


def motion_transform(rotation: FloatArray, translation_m: FloatArray) -> FloatArray:
    """Transform X of motion vectors from a parent to a child frame (eqs. 3 and 4).

    Parameters
    ----------
    rotation : (..., 3, 3) array
        Axes of the child (columns) in the parent.
    translation_m : (..., 3) array
        Origin of the child in the parent.

    Returns
    -------
    (..., 6, 6) array
        ``v_child = X @ v_parent`` and ``f_parent = X^T @ f_child``.
    """
    turned = np.swapaxes(rotation, -1, -2)
    transform = np.zeros((*turned.shape[:-2], 6, 6))
    transform[..., :3, :3] = turned
    transform[..., 3:, 3:] = turned
    transform[..., 3:, :3] = -turned @ skew(translation_m)
    return transform


def axis_rotation(axis: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Rotation about a fixed unit axis (Rodrigues).

    Parameters
    ----------
    axis : (3,) array
    angle_rad : (...) array

    Returns
    -------
    (..., 3, 3) array
    """
    cross = skew(axis)
    sine, versine = np.sin(angle_rad), 1.0 - np.cos(angle_rad)
    return np.asarray(
        np.eye(3) + sine[..., None, None] * cross + versine[..., None, None] * (cross @ cross)
    )


def spatial_inertia(parameters: FloatArray) -> FloatArray:
    """Spatial inertia matrix M of a body (eq. 26).

    Parameters
    ----------
    parameters : (10,) array
        Standard parameters of eq. 28.

    Returns
    -------
    (6, 6) array
    """
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = _about_origin(parameters)
    first = skew(parameters[1:4])
    matrix[:3, 3:], matrix[3:, :3] = first, -first
    matrix[3:, 3:] = parameters[0] * np.eye(3)
    return matrix


def central_inertia(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre of mass, inertia about it: `hydro_model.description.urdf.standard_parameters` undone.

    Parameters
    ----------
    parameters : (10,) array
        Standard parameters of eq. 28, the mass above 0.

    Returns
    -------
    com_m : (3,) array
    inertia_com_kg_m2 : (3, 3) array
    """
    mass, com = parameters[0], parameters[1:4] / parameters[0]
    inertia = _about_origin(parameters)
    return com, inertia - mass * (com @ com * np.eye(3) - np.outer(com, com))


def _about_origin(parameters: FloatArray) -> FloatArray:
    inertia, upper = np.zeros((3, 3)), np.triu_indices(3)
    inertia[upper] = parameters[4:]
    inertia.T[upper] = parameters[4:]
    return inertia


def body_regressor(acceleration: FloatArray, velocity: FloatArray) -> FloatArray:
    """Regressor Y of a body's net force (eq. 29, its transpose taken block by block).

    With the required acceleration and the measured velocity this is the feedforward term of
    eq. 20; with both measured it is eq. 8.

    Parameters
    ----------
    acceleration : (..., 6) array
        Spatial acceleration in the body frame, rad/s^2 and m/s^2, gravity included.
    velocity : (..., 6) array
        Spatial velocity in the body frame, rad/s and m/s.

    Returns
    -------
    (..., 6, 10) array
        Torque rows (N m) above force rows (N), columns in the order of eq. 28.
    """
    turn, rate = velocity[..., :3], acceleration[..., :3]
    cross = skew(turn)
    # The acceleration of the point of the body at the origin, eq. 29's vdot + w x v.
    point = acceleration[..., 3:] + np.cross(turn, velocity[..., 3:])
    regressor = np.zeros((*point.shape[:-1], 6, 10))
    regressor[..., :3, 1:4] = -skew(point)
    regressor[..., :3, 4:] = inertia_rows(rate) + cross @ inertia_rows(turn)
    regressor[..., 3:, 0] = point
    regressor[..., 3:, 1:4] = skew(rate) + cross @ cross
    return regressor


def from_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Rotation about the fixed axes x, y and z, one after the other.

    By quaternions, as scipy composes Euler angles: to the last digit its
    `Rotation.from_euler("xyz", ...)`, whose import takes longer than all else that a robot needs.

    Parameters
    ----------
    roll, pitch, yaw : float
        rad.

    Returns
    -------
    (3, 3) array
    """
    whole = np.array([0.0, 0.0, 0.0, 1.0])
    for axis, angle in enumerate((roll, pitch, yaw)):
        one = np.zeros(4)
        one[axis], one[3] = np.sin(angle / 2.0), np.cos(angle / 2.0)
        whole = one if axis == 0 else _composed(one, whole)
    x, y, z, w = whole
    xx, yy, zz, ww, xy, xz, yz, xw, yw, zw = (
        x * x, y * y, z * z, w * w, x * y, x * z, y * z, x * w, y * w, z * w
    )  # fmt: skip
    return np.array(
        [
            [xx - yy - zz + ww, 2.0 * (xy - zw), 2.0 * (xz + yw)],
            [2.0 * (xy + zw), -xx + yy - zz + ww, 2.0 * (yz - xw)],
            [2.0 * (xz - yw), 2.0 * (yz + xw), -xx - yy + zz + ww],
        ]
    )


def _composed(p: FloatArray, q: FloatArray) -> FloatArray:
    """Product of two quaternions, (x, y, z, w) each."""
    vector = p[3] * q[:3] + q[3] * p[:3] + np.cross(p[:3], q[:3])
    return np.append(vector, p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2])
