"""Largest plausible sizes of the forces' parameters on a machine: what is less sure is not known.

Sizes come from the robot file: its mass, its reach, the force limits and speeds of its joints.
Some files have placeholders there (1 kg per link, `effort="100"`), which must not make good
estimates unknown. So what fits have found counts where it shows more than the file says.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.forces.force_rows import ForceModel
from hydro_model.arrays import BoolArray
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.joint_ranges import limits
from hydro_model.robot import FloatArray, Joint, Robot

#: A file of less mass states none.
LEAST_MASS_KG = 1.0
#: Of a link's value so many deviations from zero the size of all others follows. A fit to hardly
#: any motion finds large values of a few deviations, and one of them would make all others known.
CLEAR_DEVIATIONS = 10.0
#: A value of so many is no chance (2e-7 in normal noise, 0.05 % in Student's of ten degrees of
#: freedom) and known to a fifth, whatever a file says of its size; of others it says nothing.
OWN_DEVIATIONS = 5.0
#: Shortest reach, m: a robot of one link at the origin has none of its own.
_LEAST_REACH_M = 0.1


def parameter_scales(
    model: ForceModel, theta: FloatArray | None = None, std: FloatArray | None = None
) -> FloatArray:
    """Largest plausible size of every parameter: total mass times powers of the reach.

    The mass is the robot file's or, where they show more, what found values show of it.

    For friction, the force limit of the joint (its cylinder) over its rated speed, infinity where
    either has no limit; a joint that carries the mass found at the robot's reach has that torque,
    whatever its limit says. For effects, infinity (their bounds are the catalogue's).

    Parameters
    ----------
    model : ForceModel
    theta, std : array, optional
        Values that were found and their deviations, base parameters first; deviations of what
        other parameters take for themselves are infinite.

    Returns
    -------
    (p,) array
    """
    robot = model.robot
    reach = reach_m(robot)
    per_mass = np.array([reach ** _power(name) for name in model.base.names])
    mass = max(float(robot.link_inertia[:, 0].sum()), LEAST_MASS_KG)
    known = np.zeros(len(model.names))
    weight = 0.0
    if theta is not None and std is not None:
        of_links = per_mass[: model.base.link_count]
        mass = max([mass, *_shown_masses(of_links, theta, std)])
        weight = mass * float(np.linalg.norm(robot.gravity_m_s2))
        told = _clear(theta, std, OWN_DEVIATIONS)
        known[: theta.size][told] = np.abs(theta[told]) / OWN_DEVIATIONS
    friction = []
    for cylinder in robot.cylinders:
        at = robot.joint_index(cylinder.joint)
        lower, upper = limits(robot)[at].tolist()
        arm = float(np.abs(lever(cylinder, np.linspace(lower, upper, 21))).max())
        friction.append(_friction_scale(robot.joints[at], weight, reach, arm))
    friction += [_friction_scale(robot.joints[j], weight, reach) for j in robot.dry_joints]
    scales = np.array([*(mass * per_mass), *friction, *[np.inf] * len(model.effect_names)])
    return np.asarray(np.maximum(scales, known))


def reach_m(robot: Robot) -> float:
    """How far from its base a robot's tip can be at most, m, as its joints and limits say.

    A slide counts with its travel, wherever the zero of its position is.

    Parameters
    ----------
    robot : Robot
    """
    reach = float(np.linalg.norm(robot.tip_offset_m))
    for joint in robot.joints:
        ends = _ends_m(robot, joint) if joint.prismatic else [0.0]
        along = joint.rotation @ joint.axis
        reach += max(float(np.linalg.norm(joint.translation_m + q * along)) for q in ends)
    return max(reach, _LEAST_REACH_M)


def _ends_m(robot: Robot, joint: Joint) -> list[float]:
    """Ends of a slide's travel; an endless one has its cylinder's, or none that is known."""
    ends = [joint.lower, joint.upper]
    for cylinder in robot.cylinders:
        if cylinder.joint == joint.name and not np.isfinite(ends).all():
            ends = [cylinder.x0_m, cylinder.x0_m + cylinder.stroke_m]
    return [float(q) if np.isfinite(q) else 0.0 for q in ends]


def _power(name: str) -> int:
    """Power of a length in a base parameter: 0 of a mass, 1 of a moment, 2 of an inertia."""
    kind = name.rsplit(".", 1)[-1]
    return 0 if kind == "mass" else 1 if kind.startswith("mc") else 2


def _clear(theta: FloatArray, std: FloatArray, deviations: float) -> BoolArray:
    """Which values are more than so many deviations from zero; what has none was not fitted."""
    return np.asarray(np.isfinite(theta) & (std > 0.0) & (np.abs(theta) > deviations * std))


def _shown_masses(per_mass: FloatArray, theta: FloatArray, std: FloatArray) -> list[float]:
    """Masses in kg that there must be at least, by base parameters that are clearly not zero."""
    size, deviation = theta[: per_mass.size], std[: per_mass.size]
    clear = _clear(size, deviation, CLEAR_DEVIATIONS)
    shown: list[float] = (np.abs(size[clear]) / per_mass[clear]).tolist()
    return shown


def _friction_scale(joint: Joint, weight_n: float, reach: float, arm_m: float = 1.0) -> float:
    """Force limit over rated speed of a joint, or of the cylinder with this lever on it."""
    # An unlimited joint says nothing about the size of its friction.
    if not np.isfinite([joint.effort_limit, joint.velocity_limit]).all():
        return float(np.inf)
    effort = max(joint.effort_limit, weight_n if joint.prismatic else weight_n * reach)
    return effort / arm_m / (joint.velocity_limit * arm_m)
