"""What sits in a drive that is no cylinder: motor and gear behind a measured joint torque."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import InternalState, ParameterSpec, Row, Stage, Term
from hydro_model.effects.readings import Readings
from hydro_model.effects.signals import (
    JOINT_VELOCITY,
    PISTON_ACCELERATION,
    PISTON_FORCE,
    PISTON_VELOCITY,
    STATE_0,
)
from hydro_model.robot import FloatArray

#: Time constant of the differentiator that stands for the acceleration in a roll-out, s: the
#: rotor then hangs on its joint by a viscous clutch, which takes up energy and gives none.
ROTOR_LAG_S = 0.005
#: Time over which a measured torque is averaged, twice, before a play is asked where it lies, s.
_LOAD_S = 0.03


def _rotor_rate(s: Row, p: Row) -> float:
    return (s[PISTON_VELOCITY] - s[STATE_0]) / ROTOR_LAG_S


def _rotor_after(s: Row, p: Row) -> float:
    # A first-order lag of what moves evenly: behind by what that does in a time constant.
    v, later, passed = s[PISTON_VELOCITY], p[2 + PISTON_VELOCITY], p[1] / ROTOR_LAG_S
    behind = (later - v) / passed
    return later - behind + (s[STATE_0] - v + behind) * math.exp(-passed)


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


def _motor_ahead(r: Readings, joint: int, p: FloatArray) -> Readings:
    # Undone by a reading of the opposite sign: then the torque's scale is negative as well.
    from scipy.ndimage import uniform_filter1d

    load = np.where(np.isfinite(r.torque[:, joint]), r.torque[:, joint], 0.0)
    # A torque sensor's noise moves no flank: near zero its sign would be the noise's own.
    width = 2 * round(0.5 * _LOAD_S / r.step_s) + 1
    load = uniform_filter1d(uniform_filter1d(load, width), width)
    q = r.q.copy()
    q[:, joint] += 0.5 * p[0] * np.tanh(load / abs(p[1]))
    return replace(r, q=q)


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
    states=(InternalState(_rotor_rate, _joint_velocity, 0.1, after=_rotor_after),),
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

GEAR_BACKLASH = Effect(
    name="backlash",
    channel="force",
    equation="q_read = q + (b / 2) tanh(T / T0),  T: the drive's torque",
    source="play between motor and link, the encoder on the motor's side: the motor leads by half"
    " the play on the side to which it pulls; Nordin and Gutman, Automatica 38 (2002)",
    parameters=(
        ParameterSpec("gap", "rad", "b, whole play; m on a prismatic joint", 0.0, 0.1, 1e-3),
        ParameterSpec(
            "contact_torque", "N m", "T0, over which the flanks come to bear", 1e-3, 1e5, 5.0
        ),
    ),
    terms=(),
    reading=_motor_ahead,
    needs_cylinder=False,
    drive_only=True,
    looks_like=("presliding_friction", "structural_flexibility", "rotor_inertia"),
    separating_experiment="reverse the load without reversing the motion, and the reverse",
    limits="nothing of a play behind the encoder, which shows in the rotor's inertia alone",
)

DRIVE_EFFECTS = (ROTOR_INERTIA, LOAD_DEPENDENT_FRICTION)
