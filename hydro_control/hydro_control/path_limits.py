"""What a path may ask of the robot that is to follow it: more than `check_path` alone holds."""

from __future__ import annotations

import numpy as np

from hydro_control.errors import NUMERICAL_ERRORS, ControlError
from hydro_control.motion_limits import refuse_fast
from hydro_control.required_motion import ACCELERATION_PER_VELOCITY_1_S
from hydro_model.errors import RobotError
from hydro_model.paths import JointPath, TipPath
from hydro_model.paths_check import PathCheck, check_path, joints_at_tip
from hydro_model.robot import FloatArray, Robot

#: Spacing of the check, s.
CHECK_STEP_S = 0.02
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

    Returns
    -------
    PathCheck

    Raises
    ------
    ControlError, RobotError
        Which limit is exceeded, by how much and when.
    """
    check = check_path(robot, path, near=near, step_s=step_s)
    speeds = np.array([joint.velocity_limit for joint in robot.joints])
    most = ACCELERATION_PER_VELOCITY_1_S * speeds
    worst = int(np.argmax(check.peak_acceleration / most))
    found, when_s = check.peak_acceleration[worst], check.peak_acceleration_at_s[worst]
    if not found <= most[worst] + 1e-9:
        raise ControlError(
            f"joint '{robot.joints[worst].name}' reaches an acceleration of {found:.4g} at"
            f" {when_s:.3f} s, expected at most {most[worst]:.4g}{hint}"
        )
    refuse_fast(robot, path, tip_speed_m_s, near)
    return check


def start_of_path(robot: Robot, path: TipPath | JointPath, tip_speed_m_s: float) -> FloatArray:
    """Check a path before any pose is known, and say from which pose it was checked.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    tip_speed_m_s : float

    Returns
    -------
    (n,) array
        Joint positions at its start: joints that it does not name in mid-range, a tip by the
        first posture found inside the limits.

    Raises
    ------
    ControlError, RobotError
        As of `refuse_beyond`.
    """
    try:
        return refuse_beyond(robot, path, tip_speed_m_s).start_position
    except NUMERICAL_ERRORS as error:
        raise ControlError(f"the path cannot be computed: {error}") from error


def same_start(
    robot: Robot, path: TipPath | JointPath, checked: FloatArray, q: FloatArray
) -> bool:
    """Whether the check of `start_of_path` holds where the robot stands.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    checked : (n,) array
        What that said.
    q : (n,) array
        Joint positions.

    Returns
    -------
    bool
        Not where joints that the path does not name, or the posture of its tip, are others: other
        weights hang on the cylinders, and others of them come to their ends.
    """
    if isinstance(path, JointPath):
        return set(robot.joint_names) <= set(path.joints)
    try:
        start = joints_at_tip(robot, path.sample(0.0)[0], q)
    except RobotError:
        return False
    return bool(np.max(np.abs(start - checked)) <= _SAME_POSTURE)
