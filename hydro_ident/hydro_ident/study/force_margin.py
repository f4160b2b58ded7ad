"""How much force a machine has to spare along a path, by its truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_hw_bridge.rig.plant import Plant
from hydro_hw_bridge.rig.pose import joints_for_tip
from hydro_hw_bridge.rig.truth import Truth
from hydro_model.hydraulics.cylinder import lever
from hydro_model.motion.paths import TipPath
from hydro_model.robot import FloatArray, Robot

_STEP_S = 0.02
#: Coulomb friction is rounded over this piston speed, m/s.
_ROUNDING_M_S = 0.002


@dataclass(frozen=True, slots=True)
class Motion:
    """A path as joint motion: positions, velocities and accelerations, (N, n) each."""

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray


def motion_along(robot: Robot, path: TipPath) -> Motion:
    """The joint motion that follows a path of the tip."""
    count = int(path.duration_s / _STEP_S) + 1
    q = np.array([joints_for_tip(robot, path.sample(k * _STEP_S)[0]) for k in range(count)])
    qd = np.gradient(q, _STEP_S, axis=0)
    return Motion(q, qd, np.gradient(qd, _STEP_S, axis=0))


def force_margin(robot: Robot, truth: Truth, motion: Motion) -> float:
    """Smallest share of the available piston force that a path leaves.

    Available is what the cylinder gives with its valve fully open at the wanted speed, steadily:
    for an extending piston ``A1 (ps - (A1 v / c_pa)^2) - A2 (pt + (A2 v / c_bt)^2)``, with supply
    and tank pressure as the flow of all cylinders leaves them.

    Parameters
    ----------
    robot : Robot
    truth : Truth
    motion : Motion

    Returns
    -------
    float
        Over path and cylinders; 0 and below: no controller follows. 0 where a pose is beyond
        reach of the supply at rest.

    Raises
    ------
    BridgeError
        The machine cannot hold the path's start.
    """
    force, speed = _required(robot, truth, motion)
    push, pull = _available(robot, truth, speed)
    out = np.where(speed >= 0.0, 1.0 - force / push, 1.0 + force / pull)
    possible = np.where(speed >= 0.0, push, pull) > 0.0
    return float(np.min(np.where(possible, out, 0.0)))


def _required(robot: Robot, truth: Truth, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Piston forces with friction, and piston speeds, (N, m) each."""
    q, qd = motion.q, motion.qd
    plant = Plant(robot, truth, q[0])
    joint = [robot.joint_index(c.joint) for c in robot.cylinders]
    force = np.empty((len(q), len(robot.cylinders)))
    for k, (at, rate, acceleration) in enumerate(zip(q, qd, motion.qdd, strict=True)):
        matrix, bias, levers = plant.equations(at, rate)
        force[k] = (matrix @ acceleration + bias)[joint] / levers
    arms = [np.asarray(lever(c, q[:, robot.joint_index(c.joint)])) for c in robot.cylinders]
    rates = [qd[:, robot.joint_index(c.joint)] for c in robot.cylinders]
    speed = np.stack([a * r for a, r in zip(arms, rates, strict=True)], axis=1)
    dry = np.array([c.coulomb_friction_n for c in truth.cylinders])
    viscous = np.array([c.viscous_friction for c in truth.cylinders])
    return force + dry * np.tanh(speed / _ROUNDING_M_S) + viscous * speed, speed


def _available(robot: Robot, truth: Truth, speed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Force pushing and pulling (N, m) with the valves fully open."""
    a = np.array([c.area_a_m2 for c in robot.cylinders])
    b = np.array([c.area_b_m2 for c in robot.cylinders])
    supply = truth.supply
    drawn = np.where(speed > 0.0, a * speed, -b * speed).sum(axis=1)
    back = np.where(speed > 0.0, b * speed, -a * speed).sum(axis=1)
    p_s = supply.pressure_pa - supply.droop * drawn - supply.droop_quadratic * drawn**2
    p_t = supply.tank_pressure_pa + supply.tank_resistance * back**2
    c_pa, c_at, c_pb, c_bt = (
        np.array([getattr(v, edge) for v in truth.valves])
        for edge in ("c_pa", "c_at", "c_pb", "c_bt")
    )
    square = speed**2
    push = a * (p_s[:, None] - a**2 * square / c_pa**2)
    push -= b * (p_t[:, None] + b**2 * square / c_bt**2)
    pull = b * (p_s[:, None] - b**2 * square / c_pb**2)
    pull -= a * (p_t[:, None] + a**2 * square / c_at**2)
    return push, pull
