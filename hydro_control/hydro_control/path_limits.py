"""What a path may ask of the robot that is to follow it: more than `check_path` alone holds."""

from __future__ import annotations

import numpy as np

from hydro_control.errors import ControlError
from hydro_control.motion_limits import refuse_fast
from hydro_control.required_motion import ACCELERATION_PER_VELOCITY_1_S
from hydro_model.paths import JointPath, TipPath
from hydro_model.paths_check import check_path
from hydro_model.robot import FloatArray, Robot

#: Spacing of the check, s.
CHECK_STEP_S = 0.02


def refuse_beyond(
    robot: Robot,
    path: TipPath | JointPath,
    tip_speed_m_s: float,
    near: FloatArray | None = None,
    *,
    step_s: float = CHECK_STEP_S,
    hint: str = "",
) -> None:
    """Refuse a path that the robot cannot follow.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    tip_speed_m_s : float
        Of paths of the tip.
    near : (n,) array, optional
        Joint positions at the start.
    step_s : float
        Spacing of the check.
    hint : str
        What would help where accelerations are too great.

    Raises
    ------
    ControlError, RobotError
        Which limit is exceeded, by how much and when.
    """
    check = check_path(robot, path, near=near, step_s=step_s)
    asked = np.stack((check.lower, check.upper, check.peak_velocity, check.peak_acceleration))
    if not np.all(np.isfinite(asked)):
        # Comparisons with what is not a number hold none of the limits.
        raise ControlError("expected a motion of finite numbers, found some beyond their range")
    speeds = np.array([joint.velocity_limit for joint in robot.joints])
    most = ACCELERATION_PER_VELOCITY_1_S * speeds
    worst = int(np.argmax(check.peak_acceleration / most))
    found, when_s = check.peak_acceleration[worst], check.peak_acceleration_at_s[worst]
    if not found <= most[worst] + 1e-9:
        raise ControlError(
            f"joint '{robot.joints[worst].name}' reaches an acceleration of {found:.4g} at"
            f" {when_s:.3f} s, expected at most {most[worst]:.4g}{hint}"
        )
    refuse_fast(path, tip_speed_m_s)
