"""Mechanics beyond rigid links on ideal pins: play, springs, contact, coupling."""

from __future__ import annotations

import math

import numpy as np

from hydro_model.effects.drives import GEAR_BACKLASH
from hydro_model.effects.effect import Effect
from hydro_model.effects.flexibility import STRUCTURAL_FLEXIBILITY
from hydro_model.effects.law import InternalState, ParameterSpec, Row, Stage, Term
from hydro_model.effects.signals import (
    AREA_A,
    AREA_B,
    JOINT_POSITION,
    JOINT_VELOCITY,
    LEVER,
    OTHER_ACCELERATION,
    OTHER_POSITION,
    OTHER_VELOCITY,
    PISTON_FORCE,
    PISTON_POSITION,
    PISTON_VELOCITY,
    STATE_0,
    STATE_1,
    TIP_HEIGHT,
    TIP_RATE,
    TIP_SLOPE,
)
from hydro_model.robot import FloatArray

#: Time constant of the differentiator that stands for the other joint's acceleration in a
#: roll-out, s: a filter's lag far above the hydraulic mode.
COUPLING_LAG_S = 0.01
#: What a contact is under: the tip, or what a joint runs against as it falls (1) or rises (-1).
WAY = ParameterSpec(
    "way", "1", "z: 0 the tip's height, 1 the joint's position, -1 its negative", -2.0, 2.0, 0.0,
    optional=True,
)  # fmt: skip
#: Where a spring acts. Over a lever of 1 m, so that its numbers have one unit either way.
ABOUT = ParameterSpec(
    "about", "1", "0: along the cylinder, 1: about the joint, over a lever of 1 m", 0.0, 1.0, 1.0,
    optional=True, default=0.0,
)  # fmt: skip
#: How deep in a contact's stiffness is stated, m (rad of a joint).
PRESSED_M = 0.1
#: Time in which a pin comes to lie where the load has turned, s.
PLAY_TIME_S = 0.004


# A pin with play. STATE_0 is where it lies, in plays from the middle, STATE_1 the same a little
# later, so that their difference is its velocity.


def _play_end(s: Row, p: Row) -> float:
    force = s[PISTON_FORCE]
    # Where nothing drags the speed may be unknown.
    if p[2] != 0.0:
        force -= p[2] * s[PISTON_VELOCITY]
    return math.copysign(0.5, force) + p[3] * force


def _play_rate(s: Row, p: Row) -> float:
    force = s[PISTON_FORCE]
    if p[2] != 0.0:
        force -= p[2] * s[PISTON_VELOCITY]
    square = (force / p[1]) * (force / p[1])
    lies = square * square * (square * square)
    end = math.copysign(0.5, force) + p[3] * force
    return lies / (1.0 + lies) * (end - s[STATE_0]) / PLAY_TIME_S


def _play_follows(s: Row, p: Row) -> float:
    return (s[STATE_0] - s[STATE_1]) / PLAY_TIME_S


def _play_a(s: Row, p: Row) -> float:
    return -s[AREA_A] * p[0] * (s[STATE_0] - s[STATE_1]) / PLAY_TIME_S


def _play_b(s: Row, p: Row) -> float:
    return s[AREA_B] * p[0] * (s[STATE_0] - s[STATE_1]) / PLAY_TIME_S


def _play_crossed(rows: FloatArray, p: FloatArray, sample_time_s: float) -> FloatArray:
    """Where a recording says that the pin was, and a time constant earlier: (N, 2).

    While no force goes through the pin the load leaves the piston at a force that grows evenly,
    so that their distance grows as the third power of time until they meet again.
    """
    force = rows[:, PISTON_FORCE]
    if p[2] != 0.0:
        force = force - p[2] * rows[:, PISTON_VELOCITY]
    lies = np.flatnonzero(np.abs(force) > p[1])
    if not lies.size:
        return np.zeros((len(rows), 2))
    ends = np.copysign(0.5, force[lies])
    at = np.arange(len(rows))
    after = np.searchsorted(lies, at)
    before = np.maximum(np.searchsorted(lies, at, side="right") - 1, 0)
    after = np.minimum(after, lies.size - 1)
    gone = (at - lies[before]) / np.maximum(lies[after] - lies[before], 1)
    where = ends[before] + (ends[after] - ends[before]) * np.clip(gone, 0.0, 1.0) ** 3
    where += p[3] * np.where(np.isfinite(force), force, 0.0)
    rate = np.gradient(where, sample_time_s)
    return np.stack([where, where - PLAY_TIME_S * rate], axis=1)


def _spring(s: Row, p: Row) -> float:
    if p[2] == 0.0:
        return p[0] + p[1] * s[PISTON_POSITION]
    return (p[0] + p[1] * s[JOINT_POSITION]) / s[LEVER]


def _other_rate(s: Row, p: Row) -> float:
    return (s[OTHER_VELOCITY] - s[STATE_0]) / COUPLING_LAG_S


def _other_after(s: Row, p: Row) -> float:
    # A first-order lag of what moves evenly: behind by what that does in a time constant.
    v, later, passed = s[OTHER_VELOCITY], p[4 + OTHER_VELOCITY], p[3] / COUPLING_LAG_S
    behind = (later - v) / passed
    return later - behind + (s[STATE_0] - v + behind) * math.exp(-passed)


def _other_velocity(s: Row, p: Row) -> float:
    return s[OTHER_VELOCITY]


def _coupling(s: Row, p: Row) -> float:
    acceleration = (s[OTHER_VELOCITY] - s[STATE_0]) / COUPLING_LAG_S
    # A recording knows the acceleration; a roll-out (NaN) has the differentiator's.
    if s[OTHER_ACCELERATION] == s[OTHER_ACCELERATION]:
        acceleration = s[OTHER_ACCELERATION]
    torque = p[0] * s[OTHER_VELOCITY] + p[1] * acceleration + p[2] * s[OTHER_POSITION]
    return torque / s[LEVER]


def _contact(s: Row, p: Row) -> float:
    if p[2] == 0.0:
        at, rate, slope = s[TIP_HEIGHT], s[TIP_RATE], s[TIP_SLOPE]
    else:
        at, rate, slope = p[2] * s[JOINT_POSITION], p[2] * s[JOINT_VELOCITY], p[2]
    deep = max(p[1] - at, 0.0)
    if deep == 0.0:
        return 0.0
    push = p[0] * deep * math.pow(deep / PRESSED_M, p[3] - 1.0)
    if p[4] > 0.0:
        # Where it lets go quicker than the surface follows there is no pull.
        push *= max(1.0 - p[4] * rate, 0.0)
    return -push * slope / s[LEVER]


BACKLASH = Effect(
    name="backlash",
    channel="force",
    equation="x = x(q) + b (e + g F),  F = F_p - d v,  e = sign(F) / 2 where |F| > F0; in"
    " between it crosses as (t / T)^3",
    source="play of a pin that loses its load: a dead zone with the piston on one side; Nordin"
    " and Gutman, Automatica 38 (2002)",
    parameters=(
        ParameterSpec("width", "m", "b, whole play", 0.0, 5e-3, 3e-4, linear=True),
        ParameterSpec(
            "contact_force", "N", "F0, load at which the pin lies on", 10.0, 2e4, 300.0,
            optional=True,
        ),
        ParameterSpec(
            "drag", "N s/m", "d, friction that the piston itself takes", 0.0, 1e5, 0.0,
            optional=True,
        ),
        ParameterSpec(
            "give", "1/N", "g, plays that a pin bends by per force", 0.0, 1e-3, 0.0, optional=True
        ),
    ),
    terms=(Term(Stage.FLOW_A, _play_a), Term(Stage.FLOW_B, _play_b)),
    states=(
        InternalState(_play_rate, _play_end, 0.5),
        InternalState(_play_follows, _play_end, 0.5),
    ),
    known_states=_play_crossed,
    channels=("flow_a", "flow_b", "force"),
    looks_like=("presliding_friction", "internal_leakage"),
    separating_experiment="reverse the load without reversing the motion, and the reverse",
    limits="how long the crossing takes, T, is read off a recording; in a roll-out the load stays"
    " on the piston, and the pin crosses once it is pushed the other way, without an impact",
    elsewhere=GEAR_BACKLASH,
)  # fmt: skip

COUNTERBALANCE_SPRING = Effect(
    name="counterbalance_spring",
    channel="force",
    equation="F = F0 + k x,  or F = (F0 + k q) / (dx/dq)",
    source="a gas or coil spring along the cylinder or about the joint, or one that acts like it",
    parameters=(
        ParameterSpec("force", "N", "F0, against extension, at x = 0", -1e5, 1e5, -2000.0, True),
        ParameterSpec("stiffness", "N/m", "k", 0.0, 1e6, 5000.0, linear=True),
        ABOUT,
    ),
    terms=(Term(Stage.FRICTION, _spring),),
    looks_like=("first moments", "constant_force_offset", "base_tilt"),
    separating_experiment="rest at poses over the whole range with two known payloads, and with"
    " the other joint at both ends",
    needs_cylinder=False,
)

JOINT_COUPLING = Effect(
    name="joint_coupling",
    channel="force",
    equation="F = (b qd_o + m qdd_o + k q_o) / (dx/dq),  o: next joint, or the last but one",
    source="hoses, shared structure or transmission between neighbouring joints, linearised",
    parameters=(
        ParameterSpec("viscous", "N m s/rad", "b", -1e6, 1e6, 500.0, True),
        ParameterSpec("inertia", "kg m^2", "m", -1e6, 1e6, 100.0, True, True, default=0.0),
        ParameterSpec("stiffness", "N m/rad", "k", -1e6, 1e6, 200.0, True, True, default=0.0),
    ),
    terms=(Term(Stage.FRICTION, _coupling),),
    states=(InternalState(_other_rate, _other_velocity, 0.1, after=_other_after),),
    looks_like=("products of inertia", "supply_droop", "structural_flexibility"),
    separating_experiment="move one joint at a time, the other at rest",
    needs_cylinder=False,
    needs_other_joint=True,
    limits="in a roll-out the other joint's acceleration is its velocity differentiated with a"
    f" lag of {COUPLING_LAG_S:g} s",
)

EXTERNAL_CONTACT = Effect(
    name="external_contact",
    channel="force",
    equation=f"F = -k d (d / {PRESSED_M:g})^(n - 1) max(1 - c z', 0) (dz/dq) / (dx/dq),"
    "  d = max(z0 - z, 0),  z: height of the tip, q or -q",
    source="unilateral spring under the tip or at a joint, or a body pressed in (Hertz), that"
    " gives back less; Hunt and Crossley, J. Applied Mechanics 42 (1975); Gilardi and Sharf,"
    " Mechanism and Machine Theory 37 (2002)",
    parameters=(
        ParameterSpec(
            "stiffness", "N/m", f"k, upwards at the tip (N m/rad of a joint), {PRESSED_M:g} deep",
            0.0, 1e9, 1e5, linear=True,
        ),
        ParameterSpec(
            "height", "m", "z0, over the base's origin (rad of a joint)", -100.0, 100.0, 0.0
        ),
        WAY,
        ParameterSpec(
            "exponent", "1", "n: 1 a spring, 1.5 a body pressed in", 1.0, 2.0, 1.0, optional=True
        ),
        ParameterSpec(
            "damping", "s/m", "c: how much less it gives back (s/rad of a joint)", 0.0, 10.0, 0.5,
            optional=True, default=0.0,
        ),
    ),
    terms=(Term(Stage.FRICTION, _contact),),
    looks_like=("payload_change", "counterbalance_spring", "end_cushion"),
    separating_experiment="the same motion away from everything the tip could touch",
    needs_cylinder=False,
    needs_tip=True,
    shared=True,
    limits="a level ground without friction: list it for the robot, it acts on all joints; or what"
    " one joint runs against: list it there",
)  # fmt: skip

MECHANICS_EFFECTS = (
    STRUCTURAL_FLEXIBILITY,
    BACKLASH,
    COUNTERBALANCE_SPRING,
    JOINT_COUPLING,
    EXTERNAL_CONTACT,
)
