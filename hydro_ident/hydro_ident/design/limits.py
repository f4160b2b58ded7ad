"""How near a motion comes to the limits of a robot, as smooth ratios that an optimiser can use.

`hydro_model.motion.paths_check` judges a finished path and says what is wrong where; here every
limit is a ratio that is at most 1 where it holds, for any number of samples at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_control.motion.motion_limits import TIP_SPEED_M_S
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.multibody.joint_ranges import limits as joint_limits
from hydro_model.multibody.joint_ranges import middle
from hydro_model.multibody.kinematics import tip_jacobian
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.robot import Cylinder, FloatArray, Robot, Valve


@dataclass(frozen=True, slots=True)
class Limits:
    """What a designed motion keeps.

    Attributes
    ----------
    margin : float
        Distance from the joint limits, rad or m; `margins` has it of every joint.
    stroke_margin : float
        Distance of a piston from either end, over its stroke: a small chamber is stiff, and a
        controller tuned elsewhere rings on it.
    speed : float
        Share of the joints' velocity limits, and of `tip_speed_m_s`.
    tip_speed_m_s : float
        At which the controller refuses a path, unless it was told another limit.
    flow : float
        Share of the piston speed that the fully open valve gives against the load.
    force : float
        Share of the piston force that the supply can give, either way: the rest is for friction,
        for what the datasheet does not know and for the controller.
    swing : float
        Force that acceleration takes, over the range of forces. A quick swing of the load starves
        the chamber that the valve has just opened to the tank.
    frequency : float
        Hydraulic natural frequency of a cylinder over that at the middle of the joints' ranges.
        Where the lever is short and the load far out the mode is slow, and a controller tuned
        elsewhere loses its damping.
    """

    margin: float = 0.05
    stroke_margin: float = 0.15
    speed: float = 0.9
    tip_speed_m_s: float = TIP_SPEED_M_S
    flow: float = 0.54
    force: float = 0.9
    swing: float = 0.18
    frequency: float = 0.75


def limit_ratios(
    robot: Robot, limits: Limits, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> FloatArray:
    """How much of every limit a motion uses.

    Parameters
    ----------
    robot : Robot
    limits : Limits
    q, qd, qdd : (N, n) array

    Returns
    -------
    (N, c) array
        At most 1 where a limit holds: position, speed and torque of every joint; stroke and mode
        of every cylinder, and with a supply swing, force and (with a valve) flow; the tip's speed.
    """
    torque = np.asarray(inverse_dynamics(robot, q, qd, qdd))
    inertia = np.asarray(mass_matrix(robot, q))
    swing = np.einsum("tij,tj->ti", inertia, qdd)
    columns = []
    reach, centre = room(robot, limits), middle(robot)
    for j, joint in enumerate(robot.joints):
        columns.append(np.abs(q[:, j] - centre[j]) / reach[j])
        columns.append(np.abs(qd[:, j]) / (limits.speed * joint.velocity_limit))
        columns.append(np.abs(torque[:, j]) / joint.effort_limit)
    valves = {valve.cylinder: valve for valve in robot.valves}
    usual = natural_frequencies_hz(robot, middle(robot)[None])[0]
    frequency = _frequencies_hz(robot, q, inertia)
    for i, cylinder in enumerate(robot.cylinders):
        j = robot.joint_index(cylinder.joint)
        x, arm = stroke(cylinder, q[:, j]), np.asarray(lever(cylinder, q[:, j]))
        half = 0.5 * cylinder.stroke_m
        columns.append(np.abs(x / half - 1.0) / (1.0 - 2.0 * limits.stroke_margin))
        columns.append(limits.frequency * usual[i] / frequency[:, i])
        if robot.supply_pressure_pa <= 0.0:
            continue
        speed = arm * qd[:, j]
        force = torque[:, j] / arm + cylinder.viscous_friction * speed
        low, high = force_range(robot, cylinder)
        columns.append(np.abs(swing[:, j] / arm) / (limits.swing * (high - low)))
        columns += _hydraulic_ratios(
            robot, limits, cylinder, valves.get(cylinder.name), speed, force
        )
    columns.append(tip_speeds(robot, q, qd) / (limits.speed * limits.tip_speed_m_s))
    return np.column_stack(columns)


def tip_speeds(robot: Robot, q: FloatArray, qd: FloatArray) -> FloatArray:
    """How fast the tip is, m/s, (N,), at joint positions and velocities, (N, n) each."""
    velocities = np.einsum("tij,tj->ti", np.asarray(tip_jacobian(robot, q)), qd)
    return np.asarray(np.linalg.norm(velocities, axis=1))


def half_range(robot: Robot) -> FloatArray:
    """Half of the joints' ranges."""
    low, high = joint_limits(robot).T
    return np.asarray(0.5 * (high - low))


def margins(robot: Robot, limits: Limits) -> FloatArray:
    """Distance that is kept from the limits of every joint, rad or m, (n,).

    No more than is kept from a piston's ends: of a range of some centimetres `Limits.margin`
    would leave nothing.
    """
    return np.minimum(limits.margin, 2.0 * limits.stroke_margin * half_range(robot))


def room(robot: Robot, limits: Limits) -> FloatArray:
    """Distance from the middle that a design may use of every joint, rad or m, (n,)."""
    return half_range(robot) - margins(robot, limits)


def force_range(robot: Robot, cylinder: Cylinder) -> tuple[float, float]:
    """Least and greatest piston force at rest (eq. 9), N: one chamber at supply, one at tank."""
    a1, a2 = cylinder.area_a_m2, cylinder.area_b_m2
    p_s, p_t = robot.supply_pressure_pa, robot.tank_pressure_pa
    return a1 * p_t - a2 * p_s, a1 * p_s - a2 * p_t


def edge_losses(cylinder: Cylinder, valve: Valve) -> tuple[float, float]:
    """Piston force that squared speed costs at the open valve, N s^2/m^2, extending, retracting.

    Eqs. 9, 11 and 12 at u = 1: ``f = A1 ps - A2 pt - v^2 (A1^3 / C_PA^2 + A2^3 / C_BT^2)``.
    """
    a1, a2 = cylinder.area_a_m2**3, cylinder.area_b_m2**3
    return a1 / valve.c_pa**2 + a2 / valve.c_bt**2, a1 / valve.c_at**2 + a2 / valve.c_pb**2


def _hydraulic_ratios(
    robot: Robot,
    limits: Limits,
    cylinder: Cylinder,
    valve: Valve | None,
    speed: FloatArray,
    force: FloatArray,
) -> list[FloatArray]:
    low, high = force_range(robot, cylinder)
    ratios = [np.where(force >= 0.0, force / high, force / low) / limits.force]
    if valve is not None:
        extending, retracting = edge_losses(cylinder, valve)
        used = (speed / limits.flow) ** 2 * np.where(speed >= 0.0, extending, retracting)
        # Force and the loss at the valve share the pressure: their sum must fit (squared speeds
        # add to forces, so the ratio stays finite where no force is left).
        ratios.append(np.where(speed >= 0.0, (force + used) / high, (force - used) / low))
    return ratios


def fits(robot: Robot, limits: Limits, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> bool:
    """Whether a motion keeps every limit."""
    return bool(limit_ratios(robot, limits, q, qd, qdd).max() <= 1.0)


def natural_frequencies_hz(robot: Robot, q: FloatArray) -> FloatArray:
    """Hydraulic natural frequency of every cylinder at poses, the other joints held.

    ``w^2 = beta (A1 / x + A2 / (S - x)) (dx/dq)^2 / M_jj``.

    Parameters
    ----------
    robot : Robot
    q : (N, n) array

    Returns
    -------
    (N, m) array
    """
    return _frequencies_hz(robot, q, np.asarray(mass_matrix(robot, q)))


def _frequencies_hz(robot: Robot, q: FloatArray, inertia: FloatArray) -> FloatArray:
    found = np.zeros((len(q), len(robot.cylinders)))
    for i, cylinder in enumerate(robot.cylinders):
        j, length = robot.joint_index(cylinder.joint), cylinder.stroke_m
        x = np.clip(stroke(cylinder, q[:, j]), 0.02 * length, 0.98 * length)
        area = cylinder.area_a_m2 / x + cylinder.area_b_m2 / (length - x)
        stiffness = cylinder.bulk_modulus_pa * area * lever(cylinder, q[:, j]) ** 2
        found[:, i] = np.sqrt(np.maximum(stiffness, 1e-9) / inertia[:, j, j]) / (2.0 * np.pi)
    return found
