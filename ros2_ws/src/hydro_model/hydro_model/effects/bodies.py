"""Masses and gravity that the description lacks: effects that make another robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import ParameterSpec
from hydro_model.robot import STANDARD_PARAMETERS, FloatArray, Robot

#: A barrel or rod is taken for a slender rod of this share of the pin-to-pin length at x = 0.
PART_LENGTH = 1.0


def _with_payload(robot: Robot, target: str, parameters: FloatArray) -> Robot:
    """A point mass at the tip, carried by the last link."""
    from hydro_model.multibody.payload_parameters import inertia_map
    from hydro_model.multibody.spatial import motion_transform

    body = np.zeros(len(STANDARD_PARAMETERS))
    body[0] = parameters[0]
    at_tip = motion_transform(np.eye(3), np.asarray(robot.tip_offset_m))
    inertia = robot.link_inertia.copy()
    inertia[-1] += inertia_map(at_tip) @ body
    return replace(robot, link_inertia=inertia)


def _with_cylinder_bodies(robot: Robot, target: str, parameters: FloatArray) -> Robot:
    """Slender barrel and rod on the line between the pins, on top of what is there."""
    chains = [c.name for c in robot.closed_chains]
    cylinder = robot.cylinder(target)
    parts = robot.part_parameters.copy()
    if target not in chains:
        return _with_points(robot, robot.joint_index(cylinder.joint), parameters)
    length = PART_LENGTH * cylinder.x0_m
    slender = np.array([1.0, length / 2.0, length**2 / 3.0])
    at = 2 * chains.index(target)
    parts[at : at + 2] += np.outer(parameters[:2], slender)
    return replace(robot, part_inertia=parts)


def _with_points(robot: Robot, at: int, parameters: FloatArray) -> Robot:
    """Barrel and rod of a prismatic joint: parts of the links before and behind it.

    Where along the joint they are nothing says: points at its origin in either link.
    """
    from hydro_model.multibody.part_regrouping import point_mass

    inertia = robot.link_inertia.copy()
    inertia[at] += parameters[1] * point_mass(np.zeros(3))
    if at > 0:
        inertia[at - 1] += parameters[0] * point_mass(np.asarray(robot.joints[at].translation_m))
    return replace(robot, link_inertia=inertia)


def _tilted(robot: Robot, target: str, parameters: FloatArray) -> Robot:
    """Gravity in a base that stands turned about its x axis, then about its y axis."""
    roll, pitch = parameters[0], parameters[1]
    about_x = np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, np.cos(roll), -np.sin(roll)],
            [0.0, np.sin(roll), np.cos(roll)],
        ]
    )
    about_y = np.array(
        [
            [np.cos(pitch), 0.0, np.sin(pitch)],
            [0.0, 1.0, 0.0],
            [-np.sin(pitch), 0.0, np.cos(pitch)],
        ]
    )
    gravity = (about_y @ about_x).T @ np.asarray(robot.gravity_m_s2)
    return replace(robot, gravity_m_s2=gravity)


PAYLOAD_CHANGE = Effect(
    name="payload_change",
    channel="force",
    equation="the last link carries a point mass m (s(t - t0, T) - s(t - t1, T1)) at the tip;"
    " s(t, T) = clip(t / T + 1/2, 0, 1), a step where T = 0",
    source="rigid-body dynamics; Khalil, Gautier and Lemoine, IEEE ICRA (2007)",
    parameters=(
        ParameterSpec("mass", "kg", "m; negative: less than described", -1e5, 1e5, 50.0, True),
        ParameterSpec(
            "start_s", "s", "t0, on the recording's time axis", -1e9, 1e9, 0.0, False, True,
            default=-1e9,
        ),
        ParameterSpec(
            "duration_s", "s", "T, over which it is taken up, t0 in the middle", 0.0, 100.0, 0.0,
            False, True,
        ),
        ParameterSpec(
            "end_s", "s", "t1, when it is let go; the largest: never", -1e9, 1e9, 1e9, False, True,
        ),
        ParameterSpec(
            "end_duration_s", "s", "T1, over which it is let go, t1 in the middle", 0.0, 100.0,
            0.0, False, True,
        ),
    ),
    terms=(),
    acts_on="robot",
    change=_with_payload,
    start="start_s",
    duration="duration_s",
    end="end_s",
    end_duration="end_duration_s",
    looks_like=("base inertial parameters", "pressure_sensor_bias", "temperature_drift"),
    separating_experiment="rest at several poses with and without the load",
    limits="a point at the tip; a roll-out takes it up as a whole at the first sample at or after"
    " t0 and lets it go so at t1, at unchanged joint velocities; with the base refitted only a"
    " change within the recording, or against a frozen base, can be told",
)  # fmt: skip

CYLINDER_INERTIA = Effect(
    name="cylinder_inertia",
    channel="force",
    equation="barrel and rod of masses mb and mr, slender, on the line between the pins",
    source="closed-chain dynamics of a triangle of cylinder and link"
    " (hydro_model.multibody.closed_chain)",
    parameters=(
        ParameterSpec("barrel_mass", "kg", "mb", 0.0, 5000.0, 17.0, linear=True),
        ParameterSpec("rod_mass", "kg", "mr", 0.0, 5000.0, 10.0, linear=True),
    ),
    terms=(),
    change=_with_cylinder_bodies,
    looks_like=("first moments", "base inertial parameters", "payload_change"),
    separating_experiment="rest and fast motion over the whole stroke; often below detection",
    limits="added to the bodies that the description has; centres of mass half the closed length"
    " from the pins; on a prismatic joint points at its origin, the barrel's of the link before",
)

BASE_TILT = Effect(
    name="base_tilt",
    channel="force",
    equation="g = (Ry(pitch) Rx(roll))^T g0",
    source="gravity in a base that does not stand level",
    parameters=(
        ParameterSpec("roll", "rad", "about the base's x axis", -0.5, 0.5, 0.0, optional=True),
        ParameterSpec("pitch", "rad", "about the base's y axis", -0.5, 0.5, 0.0175),
    ),
    terms=(),
    acts_on="robot",
    change=_tilted,
    looks_like=("encoder_offset", "pressure_sensor_bias", "first moments"),
    separating_experiment="a level on the base; or turn the machine by half a turn and repeat",
    limits="of a planar machine only the tilt in its plane shows",
)

BODY_EFFECTS = (PAYLOAD_CHANGE, CYLINDER_INERTIA, BASE_TILT)
