"""Rows of signals for laws: what of them is known of a robot, and what of a recording."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.effects import signals as sig
from hydro_model.hydraulics.cylinder import lever, lever_rate, piston_force, stroke
from hydro_model.robot import FloatArray, Robot


def other_joint(robot: Robot, joint: int) -> int:
    """The joint that a joint's laws may look at: the next outwards, or the one before the last.

    Parameters
    ----------
    robot : Robot
    joint : int

    Returns
    -------
    int
        -1 where there is no other joint.
    """
    if robot.dof < 2:
        return -1
    return joint + 1 if joint + 1 < robot.dof else joint - 1


def constant_signals(robot: Robot, cylinder: int | None, joint: int | None) -> dict[int, float]:
    """Signals that never change, by index.

    Parameters
    ----------
    robot : Robot
    cylinder, joint : int or None
        A cylinder, a joint without cylinder, or with both None the whole robot.

    Returns
    -------
    dict of int to float
    """
    known = {sig.ATMOSPHERIC_PRESSURE: float(robot.atmospheric_pressure_pa)}
    if joint is not None:
        place = robot.joints[joint]
        # A joint that turns without end has no travel of its own: one turn stands for it.
        known[sig.TRAVEL_LOW] = place.lower if math.isfinite(place.lower) else -math.pi
        known[sig.TRAVEL_HIGH] = place.upper if math.isfinite(place.upper) else math.pi
    if cylinder is None:
        return known
    c = robot.cylinders[cylinder]
    known |= {sig.TRAVEL_LOW: 0.0, sig.TRAVEL_HIGH: c.stroke_m}
    known |= {sig.AREA_A: c.area_a_m2, sig.AREA_B: c.area_b_m2}
    for valve in robot.valves:
        if valve.cylinder == c.name:
            edges = (valve.c_pa, valve.c_at, valve.c_pb, valve.c_bt)
            names = (sig.EDGE_PA, sig.EDGE_AT, sig.EDGE_PB, sig.EDGE_BT)
            known |= dict(zip(names, edges, strict=True))
    return known


def signal_rows(
    robot: Robot,
    cylinder: int | None,
    joint: int,
    time_s: ArrayLike,
    q: ArrayLike,
    qd: ArrayLike | None = None,
    qdd: ArrayLike | None = None,
    pressures: ArrayLike | None = None,
    valve_signal: ArrayLike | None = None,
    oil_c: ArrayLike | None = None,
) -> FloatArray:
    """Signals of one cylinder, or of a joint without one, over N samples.

    Parameters
    ----------
    robot : Robot
    cylinder : int or None
        Index of the cylinder; None for the joint itself, whose piston is then the joint.
    joint : int
        Index of the (cylinder's) joint.
    time_s : (N,) array
    q, qd, qdd : (N, n) array
        Of all joints; what is None stays NaN.
    pressures : (N, 4) array, optional
        Gauge pressures of chambers A and B, supply and tank, Pa.
    valve_signal : (N,) array, optional
        As the effects on it left it: the flows of the edges are those at this signal.
    oil_c : (N,) array, optional
        Oil temperature, deg C.

    Returns
    -------
    (N, SIGNAL_COUNT) array
        NaN where nothing is known.
    """
    times, position = np.asarray(time_s, float), np.asarray(q, float)
    s = np.full((len(times), sig.SIGNAL_COUNT), np.nan)
    for index, value in constant_signals(
        robot, cylinder, None if cylinder is not None else joint
    ).items():
        s[:, index] = value
    s[:, sig.TIME] = times
    if oil_c is not None:
        s[:, sig.OIL_TEMPERATURE] = oil_c
    _fill_motion(s, robot, cylinder, joint, position, qd, qdd)
    set_tip(s, robot, joint, position, None if qd is None else np.asarray(qd, float))
    if cylinder is None:
        return s
    if pressures is not None:
        table = np.asarray(pressures, float)
        order = (sig.PRESSURE_A, sig.PRESSURE_B, sig.SUPPLY_PRESSURE, sig.TANK_PRESSURE)
        s[:, order] = table
        s[:, sig.PISTON_FORCE] = piston_force(robot.cylinders[cylinder], table[:, 0], table[:, 1])
    if valve_signal is not None:
        set_valve_signal(s, robot, cylinder, np.asarray(valve_signal, float))
    return s


def set_valve_signal(s: FloatArray, robot: Robot, cylinder: int, valve_signal: FloatArray) -> None:
    """Write a valve signal, and the flows of the edges at it, into rows of signals.

    Parameters
    ----------
    s : (N, SIGNAL_COUNT) array
        With pressures; changed in place.
    robot : Robot
    cylinder : int
    valve_signal : (N,) array
    """
    from hydro_model.effects.valve_kernels import write_edge_flows

    s[:, sig.VALVE_SIGNAL] = valve_signal
    name = robot.cylinders[cylinder].name
    for valve in robot.valves:
        if valve.cylinder == name:
            write_edge_flows(s, valve.c_pa, valve.c_at, valve.c_pb, valve.c_bt)


def upwards(robot: Robot) -> FloatArray:
    """Unit vector (3,) against gravity in the base frame; its z axis where there is none."""
    gravity = np.asarray(robot.gravity_m_s2, float)
    size = float(np.linalg.norm(gravity))
    return -gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])


def set_tip(
    s: FloatArray, robot: Robot, joint: int, q: FloatArray, qd: FloatArray | None = None
) -> None:
    """Write the tip's height, its rate and its rise as a joint moves into rows of signals.

    Parameters
    ----------
    s : (N, SIGNAL_COUNT) array
        Changed in place.
    robot : Robot
    joint : int
    q : (N, n) array
    qd : (N, n) array, optional
        The rate stays as it is without.
    """
    from hydro_model.multibody.kinematics import tip_state

    if not len(q):
        return
    up = upwards(robot)
    position, jacobian, _ = tip_state(robot, q, np.zeros_like(q))
    s[:, sig.TIP_HEIGHT] = position @ up
    slopes = np.einsum("k,nkj->nj", up, jacobian)
    s[:, sig.TIP_SLOPE] = slopes[:, joint]
    if qd is not None:
        s[:, sig.TIP_RATE] = np.sum(slopes * qd, axis=1)


def _fill_motion(
    s: FloatArray,
    robot: Robot,
    cylinder: int | None,
    joint: int,
    q: FloatArray,
    qd: ArrayLike | None,
    qdd: ArrayLike | None,
) -> None:
    other = other_joint(robot, joint)
    arm, bend = np.ones(len(q)), np.zeros(len(q))
    s[:, sig.PISTON_POSITION] = q[:, joint]
    if cylinder is not None:
        c = robot.cylinders[cylinder]
        s[:, sig.PISTON_POSITION] = stroke(c, q[:, joint])
        arm, bend = lever(c, q[:, joint]), lever_rate(c, q[:, joint])
    s[:, sig.JOINT_POSITION], s[:, sig.LEVER] = q[:, joint], arm
    if other >= 0:
        s[:, sig.OTHER_POSITION] = q[:, other]
    if qd is None:
        return
    rate = np.asarray(qd, float)
    s[:, sig.JOINT_VELOCITY] = rate[:, joint]
    s[:, sig.PISTON_VELOCITY] = arm * rate[:, joint]
    if other >= 0:
        s[:, sig.OTHER_VELOCITY] = rate[:, other]
    if qdd is None:
        return
    second = np.asarray(qdd, float)
    s[:, sig.PISTON_ACCELERATION] = arm * second[:, joint] + bend * rate[:, joint] ** 2
    if other >= 0:
        s[:, sig.OTHER_ACCELERATION] = second[:, other]
