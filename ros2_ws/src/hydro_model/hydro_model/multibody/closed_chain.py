"""Barrels and rods of cylinders as bodies: where they hang, and their parameters as vectors.

A cylinder on a triangle closes a chain: barrel and rod turn about their pins by angles that follow
from the joint's. `hydro_model.multibody.part_kernels` has their equations. A cylinder that sits
directly on a prismatic joint moves with the links and counts as a part of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.errors import RobotError
from hydro_model.robot import (
    PART_PARAMETERS,
    STANDARD_PARAMETERS,
    Cylinder,
    FloatArray,
    Joint,
    Robot,
)

#: Columns of the kernels' `parts` array. The host is -1 for the base.
HOST, JOINT = 0, 1
PIN, U, W, Z = 2, 5, 8, 11
OWN, OTHER, ANGLE = 14, 15, 16
MASS, FIRST, SECOND = 17, 18, 19
PART_COLUMNS = 20

#: An axis no further from x than this turns about x: what is left of x across it would be where
#: the last digits of its numbers, or a calibration of the axis, happen to point.
ALONG_X_RAD = 0.01

PART_SIZE = len(PART_PARAMETERS)
_SIZE = len(STANDARD_PARAMETERS)


def pins(cylinder: Cylinder, joint: Joint) -> tuple[FloatArray, FloatArray]:
    """Directions of the two pins from the joint axis, in the child frame at q = 0.

    Angles count about the joint axis, from the x axis (the y axis where the joint turns about x,
    to within `ALONG_X_RAD`).
    The angle between the pins is q + q0, so the parent pin stands at ``child_pin_angle - q0``.

    Parameters
    ----------
    cylinder : Cylinder
        On a triangle.
    joint : Joint

    Returns
    -------
    parent, child : (3,) array
        Unit vectors.
    """
    axis = np.asarray(joint.axis, dtype=float)
    along = np.array([1.0, 0.0, 0.0]) - axis[0] * axis
    if float(along @ along) < ALONG_X_RAD**2:
        along = np.array([0.0, 1.0, 0.0]) - axis[1] * axis
    along /= np.linalg.norm(along)
    across = np.cross(axis, along)
    child, parent = (
        np.cos(angle) * along + np.sin(angle) * across
        for angle in (
            cylinder.child_pin_angle_rad,
            cylinder.child_pin_angle_rad - cylinder.q0_rad,
        )
    )
    return parent, child


@dataclass(frozen=True, slots=True, eq=False)
class PartPlace:
    """Where a barrel or rod hangs, in the frame of the link that holds its pin.

    Attributes
    ----------
    host, joint : int
        Link (-1: the base) and joint that the part follows.
    pin_m : (3,) array
    towards : (3,) array
        Unit vector from the joint axis to the pin.
    axis : (3,) array
        That the part turns about, in the sense in which the joint moves the other pin.
    own_m, other_m : float
        From the joint axis to the own pin and to the other one.
    angle_rad : float
        The angle between the pins at q = 0.
    """

    host: int
    joint: int
    pin_m: FloatArray
    towards: FloatArray
    axis: FloatArray
    own_m: float
    other_m: float
    angle_rad: float


def part_places(robot: Robot) -> tuple[PartPlace, ...]:
    """Barrel and rod of every closed chain, in the order of `robot.part_parameters`."""
    places = []
    for c in robot.closed_chains:
        at = robot.joint_index(c.joint)
        joint = robot.joints[at]
        parent, child = pins(c, joint)
        turned, axis = joint.rotation @ parent, np.asarray(joint.axis, dtype=float)
        pin = joint.translation_m + c.l1_m * turned
        places.append(
            PartPlace(at - 1, at, pin, turned, joint.rotation @ axis, c.l1_m, c.l2_m, c.q0_rad)
        )
        places.append(PartPlace(at, at, c.l2_m * child, child, -axis, c.l2_m, c.l1_m, c.q0_rad))
    return tuple(places)


def part_rows(robot: Robot) -> FloatArray:
    """The `parts` array of the kernels, (2 k, PART_COLUMNS)."""
    rows = [
        [
            *(p.host, p.joint, *p.pin_m, *p.towards, *np.cross(p.axis, p.towards), *p.axis),
            *(p.own_m, p.other_m, p.angle_rad, *values),
        ]
        for p, values in zip(part_places(robot), robot.part_parameters, strict=True)
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, PART_COLUMNS)


def with_parameters(robot: Robot, vector: ArrayLike) -> Robot:
    """The robot with other inertial parameters of links, barrels and rods.

    Parameters
    ----------
    robot : Robot
    vector : (10 n + 6 k,) array
        In the order of `robot.parameter_names`.

    Returns
    -------
    Robot
        Its cylinders keep the datasheet's barrels and rods, which then count no more.

    Raises
    ------
    RobotError
        The vector's size does not fit the robot.
    """
    values = np.array(vector, dtype=np.float64)
    names = robot.parameter_names
    if values.shape != (len(names),):
        raise RobotError(
            f"robot {robot.name}: expected {len(names)} parameters, found shape {values.shape}"
        )
    links = _SIZE * robot.dof
    return replace(
        robot,
        link_inertia=values[:links].reshape(-1, _SIZE),
        part_inertia=values[links:].reshape(-1, PART_SIZE),
    )
