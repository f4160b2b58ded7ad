"""Angles of the links and places of barrels and rods: what a drawing of a robot moves by.

A cylinder is drawn as two bodies. On a triangle the barrel turns about its pin on the parent link,
the rod slides along it; directly on a prismatic joint the barrel stands along the joint's axis,
and the rod slides by the stroke ``x = q - x0``, as far as the joint does. Both follow from the
joint's position alone. In the triangle of joint axis, parent pin (`l1`) and child pin (`l2`) with
the angle ``a = q + q0`` between the pins, seen from the parent pin with x towards the joint axis,
the child pin lies at ``(l1 - l2 cos a, -l2 sin a)``; the rod's position is the stroke x(q) of eq.
16.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.robot import Cylinder, FloatArray, Robot


def barrel_joint(cylinder: str) -> str:
    """Name of the joint that a barrel turns in.

    Parameters
    ----------
    cylinder : str
    """
    return f"{cylinder}_barrel"


def rod_joint(cylinder: str) -> str:
    """Name of the joint that a rod slides in.

    Parameters
    ----------
    cylinder : str
    """
    return f"{cylinder}_rod"


def visual_joint_names(robot: Robot) -> tuple[str, ...]:
    """All moving joints of the drawing: the robot's own, then barrel and rod of each cylinder.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of str
        Of a cylinder that sits directly on a prismatic joint the rod alone: its barrel stands.
    """
    parts = []
    for cylinder in robot.cylinders:
        if cylinder.l1_m != 0.0:
            parts.append(barrel_joint(cylinder.name))
        parts.append(rod_joint(cylinder.name))
    return (*robot.joint_names, *parts)


def visual_joint_positions(robot: Robot, q: ArrayLike) -> FloatArray:
    """Positions of all moving joints of the drawing.

    Parameters
    ----------
    robot : Robot
    q : (n,) or (N, n) array
        Joint positions, rad or m.

    Returns
    -------
    (n + 2 k + p,) or (N, n + 2 k + p) array
        Of k cylinders on triangles and p on prismatic joints, in the order of
        `visual_joint_names`: rad, for rods m of stroke.

    Raises
    ------
    RobotError
        The last axis is not one value per joint.
    """
    q = np.asarray(q, dtype=float)
    if q.shape[-1:] != (robot.dof,):
        raise RobotError(
            f"robot {robot.name}: expected {robot.dof} joint positions, found shape {q.shape}"
        )
    columns = [q]
    for cylinder in robot.cylinders:
        own = q[..., robot.joint_index(cylinder.joint)]
        if cylinder.l1_m != 0.0:
            columns.append(barrel_angle(cylinder, own)[..., None])
        columns.append(stroke(cylinder, own)[..., None])
    return np.concatenate(columns, axis=-1)


def barrel_angle(cylinder: Cylinder, q: ArrayLike) -> FloatArray:
    """Angle of a barrel about its pin.

    Parameters
    ----------
    cylinder : Cylinder
        On a triangle.
    q : array
        Position of its joint, rad.

    Returns
    -------
    array
        Same shape, rad, from the direction towards the joint axis, positive in the joint's own
        sense.
    """
    a = np.asarray(q, dtype=float) + cylinder.q0_rad
    across = -cylinder.l2_m * np.sin(a)
    return np.asarray(np.arctan2(across, cylinder.l1_m - cylinder.l2_m * np.cos(a)))
