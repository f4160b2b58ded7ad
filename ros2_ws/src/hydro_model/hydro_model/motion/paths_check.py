"""Can a robot follow a path: joint limits, strokes, speeds, and what its valves can pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import lever, piston_force, stroke
from hydro_model.motion.paths import JointPath, Path, TipPath
from hydro_model.motion.paths_joints import joint_motion
from hydro_model.motion.row_pieces import always, in_pieces
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import Cylinder, FloatArray, Robot, Valve

#: Spacing at which a path is checked, s. Of a sine of 3 Hz (designed chirps end at 2.5) the peak
#: is missed by less than 2 %.
CHECK_STEP_S = 0.02
#: Pieces into which a segment is cut at least, however short it is. A quintic's acceleration that
#: keeps a limit at their ends exceeds it between them by 8 % at most, its speed by 22 %.
_LEAST_PIECES = 8


@dataclass(frozen=True, slots=True)
class PathCheck:
    """What a path asks of a robot; arrays per joint (n,) or per cylinder (m,).

    Attributes
    ----------
    duration_s : float
    start_position : (n,) array
        Joint positions at the start.
    lower, upper, peak_velocity : (n,) array
        Range of joint positions, and greatest joint speed.
    peak_acceleration, peak_acceleration_at_s : (n,) array
        Greatest joint acceleration, and when it is.
    stroke_lower_m, stroke_upper_m, peak_piston_velocity_m_s : (m,) array
    flow_share : (m,) array
        Greatest piston speed over the steady speed that the fully open valve gives against the
        load of that instant; above 1 cannot be followed. 0 where there is no valve or supply.
    """

    duration_s: float
    start_position: FloatArray
    lower: FloatArray
    upper: FloatArray
    peak_velocity: FloatArray
    peak_acceleration: FloatArray
    peak_acceleration_at_s: FloatArray
    stroke_lower_m: FloatArray
    stroke_upper_m: FloatArray
    peak_piston_velocity_m_s: FloatArray
    flow_share: FloatArray


def check_path(
    robot: Robot,
    path: TipPath | JointPath,
    *,
    near: FloatArray | None = None,
    margin: float | FloatArray = 0.0,
    flow_limit: float = np.inf,
    step_s: float = CHECK_STEP_S,
    go_on: Callable[[], None] = always,
) -> PathCheck:
    """Check a path against a robot.

    Parameters
    ----------
    robot : Robot
    path : TipPath or JointPath
    near : (n,) array, optional
        Joint positions at the start.
    margin : float or (n,) array
        Distance kept from the joint limits, rad or m.
    flow_limit : float
        Greatest `PathCheck.flow_share` allowed.
    step_s : float
        Spacing of the check; shorter where a segment of the path is short.
    go_on : callable
        Called again and again on the way: what it raises ends the check.

    Returns
    -------
    PathCheck

    Raises
    ------
    RobotError
        A limit is exceeded: which, by how much and when. One is the weight that a cylinder can
        hold at the supply's pressure.
    """
    times = check_times(path, step_s)
    q, qd, qdd = joint_motion(robot, path, times, near, go_on)
    go_on()
    if not all(np.isfinite(values).all() for values in (q, qd, qdd)):
        # No comparison with what is no number holds.
        raise RobotError("expected a motion of finite numbers, found some beyond their range")
    _refuse_beyond_joints(robot, times, q, qd, margin)
    x, xd, share = _pistons(robot, q, qd, qdd, go_on)
    _refuse_beyond_cylinders(robot, times, x, share, flow_limit)
    _refuse_unholdable(robot, times, q, go_on)
    return PathCheck(
        duration_s=path.duration_s,
        start_position=q[0],
        lower=q.min(axis=0),
        upper=q.max(axis=0),
        peak_velocity=np.abs(qd).max(axis=0),
        peak_acceleration=np.abs(qdd).max(axis=0),
        peak_acceleration_at_s=times[np.abs(qdd).argmax(axis=0)],
        stroke_lower_m=x.min(axis=0),
        stroke_upper_m=x.max(axis=0),
        peak_piston_velocity_m_s=np.abs(xd).max(axis=0),
        flow_share=share.max(axis=0),
    )


def check_times(path: Path, step_s: float) -> FloatArray:
    """Times at which a path is checked: its segments' ends, and several inside every segment.

    Parameters
    ----------
    path : Path
    step_s : float
        They are no further apart.

    Returns
    -------
    (N,) array
        Ascending, from 0 to the end of the path.
    """
    edges = sorted({0.0, *path.breaks_s})
    parts = [
        np.linspace(a, b, max(_LEAST_PIECES, int(np.ceil((b - a) / step_s))), endpoint=False)
        for a, b in pairwise(edges)
    ]
    return np.concatenate([*parts, [path.duration_s]])


def _limit(times: FloatArray, values: FloatArray, limit: float, what: str, bound: str) -> None:
    worst = int(np.argmax(values))  # of NaN the first
    if not values[worst] <= limit + 1e-9:
        sign = -1.0 if bound == "at least" else 1.0
        raise RobotError(
            f"{what} {sign * values[worst]:.4g} at {times[worst]:.2f} s,"
            f" expected {bound} {sign * limit:.4g}"
        )


def _refuse_beyond_joints(
    robot: Robot, times: FloatArray, q: FloatArray, qd: FloatArray, margin: float | FloatArray
) -> None:
    """Refuse joints nearer to an end than `margin`, or faster than they may be."""
    margins = np.broadcast_to(margin, robot.dof).tolist()
    for i, (joint, kept) in enumerate(zip(robot.joints, margins, strict=True)):
        name = f"joint '{joint.name}'"
        _limit(times, q[:, i], joint.upper - kept, f"{name} goes to", "at most")
        _limit(times, -q[:, i], -joint.lower - kept, f"{name} goes to", "at least")
        speed = np.abs(qd[:, i])
        _limit(times, speed, joint.velocity_limit, f"{name} reaches a speed of", "at most")


def _refuse_beyond_cylinders(
    robot: Robot, times: FloatArray, x: FloatArray, share: FloatArray, flow_limit: float
) -> None:
    """Refuse strokes that a cylinder does not have, and flow that its valve does not pass."""
    for i, cylinder in enumerate(robot.cylinders):
        name = f"cylinder '{cylinder.name}'"
        _limit(times, x[:, i], cylinder.stroke_m, f"{name} goes to", "at most")
        _limit(times, -x[:, i], 0.0, f"{name} goes to", "at least")
        what = f"{name} needs a share of its valve's flow of"
        _limit(times, share[:, i], flow_limit, what, "at most")


def _refuse_unholdable(
    robot: Robot, times: FloatArray, q: FloatArray, go_on: Callable[[], None]
) -> None:
    """Refuse poses whose weight no pressure at the valve's ports can hold.

    From one of these the way out is open: none is worse than the first.
    """
    if robot.supply_pressure_pa <= 0.0:
        return
    weight = _torques(robot, q, np.zeros_like(q), np.zeros_like(q), go_on)
    ports = robot.supply_pressure_pa, robot.tank_pressure_pa
    fed = {valve.cylinder for valve in robot.valves}
    for cylinder in (c for c in robot.cylinders if c.name in fed):
        j = robot.joint_index(cylinder.joint)
        force = weight[:, j] / lever(cylinder, q[:, j])
        most, least = piston_force(cylinder, *ports), piston_force(cylinder, *ports[::-1])
        share = np.where(force >= 0.0, force / most, force / least)
        what = f"cylinder '{cylinder.name}' would have to hold, in shares of what it can,"
        _limit(times, share, max(1.0, float(share[0])), what, "at most")


def _torques(
    robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray, go_on: Callable[[], None]
) -> FloatArray:
    return in_pieces(partial(inverse_dynamics, robot), q, qd, qdd, go_on=go_on)


def _pistons(
    robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray, go_on: Callable[[], None]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stroke, piston velocity and share of the valve's flow, (N, m) each."""
    torque = _torques(robot, q, qd, qdd, go_on)
    shape = (len(q), len(robot.cylinders))
    x, xd, share = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    valves = {valve.cylinder: valve for valve in robot.valves}
    for i, cylinder in enumerate(robot.cylinders):
        j = robot.joint_index(cylinder.joint)
        arm = lever(cylinder, q[:, j])
        x[:, i], xd[:, i] = stroke(cylinder, q[:, j]), arm * qd[:, j]
        if cylinder.name in valves and robot.supply_pressure_pa > 0.0:
            force = torque[:, j] / arm + cylinder.viscous_friction * xd[:, i]
            share[:, i] = _flow_share(robot, cylinder, valves[cylinder.name], xd[:, i], force)
    return x, xd, share


def _flow_share(
    robot: Robot, cylinder: Cylinder, valve: Valve, xd: FloatArray, force: FloatArray
) -> FloatArray:
    """Piston speed over the steady speed of the fully open valve against a force.

    From eqs. 9, 11 and 12 at u = 1 and constant pressures, with the edge losses
    ``(A v / C)^2``: extending, ``f = A1 ps - A2 pt - v^2 (A1^3 / C_PA^2 + A2^3 / C_BT^2)``.
    """
    a1, a2 = cylinder.area_a_m2, cylinder.area_b_m2
    p_s, p_t = robot.supply_pressure_pa, robot.tank_pressure_pa
    extend = (a1 * p_s - a2 * p_t - force) / (a1**3 / valve.c_pa**2 + a2**3 / valve.c_bt**2)
    retract = (force - a1 * p_t + a2 * p_s) / (a1**3 / valve.c_at**2 + a2**3 / valve.c_pb**2)
    squared = np.where(xd >= 0.0, extend, retract)
    fastest = np.sqrt(np.maximum(squared, 0.0))
    return np.where(fastest > 0.0, np.abs(xd) / np.maximum(fastest, 1e-12), np.inf)
