"""Friction of the cylinder beyond the viscous part, which the base model has."""

from __future__ import annotations

import math

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import InternalState, Law, ParameterSpec, Row, Stage, Term, nothing
from hydro_model.effects.signals import PISTON_VELOCITY, PRESSURE_A, PRESSURE_B, STATE_0

#: Beyond its upper bound a rounded sign is viscous friction, not dry.
VELOCITY_SCALE = ParameterSpec(
    "velocity_scale",
    "m/s",
    "velocity over which the sign function is rounded",
    1e-5,
    0.03,
    0.005,
    optional=True,
)


#: What turns with the direction of motion: a rounded sign of the velocity or, where a distance is
#: given, a bristle that bends over it, as that of `presliding_friction` does.
BEND = ParameterSpec(
    "distance",
    "m",
    "d, travel in which contacts bend before they slide; 0: the sign is rounded by velocity",
    0.0,
    5e-3,
    5e-5,
    optional=True,
    default=0.0,
)
#: Shortest travel that a bristle bends in, m: a recording's samples tell no less.
LEAST_BEND_M = 2.0e-5


def bristle(at: int, count: int) -> InternalState:
    """A bristle that bends over a distance; none where that is zero.

    Over a travel s in one direction it has the closed form ``w = w1 + (w0 - w1) exp(-|s| / d)``
    with w1 = 1 forwards and -1 backwards (Dahl, A solid friction model, 1968).

    Parameters
    ----------
    at : int
        Index of the distance in the effect's parameters.
    count : int
        Number of the effect's parameters.
    """

    def rate(s: Row, p: Row) -> float:
        if p[at] <= 0.0:
            return 0.0
        v = s[PISTON_VELOCITY]
        return (v - abs(v) * s[STATE_0]) / max(p[at], LEAST_BEND_M)

    def after(s: Row, p: Row) -> float:
        if p[at] <= 0.0:
            return s[STATE_0]
        v, later = s[PISTON_VELOCITY], p[count + 1 + PISTON_VELOCITY]
        turn = 1.0 if v * later >= 0.0 else v / (v - later)  # share of the time until it turns
        end = later if turn == 1.0 else 0.0
        reach, w = 0.5 * p[count] / max(p[at], LEAST_BEND_M), s[STATE_0]
        w += (math.copysign(1.0, v + end) - w) * -math.expm1(-abs(v + end) * turn * reach)
        if turn < 1.0:
            w += (math.copysign(1.0, later) - w) * -math.expm1(-abs(later) * (1.0 - turn) * reach)
        return w

    law: Law = rate
    later: Law = after
    return InternalState(law, nothing, 1.0, needs=at, after=later)


def _coulomb(s: Row, p: Row) -> float:
    return p[0] * math.tanh(s[PISTON_VELOCITY] / p[1])


def _stribeck(s: Row, p: Row) -> float:
    ratio = abs(s[PISTON_VELOCITY]) / p[1]
    way = s[STATE_0] if p[4] > 0.0 else math.tanh(s[PISTON_VELOCITY] / p[2])
    return p[0] * math.exp(-(ratio ** p[3])) * way


def _asymmetric(s: Row, p: Row) -> float:
    v = s[PISTON_VELOCITY]
    way = s[STATE_0] if p[3] > 0.0 else math.tanh(v / p[2])
    return p[0] * way * way + p[1] * v * way


def _pressure_dependent(s: Row, p: Row) -> float:
    way = s[STATE_0] if p[2] > 0.0 else math.tanh(s[PISTON_VELOCITY] / p[1])
    return p[0] * (s[PRESSURE_A] + s[PRESSURE_B]) * way


def _offset(s: Row, p: Row) -> float:
    return p[0]


def _quadratic(s: Row, p: Row) -> float:
    v = s[PISTON_VELOCITY]
    return p[0] * v * abs(v)


COULOMB = Effect(
    name="coulomb_friction",
    channel="force",
    equation="F = Fc tanh(v / v0)",
    source="Coulomb's law, rounded at reversal",
    parameters=(
        ParameterSpec("force", "N", "Fc", 0.0, 1e5, 3000.0, linear=True),
        VELOCITY_SCALE,
    ),
    terms=(Term(Stage.FRICTION, _coulomb),),
    looks_like=("pin_friction", "pressure_dependent_friction", "stribeck_friction"),
    separating_experiment="reverse slowly at constant speed under three different loads",
    needs_cylinder=False,
)

STRIBECK = Effect(
    name="stribeck_friction",
    channel="force",
    equation="F = (Fs - Fc) exp(-|v / vs|^e) tanh(v / v0);  with d: w for tanh,  d w' = v - |v| w",
    source="Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994)",
    parameters=(
        ParameterSpec("force", "N", "Fs - Fc", 0.0, 1e5, 1000.0, linear=True),
        ParameterSpec("stribeck_velocity", "m/s", "vs", 1e-4, 0.2, 0.01),
        VELOCITY_SCALE,
        ParameterSpec("exponent", "1", "e", 0.5, 2.0, 2.0, optional=True),
        BEND,
    ),
    terms=(Term(Stage.FRICTION, _stribeck),),
    states=(bristle(4, 5),),
    looks_like=("presliding_friction", "coulomb_friction"),
    separating_experiment="slow ramps through reversal, and a ladder of steady low speeds",
    needs_cylinder=False,
)

ASYMMETRIC = Effect(
    name="asymmetric_friction",
    channel="force",
    equation="F = Fa tanh(v / v0)^2 + ba v tanh(v / v0);  with d: w for tanh,  d w' = v - |v| w",
    source="the part of direction-dependent friction that is even in velocity",
    parameters=(
        ParameterSpec(
            "force", "N", "Fa, half the difference between directions", -1e5, 1e5, 600.0, True
        ),
        ParameterSpec(
            "viscous", "N s/m", "ba, half the difference", -1e5, 1e5, 0.0, True, optional=True
        ),
        VELOCITY_SCALE,
        BEND,
    ),
    terms=(Term(Stage.FRICTION, _asymmetric),),
    states=(bristle(3, 4),),
    looks_like=("pressure_sensor_bias", "constant_force_offset", "first moments"),
    separating_experiment="pass the same poses at equal speeds in both directions, and rest there",
    needs_cylinder=False,
)

PRESSURE_DEPENDENT = Effect(
    name="pressure_dependent_friction",
    channel="force",
    equation="F = mu (p1 + p2) tanh(v / v0);  with d: w for tanh,  d w' = v - |v| w",
    source="seal friction grows with the pressure that presses the lip on",
    parameters=(
        ParameterSpec("coefficient", "N/Pa", "mu", 0.0, 0.01, 1.5e-4, linear=True),
        VELOCITY_SCALE,
        BEND,
    ),
    terms=(Term(Stage.FRICTION, _pressure_dependent),),
    states=(bristle(2, 3),),
    looks_like=("coulomb_friction", "pin_friction"),
    separating_experiment="the same slow motion with and without a payload",
)

QUADRATIC = Effect(
    name="quadratic_friction",
    channel="force",
    equation="F = c v |v|",
    source="turbulent losses in ports and hoses between transducer and piston",
    parameters=(ParameterSpec("coefficient", "N s^2/m^2", "c", 0.0, 1e7, 5e4, linear=True),),
    terms=(Term(Stage.FRICTION, _quadratic),),
    looks_like=("coulomb_friction", "viscous friction"),
    separating_experiment="a ladder of steady speeds up to the fastest",
    needs_cylinder=False,
)

CONSTANT_OFFSET = Effect(
    name="constant_force_offset",
    channel="force",
    equation="F = F0",
    source="bias of the force measurement or of the drive, the same at every pose and speed",
    parameters=(
        ParameterSpec("force", "N", "F0, against positive motion", -1e5, 1e5, 500.0, linear=True),
    ),
    terms=(Term(Stage.FRICTION, _offset),),
    looks_like=("pressure_sensor_bias", "asymmetric_friction", "base_tilt", "first moments"),
    separating_experiment="rest at poses over the whole range: a load changes with the pose, an"
    " offset does not",
    needs_cylinder=False,
)

FRICTION_EFFECTS = (
    COULOMB,
    STRIBECK,
    ASYMMETRIC,
    PRESSURE_DEPENDENT,
    QUADRATIC,
    CONSTANT_OFFSET,
)
