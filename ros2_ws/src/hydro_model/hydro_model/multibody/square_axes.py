"""Axes and gravity that stand parallel or square to one another but for a small angle.

A URDF writes angles in decimals: 1.5708 for a right angle tilts an axis by 4e-6 rad, 3.1416 by
7e-6. For the regressor that is as good as exact, but not for the question of which parameters
there are (`hydro_model.multibody.base_parameters`): inertias that show only through the tilt
count as parameters of their own, and no motion of a real machine tells them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_model.multibody.spatial import skew
from hydro_model.robot import FloatArray, Joint, Robot

#: Angles written with four decimals are off by up to 5e-5 rad, sums of two by twice as much; no
#: steel structure is made, or stands still under load, so exactly (0.1 mm over a metre).
ROUNDED_RAD = 1.0e-4
#: What is closer is rounding of the arithmetic: such a robot stays as it is to the last bit.
_EXACT = 1.0e-12


@dataclass(frozen=True, slots=True)
class Slip:
    """A joint's axis that was turned until it is parallel or square to what was near it.

    Attributes
    ----------
    joint : str
    angle_rad : float
        By which it was turned.
    """

    joint: str
    angle_rad: float


def squared(robot: Robot, within_rad: float = ROUNDED_RAD) -> tuple[Robot, tuple[Slip, ...]]:
    """The robot with its axes parallel or square to one another where they nearly are.

    From the base outwards each axis is compared with every direction that keeps its angle to it
    in all joint positions: the axis before it, through joints that slide also those before that,
    and gravity as far as no joint turns it. What turns with an axis follows.

    Parameters
    ----------
    robot : Robot
    within_rad : float
        Largest angle that counts as none.

    Returns
    -------
    Robot
        The same object where nothing was turned.
    tuple of Slip
        By joint from the base outwards.
    """
    size = float(np.linalg.norm(robot.gravity_m_s2))
    known = [robot.gravity_m_s2 / size] if size > 0.0 else []
    joints, slips = list[Joint](), list[Slip]()
    for joint in robot.joints:
        axis = joint.rotation @ joint.axis
        turn = _least_turn(axis, _nearest(axis, known, math.sin(within_rad)))
        angle = 2.0 * math.asin(min(0.5 * float(np.linalg.norm(turn @ axis - axis)), 1.0))
        if angle > _EXACT:
            slips.append(Slip(joint.name, angle))
            joint = replace(joint, rotation=turn @ joint.rotation)
        joints.append(joint)
        # What a joint turns is at one angle to its axis alone; one that slides turns nothing.
        kept = [joint.rotation.T @ one for one in known] if joint.prismatic else []
        known = [joint.axis, *kept]
    return (replace(robot, joints=tuple(joints)) if slips else robot), tuple(slips)


def _nearest(axis: FloatArray, known: Sequence[FloatArray], within: float) -> FloatArray:
    """The direction next to an axis that is parallel, or square, to all that it nearly is."""
    for one in known:
        along = float(axis @ one)
        if np.linalg.norm(axis - along * one) <= within:
            return np.asarray(np.sign(along) * one)
    near, basis = axis, list[FloatArray]()
    for one in known:
        if abs(float(axis @ one)) > within:
            continue
        for other in basis:
            one = one - (one @ other) * other
        length = float(np.linalg.norm(one))
        # Two directions that say the same leave nothing of the second.
        if length > 0.5:
            basis.append(one / length)
            near = near - (near @ basis[-1]) * basis[-1]
    return np.asarray(near / np.linalg.norm(near))


def _least_turn(start: FloatArray, end: FloatArray) -> FloatArray:
    """The smallest rotation that brings one unit vector to another, less than a right angle."""
    spin, along = skew(np.cross(start, end)), float(start @ end)
    return np.asarray(np.eye(3) + spin + spin @ spin / (1.0 + along))
