"""What no required motion may exceed: ends of joints and strokes, tip speed, chamber pressure.

Paths and trajectories beyond the limits are refused before they are played
(`hydro_model.motion.paths_check`). This is for what happens while they are: a reference that
stands elsewhere than the arm, an arm that drifted, a command from feedback alone. Pure functions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np

from hydro_control.errors import ControlError
from hydro_control.motion.braking import DOWN, UP, braking_energies, speed_before_end
from hydro_control.motion.required_motion import JointMotion
from hydro_model.hydraulics.cylinder import inside_stroke
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.motion.paths_check import check_times
from hydro_model.motion.paths_joints import joint_motion
from hydro_model.motion.row_pieces import always, in_pieces
from hydro_model.multibody.kinematics import tip_jacobian, tip_state
from hydro_model.robot import FloatArray, Robot

#: Points of a joint's range at which strokes are looked at.
_GRID = 2001
#: Tip speed unless told otherwise.
TIP_SPEED_M_S = 3.0
#: Spacing at which the speed of a path is looked at, or closer.
_STEP_S = 0.01
#: A valve stops feeding a chamber over this share of pressure below the limit.
RELIEF_BAND = 0.1

#: What a motion was limited by, in words.
TIP_SPEED_NOTE = "tip speed is at its limit"
END_NOTE = "braking before the end of a joint or stroke"
STARVED_NOTE = "a load holds more than the supply's pressure: its valve stays closed"
RELIEVED_NOTE = "a chamber is near the transducers' range: its valve is throttled"


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits of a robot's motion.

    Attributes
    ----------
    lower, upper : (n,) array
        Joint positions within the joints' limits and the cylinders' strokes, rad or m.
    open_lower, open_upper : (n,) array
        Where the joints may be: the ends, or beyond one as far as the machine stood when driving
        began. From further out it is asked back.
    braking : (2, n, POINTS) array
        Speeds from which the joints stop before their ends, as of `braking_energies`.
    tip_speed_m_s : float
    pressure_pa : float
        Gauge; no valve feeds a chamber above it: the transducers' range.
    """

    lower: FloatArray
    upper: FloatArray
    open_lower: FloatArray
    open_upper: FloatArray
    braking: FloatArray
    tip_speed_m_s: float
    pressure_pa: float


def limits_of(robot: Robot, tip_speed_m_s: float = TIP_SPEED_M_S) -> MotionLimits:
    """The limits of a robot.

    Parameters
    ----------
    robot : Robot
    tip_speed_m_s : float

    Returns
    -------
    MotionLimits

    Raises
    ------
    ControlError
        The supply's pressure is above the transducers' range, at which valves close.
    """
    most = robot.sensors.pressure_range_pa
    if robot.supply_pressure_pa > most:
        raise ControlError(
            f"robot {robot.name}: expected a supply of at most {most / 1e5:.0f} bar, its pressure"
            f" transducers' range, found {robot.supply_pressure_pa / 1e5:.0f} bar: valves close"
            " near that range's end; give the range that they have (sensors, pressure)"
        )
    lower = np.array([joint.lower for joint in robot.joints])
    upper = np.array([joint.upper for joint in robot.joints])
    for cylinder in robot.cylinders:
        i = robot.joint_index(cylinder.joint)
        inside = inside_stroke(cylinder, np.linspace(lower[i], upper[i], _GRID))
        if inside is not None:
            lower[i], upper[i] = inside
    speeds = np.array([joint.velocity_limit for joint in robot.joints])
    return MotionLimits(
        lower=lower,
        upper=upper,
        open_lower=lower.copy(),
        open_upper=upper.copy(),
        braking=braking_energies(robot, lower, upper, speeds),
        tip_speed_m_s=tip_speed_m_s,
        pressure_pa=robot.sensors.pressure_range_pa,
    )


def limited(
    robot: Robot, limits: MotionLimits, q: FloatArray, qd: FloatArray, motion: JointMotion
) -> JointMotion:
    """A required motion that keeps the limits.

    Towards an end a joint is never asked for more than the speed that it can still brake from
    (`hydro_control.motion.braking`), and beyond an end for none; beyond where it may be it is
    asked back. Away from an end it may always go. Where the tip would be too fast the whole motion
    is slowed, so that its direction stays.

    Parameters
    ----------
    robot : Robot
    limits : MotionLimits
    q, qd : (n,) array
        Measured.
    motion : JointMotion

    Returns
    -------
    JointMotion
        The same object where nothing was limited.
    """
    return _before_the_ends(limits, q, qd, _slower_tip(robot, limits, q, motion))


def _slower_tip(
    robot: Robot, limits: MotionLimits, q: FloatArray, motion: JointMotion
) -> JointMotion:
    _, jacobian, _ = tip_state(robot, q, np.zeros_like(q))
    speed = float(np.linalg.norm(jacobian @ motion.qd_r))
    if speed <= limits.tip_speed_m_s:
        return motion
    scale = limits.tip_speed_m_s / speed
    return replace(
        motion,
        qd_r=scale * motion.qd_r,
        qdd_r=scale * motion.qdd_r,
        notes=(*motion.notes, TIP_SPEED_NOTE),
    )


def _before_the_ends(
    limits: MotionLimits, q: FloatArray, qd: FloatArray, motion: JointMotion
) -> JointMotion:
    kept, qdd_r = motion.qd_r.copy(), motion.qdd_r.copy()
    beyond = q - limits.open_upper, limits.open_lower - q
    for i, side in product(range(len(q)), (UP, DOWN)):
        towards = 1.0 if side == UP else -1.0
        at = float(limits.lower[i]), float(limits.upper[i]), float(q[i]), float(beyond[side][i])
        most, fall = speed_before_end(limits.braking[side, i], *at)
        if kept[i] * towards > most:
            kept[i] = towards * most
            # The speed that is kept falls as fast as the joint comes nearer.
            slowing = fall * max(float(qd[i]) * towards, 0.0)
            qdd_r[i] = towards * min(float(qdd_r[i]) * towards, -slowing)
    if np.array_equal(kept, motion.qd_r):
        return motion
    return replace(motion, qd_r=kept, qdd_r=qdd_r, notes=(*motion.notes, END_NOTE))


def refuse_fast(
    robot: Robot,
    path: TipPath | JointPath,
    tip_speed_m_s: float,
    near: FloatArray | None = None,
    go_on: Callable[[], None] = always,
) -> None:
    """Refuse a path on which the tip is too fast: slowed, it would be another motion.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    tip_speed_m_s : float
    near : (n,) array, optional
        Where joints stay that a path of joints does not name (by default mid-range).
    go_on : callable
        As of `hydro_model.motion.paths_joints.joint_motion`.

    Raises
    ------
    ControlError
        Where and how fast it is.
    """
    times = check_times(path, _STEP_S)
    if isinstance(path, TipPath):
        velocities = path.sample_many(times)[1]
    else:
        q, qd, _ = joint_motion(robot, path, times, near, go_on)
        jacobian = in_pieces(partial(tip_jacobian, robot), q, go_on=go_on)
        velocities = np.einsum("tij,tj->ti", jacobian, qd)
    speeds = np.linalg.norm(velocities, axis=1)
    worst = int(np.argmax(speeds))
    if not speeds[worst] <= tip_speed_m_s:
        raise ControlError(
            f"the tip reaches {speeds[worst]:.3f} m/s at {times[worst]:.4f} s of the path,"
            f" expected at most {tip_speed_m_s:g} m/s (tip_speed_limit_m_s)"
        )


def relieved(signal: float, p_a: float, p_b: float, limit_pa: float) -> float:
    """A valve signal that does not feed a chamber whose pressure is at the limit.

    Parameters
    ----------
    signal : float
        Normalised; above 0 feeds chamber A.
    p_a, p_b : float
        Gauge, Pa.
    limit_pa : float

    Returns
    -------
    float
        The signal, faded to 0 over `RELIEF_BAND` of pressure below the limit; the way that
        empties the chamber stays open.
    """
    fed = p_a if signal > 0.0 else p_b
    return signal * min(max((limit_pa - fed) / (RELIEF_BAND * limit_pa), 0.0), 1.0)
