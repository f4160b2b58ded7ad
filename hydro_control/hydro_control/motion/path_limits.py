"""What a path may ask of the robot that is to follow it: more than `check_path` alone holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hydro_control.errors import NUMERICAL_ERRORS, ControlError, names_in_short
from hydro_control.motion.motion_limits import refuse_fast
from hydro_control.motion.posture import is_redundant
from hydro_control.motion.required_motion import ACCELERATION_PER_VELOCITY_1_S
from hydro_model.errors import RobotError
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.motion.paths_check import CHECK_STEP_S, PathCheck, check_path
from hydro_model.motion.paths_joints import joints_at_tip
from hydro_model.motion.row_pieces import always
from hydro_model.robot import FloatArray, Robot

#: Joint positions this near are the same posture, rad or m: far more than what inverse kinematics
#: misses by, far less than what tells two postures apart.
_SAME_POSTURE = 1e-4


def refuse_beyond(
    robot: Robot,
    path: TipPath | JointPath,
    tip_speed_m_s: float,
    near: FloatArray | None = None,
    *,
    step_s: float = CHECK_STEP_S,
    hint: str = "",
    go_on: Callable[[], None] = always,
) -> PathCheck:
    """Refuse a path that the robot cannot follow.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    tip_speed_m_s : float
    near : (n,) array, optional
        Joint positions at the start.
    step_s : float
        Spacing of the check.
    hint : str
        What would help where accelerations are too great.
    go_on : callable
        Called again and again on the way: what it raises ends the check.

    Returns
    -------
    PathCheck

    Raises
    ------
    ControlError, RobotError
        Which limit is exceeded, by how much and when.
    """
    check = check_path(robot, path, near=near, step_s=step_s, go_on=go_on)
    speeds = np.array([joint.velocity_limit for joint in robot.joints])
    most = ACCELERATION_PER_VELOCITY_1_S * speeds
    worst = int(np.argmax(check.peak_acceleration / most))
    found, when_s = check.peak_acceleration[worst], check.peak_acceleration_at_s[worst]
    if not found <= most[worst] + 1e-9:
        raise ControlError(
            f"joint '{robot.joints[worst].name}' reaches an acceleration of {found:.4g} at"
            f" {when_s:.3f} s, expected at most {most[worst]:.4g}{hint}"
        )
    refuse_fast(robot, path, tip_speed_m_s, near, go_on)
    return check


def refuse_frame(robot: Robot, frame: str) -> None:
    """Refuse places of the tip in another frame than the robot's base: it would go elsewhere.

    Parameters
    ----------
    robot : Robot
    frame : str

    Raises
    ------
    ControlError
    """
    base = robot.joints[0].parent_link
    if frame != base:
        raise ControlError(
            f"places of the tip should be in the frame '{base}', found"
            f" '{names_in_short([frame])}': transform them before they are sent"
        )


def start_of_path(
    robot: Robot, path: TipPath | JointPath, tip_speed_m_s: float
) -> FloatArray | None:
    """Check a path before any pose is known, and say from which pose it was checked.

    Where the path leaves open in which pose the machine will stand, only what holds in every one
    is checked: a path that can be followed from where it stands is not refused for a pose that
    nobody stands in.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    tip_speed_m_s : float

    Returns
    -------
    (n,) array or None
        Joint positions at its start, a tip by the first posture found inside the limits. None
        where joints are not named, or a redundant chain's tip is: all that hangs on their
        positions is not checked yet.

    Raises
    ------
    ControlError, RobotError
        As of `refuse_beyond`.
    """
    if isinstance(path, TipPath):
        refuse_frame(robot, path.frame)
    try:
        if isinstance(path, JointPath) and not _names_all(robot, path):
            _refuse_named(robot, path)
            return None
        if isinstance(path, TipPath) and _leaves_open(robot, path):
            _refuse_place(robot, path, tip_speed_m_s)
            return None
        return refuse_beyond(robot, path, tip_speed_m_s).start_position
    except NUMERICAL_ERRORS as error:
        raise ControlError(f"the path cannot be computed: {error}") from error


def _names_all(robot: Robot, path: JointPath) -> bool:
    return set(robot.joint_names) <= set(path.joints)


def _refuse_named(robot: Robot, path: JointPath) -> None:
    """Refuse what the joints that a path names cannot do, wherever the others stand.

    Where those stand decides on weights, on the tip's speed and on strokes of their own: no
    cylinder is looked at but the named joints', nor what it can hold.
    """
    own = tuple(c for c in robot.cylinders if c.joint in path.joints)
    alone = replace(robot, cylinders=own, part_inertia=None, valves=())
    refuse_beyond(alone, path, math.inf)


def _leaves_open(robot: Robot, path: TipPath) -> bool:
    """Whether a path's start can be reached in ever so many postures."""
    if path.tip_link != robot.tip_link:
        return False
    return is_redundant(robot, joints_at_tip(robot, path.sample(0.0)[0]))


def _refuse_place(robot: Robot, path: TipPath, tip_speed_m_s: float) -> None:
    """Refuse what the tip cannot do, whatever the posture it begins in."""
    for at_s in path.breaks_s:
        joints_at_tip(robot, path.sample(at_s)[0])
    refuse_fast(robot, path, tip_speed_m_s)


def same_start(
    robot: Robot, path: TipPath | JointPath, checked: FloatArray | None, q: FloatArray
) -> bool:
    """Whether the check of `start_of_path` holds where the robot stands.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    checked : (n,) array or None
        What that said.
    q : (n,) array
        Joint positions.

    Returns
    -------
    bool
        Not where joints that the path does not name, or the posture of its tip, are others: other
        weights hang on the cylinders, and others of them come to their ends.
    """
    if checked is None:
        return False
    if isinstance(path, JointPath):
        return _names_all(robot, path)
    try:
        start = joints_at_tip(robot, path.sample(0.0)[0], q)
    except RobotError:
        return False
    return bool(np.max(np.abs(start - checked)) <= _SAME_POSTURE)
