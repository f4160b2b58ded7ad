"""What the records of a robot file have to agree on; messages name the file."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import inside_stroke, lever, stroke
from hydro_model.robot import Cylinder, FloatArray, Joint, Robot

#: Of a stroke, and of the joint's range: by how much joint limits may be too wide.
LIMITS_SLACK = 0.03
#: Positions that are looked at for where a piston leaves its cylinder.
_POSES = 2001
#: Of the largest lever arm: what is closer to a dead centre a piston is not taken to.
_LEAST_ARM = 0.05
#: No amplifier is so late; controllers look ahead by it.
_LONGEST_DELAY_S = 1.0
_LOG = logging.getLogger(__name__)


def check_robot(robot: Robot, path: Path, *, narrow: bool = False) -> None:
    """What is given twice or not there, does not fit its joint, or cannot be.

    Parameters
    ----------
    robot : Robot
    path : Path
        Of its file.
    narrow : bool
        Joints of cylinders may be without limits: `within_strokes` finds some.

    Raises
    ------
    RobotError
    """
    check_once("cylinder", [c.name for c in robot.cylinders], path)
    check_once("cylinder on joint", [c.joint for c in robot.cylinders], path)
    check_once("valve", [v.name for v in robot.valves], path)
    check_once("valve of cylinder", [v.cylinder for v in robot.valves], path)
    cylinders = tuple(c.name for c in robot.cylinders)
    for cylinder in robot.cylinders:
        check_known(
            f"cylinder '{cylinder.name}'", "joint", cylinder.joint, robot.joint_names, path
        )
        joint = robot.joints[robot.joint_index(cylinder.joint)]
        _check_seat(cylinder, joint, path)
        if not narrow and not _limited(joint):
            raise RobotError(_unlimited(cylinder, joint, path))
    for valve in robot.valves:
        check_known(f"valve '{valve.name}'", "cylinder", valve.cylinder, cylinders, path)
    if robot.supply_pressure_pa < robot.tank_pressure_pa:
        raise RobotError(
            f"{path}: expected a supply pressure_pa of at least the tank's"
            f" {robot.tank_pressure_pa:g} Pa, found {robot.supply_pressure_pa:g} Pa"
        )
    if robot.command_delay_s > _LONGEST_DELAY_S:
        raise RobotError(
            f"{path}: expected a command_delay_s of at most {_LONGEST_DELAY_S:g} s, found"
            f" {robot.command_delay_s:g} s (in ms?)"
        )


def _check_seat(cylinder: Cylinder, joint: Joint, path: Path) -> None:
    """Refuse a cylinder that its joint cannot carry in the form in which the file has it."""
    who = f"{path}: cylinder '{cylinder.name}'"
    direct = cylinder.l1_m == 0.0
    if direct and not joint.prismatic:
        raise RobotError(
            f"{who} on revolute joint '{joint.name}' needs l1_m, l2_m, q0_rad and x0_m"
        )
    if joint.prismatic and not direct:
        raise RobotError(
            f"{who} on prismatic joint '{joint.name}' has l1_m, which is of a joint that turns:"
            " expected no l1_m, l2_m and q0_rad, and as x0_m the joint's position with the rod"
            " fully in"
        )
    # Nothing in the file says where along the joint its pins are: a URDF says where a mass is.
    if direct and (cylinder.barrel is not None or cylinder.rod is not None):
        raise RobotError(
            f"{who} on prismatic joint '{joint.name}' has a barrel or rod, which move with the"
            f" links there: expected the barrel's mass in the <inertial> of '{joint.parent_link}'"
            f" and the rod's in that of '{joint.child_link}', in the URDF"
        )


def _limited(joint: Joint) -> bool:
    return bool(np.isfinite([joint.lower, joint.upper]).all())


def _unlimited(cylinder: Cylinder, joint: Joint, path: Path) -> str:
    return (
        f"{path}: cylinder '{cylinder.name}' needs joint '{joint.name}' to have finite"
        f" limits, found {joint.lower} to {joint.upper}"
    )


def check_known(who: str, what: str, name: str, known: tuple[str, ...], path: Path) -> None:
    """A name that a record gives is one of those that are there.

    Parameters
    ----------
    who : str
        The record.
    what : str
        What the name is of.
    name : str
    known : tuple of str
    path : Path
        Of the file.

    Raises
    ------
    RobotError
    """
    if name not in known:
        raise RobotError(
            f"{path}: {who} has no {what} '{name}' (known: {', '.join(known) or 'none'})"
        )


def check_once(what: str, names: list[str], path: Path) -> None:
    """Every name is given once.

    Parameters
    ----------
    what : str
        What the names are of.
    names : list of str
    path : Path
        Of the file.

    Raises
    ------
    RobotError
    """
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise RobotError(f"{path}: {what} '{twice[0]}' appears more than once")


def within_strokes(robot: Robot, path: Path, *, narrow: bool = False) -> Robot:
    """A robot whose joint limits keep every piston in its cylinder.

    Limits and pins that were read off drawings disagree by a little: limits that are slightly
    wide end where the piston does, and a warning says so.

    Parameters
    ----------
    robot : Robot
    path : Path
        Of its file.
    narrow : bool
        Limits that are far too wide, or not there, end where the piston does, too, or near a dead
        centre (`reach`): for who reads what a machine did. Who drives one would rely on them.

    Returns
    -------
    Robot

    Raises
    ------
    RobotError
        The limits are too wide by more than a little and not to be narrowed, or nowhere between
        them the cylinder has its stroke.
    """
    for cylinder in robot.cylinders:
        at = robot.joint_index(cylinder.joint)
        joint = robot.joints[at]
        inside = None
        if _limited(joint):
            poses = np.linspace(joint.lower, joint.upper, _POSES)
            x = stroke(cylinder, poses)
            if not (x.min() < 0.0 or x.max() > cylinder.stroke_m):
                continue
            text = (
                f"{path}: joint limits {joint.lower} to {joint.upper} move '{cylinder.name}' from"
                f" {x.min():.3f} to {x.max():.3f} m, outside its stroke 0 to"
                f" {cylinder.stroke_m} m"
            )
            inside = slightly_wide(cylinder, poses)
        else:
            text = _unlimited(cylinder, joint, path)
        if inside is None and narrow:
            inside = reach(cylinder, joint)
        if inside is None:
            raise RobotError(text)
        _LOG.warning("%s: taken as %.4f to %.4f", text, *inside)
        narrowed = replace(joint, lower=inside[0], upper=inside[1])
        joints = (*robot.joints[:at], narrowed, *robot.joints[at + 1 :])
        robot = replace(robot, joints=joints)
    return robot


def reach(cylinder: Cylinder, joint: Joint) -> tuple[float, float] | None:
    """Ends of the longest stretch between a joint's limits that its cylinder can drive.

    Parameters
    ----------
    cylinder : Cylinder
    joint : Joint

    Returns
    -------
    tuple of float or None
        Positions on one side of the dead centres, off them, at which the piston is in its
        cylinder; of a joint without limits on the side on which a positive turn extends it. None
        where there are none.
    """
    lower, upper = joint.lower, joint.upper
    if not _limited(joint):
        direct = cylinder.l1_m == 0.0
        begin = cylinder.x0_m if direct else -cylinder.q0_rad
        end = begin + (cylinder.stroke_m if direct else np.pi)
        lower, upper = max(lower, begin), min(upper, end)
    if not lower < upper:
        return None
    poses = np.linspace(lower, upper, _POSES)
    arm = lever(cylinder, poses)
    side = np.where(np.abs(arm) >= _LEAST_ARM * np.abs(arm).max(), np.sign(arm), 0.0)
    cuts = np.flatnonzero(np.diff(side)) + 1
    found = [
        inside
        for part, sides in zip(np.split(poses, cuts), np.split(side, cuts), strict=True)
        if sides[0] and (inside := inside_stroke(cylinder, part)) is not None
    ]
    ends = max(found, key=lambda ends: ends[1] - ends[0], default=(0.0, 0.0))
    return ends if ends[0] < ends[1] else None


def slightly_wide(cylinder: Cylinder, poses: FloatArray) -> tuple[float, float] | None:
    """Ends of the positions whose strokes a cylinder has, where the others are a little more.

    Parameters
    ----------
    cylinder : Cylinder
    poses : (N,) array
        From one joint limit to the other, in equal steps.

    Returns
    -------
    tuple of float or None
        None where they are too wide by more than `LIMITS_SLACK` of the stroke or of their range:
        near a dead centre little stroke is much of the range, and no slip of a drawing.
    """
    x = stroke(cylinder, poses)
    beyond = max(-float(x.min()), float(x.max()) - cylinder.stroke_m)
    inside = inside_stroke(cylinder, poses)
    if inside is None or beyond > LIMITS_SLACK * cylinder.stroke_m:
        return None
    cut = 1.0 - (inside[1] - inside[0]) / float(poses[-1] - poses[0])
    return inside if cut <= LIMITS_SLACK else None
