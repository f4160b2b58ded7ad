"""A link that bends: a mode of its joint, or a hinge with all that hangs on it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import InternalState, ParameterSpec, Row, Stage, Term, nothing
from hydro_model.effects.signals import JOINT_VELOCITY, LEVER, STATE_0, STATE_1
from hydro_model.robot import FloatArray, Robot

if TYPE_CHECKING:
    from hydro_model.effects.bending import Load

#: How much of what a joint carries sets a mode going beside the joint's own acceleration.
CARRIED = ParameterSpec(
    "carried", "1", "c: 0 nothing but the joint's acceleration, 1 gravity and other joints, too",
    0.0, 3.0, 1.0, optional=True, default=0.0,
)  # fmt: skip
#: Where along its link such a mode bends it.
PLACE = ParameterSpec(
    "place", "1", "d: 0 at its joint, towards 1 at the next one where that is parallel (c > 0)",
    0.0, 0.8, 0.0, optional=True,
)  # fmt: skip


def hinged(p: FloatArray) -> bool:
    """Whether a mode is one that carries more than its joint's own acceleration meets.

    Parameters
    ----------
    p : (5,) array
        Of `structural_flexibility`.
    """
    return bool(p[0] > 0.0 and p[3] > 0.0)


def _mode_acceleration(s: Row, p: Row) -> float:
    omega = 2.0 * math.pi * p[1]
    return -omega * (omega * s[STATE_0] + 2.0 * p[2] * (s[STATE_1] - s[JOINT_VELOCITY]))


def _mode_force(s: Row, p: Row) -> float:
    if p[3] > 0.0:
        return 0.0  # what hangs on it weighs on all joints: hydro_model.simulation.hinge_kernels
    omega = 2.0 * math.pi * p[1]
    slip = s[STATE_1] - s[JOINT_VELOCITY]
    return -p[0] * omega * (omega * s[STATE_0] + 2.0 * p[2] * slip) / s[LEVER]


def _mode_slip(s: Row, p: Row) -> float:
    return s[STATE_1] - s[JOINT_VELOCITY]


def _mode_together(s: Row, p: Row) -> float:
    return s[JOINT_VELOCITY]


def _less_inertia(robot: Robot, target: str, parameters: FloatArray) -> Robot:
    """The joint without the inertia that the flexible mode carries instead.

    Of the joint's own acceleration alone, to which the mode gives it back: taken off the link, it
    would be missing where other joints move it. A hinge that carries more leaves the links whole.
    """
    if hinged(parameters):
        return robot
    at = robot.joint_index(_joint_name(robot, target))
    joints = list(robot.joints)
    joints[at] = replace(joints[at], armature=joints[at].armature - float(parameters[0]))
    return replace(robot, joints=tuple(joints))


def _bent(
    load: Load, p: FloatArray, sample_time_s: float, begun: tuple[float, float] = (0.0, 0.0)
) -> FloatArray:
    from hydro_model.effects.bending import bent  # kernels: only where a recording is looked at

    return bent(load, p, sample_time_s, begun)


def _joint_name(robot: Robot, target: str) -> str:
    return next((c.joint for c in robot.cylinders if c.name == target), target)


STRUCTURAL_FLEXIBILITY = Effect(
    name="structural_flexibility",
    channel="force",
    equation="F = J w' / (dx/dq),  e' = w - qd,  w' = -W^2 e - 2 zeta W (w - qd);  M_ii - J. With"
    " a share h = c J / U of the load on it, r = J - h U: (h M_ii + r) e'' = -J W^2 e"
    " - 2 zeta W J e' - h T_i - r qdd_i; at joint j h M_ji e'', at its own r e'' more; U: M_ii"
    " with all joints in the middle; with the next joint's where it lies on the way there",
    source="one mode of the link as an inertia on a hinge spring (first assumed mode); Book,"
    " J. Dynamic Systems, Measurement and Control 115 (1993)",
    parameters=(
        ParameterSpec("inertia", "kg m^2", "J on the spring", 0.0, 1e6, 300.0, linear=True),
        ParameterSpec("frequency", "Hz", "W / 2 pi, joint held", 0.5, 50.0, 5.0),
        ParameterSpec("damping", "1", "zeta", 0.0, 1.0, 0.03, optional=True),
        CARRIED,
        PLACE,
    ),
    terms=(Term(Stage.FRICTION, _mode_force),),
    states=(
        InternalState(_mode_slip, nothing, 0.01),
        InternalState(_mode_acceleration, _mode_together, 0.1),
    ),
    change=_less_inertia,
    looks_like=("hydraulic mode", "line_dynamics", "inertia"),
    separating_experiment="a chirp over the mode at two strokes: the hydraulic mode moves, the"
    " structure's stays",
    needs_cylinder=False,
    known_torques=_bent,
    limits="one mode. With c = 0 its own joint alone sets it going, and feels it, without sag"
    " under gravity: what the joint's acceleration meets moves to the spring, so below the mode"
    " nothing changes, and J is less than 1 / (M^-1)_ii in every pose. A roll-out takes no more"
    " than 0.98 U of a hinge's J. Along a recording a hinge knows the links as the robot file has"
    " them, no load that is taken up and no other hinge's deflection; in a roll-out it does",
)
