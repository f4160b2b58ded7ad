"""What sits in a drive that is no cylinder: motor and gear behind a measured joint torque."""

from __future__ import annotations

import math

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import InternalState, ParameterSpec, Row, Stage, Term
from hydro_model.signals import (
    JOINT_VELOCITY,
    PISTON_ACCELERATION,
    PISTON_FORCE,
    PISTON_VELOCITY,
    STATE_0,
)

#: Time constant of the differentiator that stands for the acceleration in a roll-out, s: the
#: rotor then hangs on its joint by a viscous clutch, which takes up energy and gives none.
ROTOR_LAG_S = 0.005


def _rotor_rate(s: Row, p: Row) -> float:
    return (s[PISTON_VELOCITY] - s[STATE_0]) / ROTOR_LAG_S


def _joint_velocity(s: Row, p: Row) -> float:
    return s[PISTON_VELOCITY]


def _rotor(s: Row, p: Row) -> float:
    acceleration = (s[PISTON_VELOCITY] - s[STATE_0]) / ROTOR_LAG_S
    # A recording knows the acceleration; a roll-out (NaN) has the differentiator's.
    if s[PISTON_ACCELERATION] == s[PISTON_ACCELERATION]:
        acceleration = s[PISTON_ACCELERATION]
    return p[0] * acceleration


def _loaded_gear(s: Row, p: Row) -> float:
    return p[0] * abs(s[PISTON_FORCE]) * math.tanh(s[JOINT_VELOCITY] / p[1])


ROTOR_INERTIA = Effect(
    name="rotor_inertia",
    channel="force",
    equation="T = J qdd",
    source="rotor and gear turned N times as fast as the joint, J = N^2 Jm: the term Ia qdd of"
    " Khalil and Dombre, Modeling, Identification and Control of Robots (2002), chapter 9",
    parameters=(
        ParameterSpec(
            "inertia",
            "kg m^2",
            "J, seen from the joint; kg on a prismatic one",
            0.0,
            1e5,
            1.0,
            linear=True,
        ),
    ),
    terms=(Term(Stage.FRICTION, _rotor),),
    states=(InternalState(_rotor_rate, _joint_velocity, 0.1),),
    needs_cylinder=False,
    drive_only=True,
    looks_like=("base inertial parameters", "joint_coupling", "structural_flexibility"),
    separating_experiment="quick motion at poses that change the load's inertia about the joint",
    limits="nothing of the rotor's turning with the links before it; of the first joint it is"
    " part of the link's inertia; in a roll-out the acceleration is the velocity differentiated"
    f" with a lag of {ROTOR_LAG_S:g} s",
)

LOAD_DEPENDENT_FRICTION = Effect(
    name="load_dependent_friction",
    channel="force",
    equation="T = s |T_m| tanh(qd / w0),  T_m: the drive's torque",
    source="Hamon, Gautier and Garrec, Dynamic identification of robots with a dry friction model"
    " depending on load and velocity, IEEE/RSJ IROS (2010)",
    parameters=(
        ParameterSpec("share", "1", "s", 0.0, 0.9, 0.1, linear=True),
        ParameterSpec(
            "velocity_scale", "rad/s", "w0, over which the sign is rounded; m/s if prismatic",
            1e-5, 0.3, 0.01, optional=True,
        ),
    ),
    terms=(Term(Stage.FRICTION, _loaded_gear),),
    needs_cylinder=False,
    drive_only=True,
    looks_like=("coulomb_friction", "asymmetric_friction", "position_dependent_friction"),
    separating_experiment="slow reversals at poses of small and of large gravity load",
    limits="lifting and lowering alike; the torque that is measured stands for what the gear"
    " transmits",
)  # fmt: skip

DRIVE_EFFECTS = (ROTOR_INERTIA, LOAD_DEPENDENT_FRICTION)
