"""The way from where the reference stands to the start of a path."""

from __future__ import annotations

from typing import Literal

import numpy as np

from hydro_control.errors import ControlError
from hydro_control.motion.motion_limits import TIP_SPEED_M_S
from hydro_control.motion.required_motion import ACCELERATION_PER_VELOCITY_1_S
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.motion.paths_joints import joint_motion
from hydro_model.motion.paths_segments import Quintic, Segment
from hydro_model.multibody.kinematics import tip_jacobian
from hydro_model.robot import FloatArray, Robot

#: A path may start this far from where the robot stands, and is then approached at this speed, or
#: at less where a joint is slower or the tip would be beyond its limit.
APPROACH_LIMIT = {"tip": 0.3, "joint": 0.3}
APPROACH_SPEED = {"tip": 0.1, "joint": 0.1}
SHORTEST_APPROACH_S, LONGEST_APPROACH_S = 0.5, 60.0
APPROACH_CHECKS = 8
#: What arithmetic leaves of no distance, such as where joints are held and the tip's place is
#: computed of them, m or rad.
_NO_DISTANCE = 1e-9
#: Slower than the joints' limits by this share where speeds are known at some points only.
_SPARE = {"tip": 0.05, "joint": 0.0}
_TIP_SPARE = 0.05
_UNIT = {"tip": "m", "joint": "rad or m"}


def approach_to(
    robot: Robot,
    space: Literal["tip", "joint"],
    at: FloatArray,
    first: FloatArray,
    q: FloatArray,
    tip_speed_m_s: float = TIP_SPEED_M_S,
) -> tuple[Segment, ...]:
    """A quintic from where the reference stands to the start of a path.

    Parameters
    ----------
    robot : Robot
    space : {"tip", "joint"}
    at, first : (k,) array
        Where the reference stands, and where the path starts.
    q : (n,) array
        Measured joint positions.
    tip_speed_m_s : float
        The tip goes there no faster.

    Returns
    -------
    tuple of Segment
        None where the path starts there.

    Raises
    ------
    ControlError
        The start is too far away, or the slowest joint would take too long.
    RobotError
        A position of the tip on the way cannot be reached.
    """
    away = first - at
    distance = float(np.linalg.norm(away) if space == "tip" else np.max(np.abs(away)))
    if distance <= _NO_DISTANCE:
        return ()
    if not distance <= APPROACH_LIMIT[space]:  # so that no number is refused, too
        raise ControlError(
            f"the path starts {distance:.3f} {_UNIT[space]} from where the robot stands,"
            f" expected at most {APPROACH_LIMIT[space]}"
        )
    usual = max(SHORTEST_APPROACH_S, 1.875 * distance / APPROACH_SPEED[space])
    segment = Quintic.at_rest(at.tolist(), first.tolist(), usual)
    duration = usual * _times_too_fast(robot, space, segment, q, tip_speed_m_s)
    if duration == usual:
        return (segment,)
    if not duration <= LONGEST_APPROACH_S:
        raise ControlError(
            f"the path starts {distance:.3f} {_UNIT[space]} from where the robot stands: to go"
            f" there within the speeds of joints and tip would take {duration:.0f} s, expected at"
            f" most {LONGEST_APPROACH_S:g} s"
        )
    return (Quintic.at_rest(at.tolist(), first.tolist(), duration),)


def _times_too_fast(
    robot: Robot,
    space: Literal["tip", "joint"],
    segment: Segment,
    q: FloatArray,
    tip_speed_m_s: float,
) -> float:
    """How many times as long a segment has to take for joints and tip; 1 where limits hold.

    In twice the time the same way takes half the speed, and a quarter of the acceleration.
    """
    path: TipPath | JointPath = JointPath((segment,), joints=robot.joint_names)
    if space == "tip":
        path = TipPath((segment,), tip_link=robot.tip_link)
    times = np.linspace(0.0, segment.duration_s, APPROACH_CHECKS + 1)
    on_the_way, qd, qdd = joint_motion(robot, path, times, q)
    limit = np.array([joint.velocity_limit for joint in robot.joints])
    speed = float(np.max(np.abs(qd) / limit))
    acceleration = float(np.max(np.abs(qdd) / (ACCELERATION_PER_VELOCITY_1_S * limit)))
    of_joints = max(speed, float(acceleration**0.5))
    if of_joints > 1.0:
        of_joints *= 1.0 + _SPARE[space]
    tip = np.einsum("tij,tj->ti", tip_jacobian(robot, on_the_way), qd)
    of_tip = float(np.max(np.linalg.norm(tip, axis=1))) / tip_speed_m_s
    return max(1.0, of_joints, of_tip * (1.0 + _TIP_SPARE) if of_tip > 1.0 else 1.0)
