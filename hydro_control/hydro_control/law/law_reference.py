"""Equations 19 to 24 at one sample as one reads them: numpy by joint, no compilation.

The compiled kernels of `hydro_control.law.law_kernels` are tested against these. The required
motion is in `hydro_control.motion.required_motion`, its limits are in
`hydro_control.motion.motion_limits`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_control.gains import Gains
from hydro_control.law.law_kernels import Required
from hydro_control.motion.motion_limits import MotionLimits, limited, relieved
from hydro_control.motion.required_motion import JointMotion, Reference, required_motion
from hydro_control.state.axes import Axis
from hydro_control.state.oil_columns import OilColumns, piston_positions, swept_columns
from hydro_control.state.state import State
from hydro_model.hydraulics.cylinder import lever
from hydro_model.hydraulics.valve import signal_at_lengths
from hydro_model.multibody.rigid_body import required_torque
from hydro_model.robot import FloatArray, Robot


def required(
    robot: Robot,
    axes: Sequence[Axis],
    limits: MotionLimits,
    gains: Gains,
    state: State,
    reference: Reference,
) -> tuple[Required, JointMotion]:
    """Required motion and piston forces without listed effects (eqs. 19 to 22).

    Parameters
    ----------
    robot : Robot
    axes : sequence of Axis
        Of the robot.
    limits : MotionLimits
    gains : Gains
    state : State
    reference : Reference

    Returns
    -------
    Required
    JointMotion
        With the tip's desired position and what limited the motion.
    """
    q, qd = state.q, state.qd
    motion = required_motion(robot, q, qd, reference, gains.k_p_1_s)
    motion = limited(robot, limits, q, qd, motion)
    arm = np.array([float(lever(a.cylinder, x)) for a, x in zip(axes, q, strict=True)])
    xd, xd_r = arm * qd, arm * motion.qd_r
    columns = swept_columns(axes, q)
    torque = required_torque(robot, q, qd, motion.qd_r, motion.qdd_r, gains.k_v)
    friction = np.array([a.cylinder.viscous_friction for a in axes]) * xd_r
    force_d = torque / arm + friction
    of_motion = motion.q_d, motion.qd_d, motion.qd_r, motion.qdd_r
    lengths = columns.a_m, columns.b_m
    x = piston_positions(axes, q)
    return Required(*of_motion, arm, x, xd, xd_r, *lengths, force_d), motion


def flow_term(
    axes: Sequence[Axis],
    gains: Gains,
    state: State,
    asked: Required,
    force_rate: FloatArray,
    columns: OilColumns,
) -> FloatArray:
    """Q_d of eq. 23 (corrected).

    Parameters
    ----------
    axes : sequence of Axis
    gains : Gains
    state : State
    asked : Required
    force_rate : (n,) array
        Filtered rate of the required force, N/s.
    columns : OilColumns

    Returns
    -------
    (n,) array
        m^2/s.
    """
    by_force = gains.k_f_m2_ns * (asked.force_d - state.force)
    feedback = by_force + gains.k_x_m * (asked.xd_r - asked.xd)
    forward = np.empty_like(force_rate)
    for i, axis in enumerate(axes):
        c = axis.cylinder
        area = c.area_a_m2 / columns.a_m[i] + c.area_b_m2 / columns.b_m[i]
        forward[i] = -area * asked.xd_r[i] - force_rate[i] / c.bulk_modulus_pa
    if columns.leak is not None:
        forward += columns.leak
    return np.asarray(forward - feedback)


def openings(
    axes: Sequence[Axis], flow: FloatArray, columns: OilColumns, state: State
) -> FloatArray:
    """Openings of the valves' edges for flow terms (eq. 24).

    Parameters
    ----------
    axes : sequence of Axis
    flow : (n,) array
        m^2/s.
    columns : OilColumns
    state : State
        For its pressures.

    Returns
    -------
    (n,) array
        Normalised, not saturated.
    """
    found = []
    for i, axis in enumerate(axes):
        p_a, p_b = state.pressures[:, axis.cylinder_index]
        lengths = columns.a_m[i], columns.b_m[i]
        u = signal_at_lengths(axis.valve, flow[i], *lengths, p_a, p_b, state.p_s, state.p_t)
        found.append(float(u))
    return np.array(found)


def voltages(
    axes: Sequence[Axis],
    limits: MotionLimits,
    signal: FloatArray,
    pressures: FloatArray,
    before_v: FloatArray,
    most_v: float,
) -> FloatArray:
    """Voltages for signals: relieved, saturated and slewed.

    Parameters
    ----------
    axes : sequence of Axis
    limits : MotionLimits
    signal : (n,) array
        Normalised.
    pressures : (2, m) array
        Gauge, Pa.
    before_v : (m,) array
        Per valve in the robot's order, one sample ago.
    most_v : float
        Greatest step.

    Returns
    -------
    (m,) array
        V.
    """
    wanted = np.zeros_like(before_v)
    for i, axis in enumerate(axes):
        p_a, p_b = pressures[:, axis.cylinder_index].tolist()
        rated = axis.valve.rated_voltage_v
        u = relieved(float(signal[i]), p_a, p_b, limits.pressure_pa)
        wanted[axis.valve_index] = np.clip(u * rated, -rated, rated)
    return np.clip(wanted, before_v - most_v, before_v + most_v)
