"""How fast a joint may still be towards an end of its range: what its cylinder can brake.

Near the end of a stroke the lever is short and gravity may push the same way: the deceleration
that is left there can be a tenth of that in mid-range. So the speed follows from the cylinder's
greatest force, the weight and the inertia, tabulated once over each joint's range.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.robot import Cylinder, FloatArray, Robot

#: Never counted on: a deceleration of more velocity limits per second, so 0.2 s from full speed.
BRAKING_PER_VELOCITY_1_S = 5.0
#: At least counted on, where nothing can brake at all: standing there is impossible as well.
LEAST_PER_VELOCITY_1_S = 0.05
#: Of what a cylinder has beyond the weight this share brakes; the rest is for masses, payloads
#: and pressures that are not as in the model.
BRAKING_SHARE = 0.7
#: Until a cylinder pushes the other way: its force follows at 15 to 36 1/s.
REACTION_S = 0.1
#: An arm beyond its end is asked back by the distance over this time: velocity alone would let it
#: creep on by what the valve's null is off.
RETURN_S = 0.3
#: Positions of a joint at which the speeds are tabulated.
POINTS = 65
#: Positions of each other joint that are looked at, for robots of up to three joints and of more.
_FEW_JOINTS, _POSES, _POSES_OF_MANY = 3, 5, 3

UP, DOWN = range(2)


def braking_energies(
    robot: Robot, lower: FloatArray, upper: FloatArray, speeds: FloatArray
) -> FloatArray:
    """Half the squares of the speeds from which joints stop before their ends.

    Deceleration is what the cylinder's greatest force leaves beyond the weight in the worst pose
    of the other joints, while these brake, too, by as many of their velocity limits per second.

    Parameters
    ----------
    robot : Robot
    lower, upper : (n,) array
        Ends, rad or m.
    speeds : (n,) array
        Velocity limits, rad/s or m/s.

    Returns
    -------
    (2, n, POINTS) array
        Towards the upper and the lower ends, at even distances from lower to upper end; 0 at
        the end itself, (rad/s)^2 or (m/s)^2.
    """
    energies = np.empty((2, robot.dof, POINTS))
    cylinders = {robot.joint_index(c.joint): c for c in robot.cylinders}
    for i in range(robot.dof):
        brake = _decelerations(robot, cylinders.get(i), i, lower, upper, speeds)
        step = (upper[i] - lower[i]) / (POINTS - 1)
        areas = 0.5 * step * (brake[:, 1:] + brake[:, :-1])
        energies[DOWN, i] = np.concatenate(([0.0], np.cumsum(areas[DOWN])))
        energies[UP, i] = np.concatenate((np.cumsum(areas[UP][::-1])[::-1], [0.0]))
    return energies


def _decelerations(
    robot: Robot,
    cylinder: Cylinder | None,
    i: int,
    lower: FloatArray,
    upper: FloatArray,
    speeds: FloatArray,
) -> FloatArray:
    """What a joint moving up and down can count on, (2, POINTS)."""
    most, least = BRAKING_PER_VELOCITY_1_S * speeds[i], LEAST_PER_VELOCITY_1_S * speeds[i]
    if cylinder is None:
        return np.full((2, POINTS), most)
    places = _POSES if robot.dof <= _FEW_JOINTS else _POSES_OF_MANY
    counts = [POINTS if j == i else places for j in range(robot.dof)]
    axes = [np.linspace(*ends) for ends in zip(lower, upper, counts, strict=True)]
    q = np.array(list(product(*axes)))
    weight = inverse_dynamics(robot, q, np.zeros_like(q), np.zeros_like(q))[:, i]
    inertia = np.abs(mass_matrix(robot, q)[:, i]) @ speeds
    p_s, p_t, arm = robot.supply_pressure_pa, robot.tank_pressure_pa, lever(cylinder, q[:, i])
    forces = (
        p_s * cylinder.area_a_m2 - p_t * cylinder.area_b_m2,
        p_t * cylinder.area_a_m2 - p_s * cylinder.area_b_m2,
    )
    torques = np.array([arm * force for force in forces])
    left = np.array([weight - torques.min(axis=0), torques.max(axis=0) - weight])
    # Links without inertia stop at once.
    found = BRAKING_SHARE * left * speeds[i] / np.maximum(inertia, np.finfo(float).tiny)
    others = tuple(j + 1 for j in range(robot.dof) if j != i)
    worst = found.reshape(2, *counts).min(axis=others)
    return np.asarray(np.clip(worst, least, most))


def speed_before_end(
    energies: FloatArray, lower: float, upper: float, q: float, beyond: float
) -> tuple[float, float]:
    """The greatest speed towards an end, and how it falls while the joint moves.

    A joint that goes on at the speed for `REACTION_S` and then brakes by the local deceleration
    a stops at the end: ``v = sqrt((a t)^2 + 2 e) - a t``.

    Parameters
    ----------
    energies : (POINTS,) array
        Of one joint and end, as of `braking_energies`.
    lower, upper : float
        Ends, rad or m.
    q : float
        Where the joint is, rad or m.
    beyond : float
        How far it is beyond where it may be, rad or m; not above 0 where it is not.

    Returns
    -------
    speed : float
        rad/s or m/s; 0 at the end, below 0 beyond where it may be.
    fall_1_s : float
        Its fall per distance towards the end, 1/s.
    """
    step = (upper - lower) / (POINTS - 1)
    at = min(max((q - lower) / step, 0.0), POINTS - 1.0)
    k = min(int(at), POINTS - 2)
    rise = float(energies[k + 1] - energies[k])
    energy, brake = float(energies[k]) + (at - k) * rise, abs(rise) / step
    early = brake * REACTION_S
    speed = math.sqrt(early * early + 2.0 * energy) - early
    return speed - max(beyond, 0.0) / RETURN_S, brake / (speed + early)
