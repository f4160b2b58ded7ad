"""Friction that depends on more than velocity: history, place, load on the pins, temperature."""

from __future__ import annotations

import math

from hydro_model.effects.effect import Effect
from hydro_model.effects.friction import BEND, VELOCITY_SCALE, bristle
from hydro_model.effects.law import ParameterSpec, Row, Stage, Term
from hydro_model.effects.signals import (
    JOINT_VELOCITY,
    LEVER,
    OIL_TEMPERATURE,
    PISTON_FORCE,
    PISTON_POSITION,
    PISTON_VELOCITY,
    STATE_0,
    TIME,
    TRAVEL_HIGH,
    TRAVEL_LOW,
)

_LN2 = math.log(2.0)


def _bristle(s: Row, p: Row) -> float:
    return p[0] * s[STATE_0]


#: Least distance of the first station and the last, over the stroke.
LEAST_SPAN = 1.0e-3


def _along_stroke(s: Row, p: Row) -> float:
    share = (s[PISTON_POSITION] - s[TRAVEL_LOW]) / (s[TRAVEL_HIGH] - s[TRAVEL_LOW])
    at = 4.0 * min(max((share - p[6]) / max(p[7] - p[6], LEAST_SPAN), 0.0), 1.0)
    level = 0.0
    for station in range(5):
        level += p[station] * max(1.0 - abs(at - station), 0.0)
    return level * math.tanh(s[PISTON_VELOCITY] / p[5])


def _pins(s: Row, p: Row) -> float:
    load = p[0] * abs(s[PISTON_FORCE])
    if p[2] > 0.0:
        return load / abs(s[LEVER]) * s[STATE_0]
    return load / s[LEVER] * math.tanh(s[JOINT_VELOCITY] / p[1])


def _warming(s: Row, p: Row) -> float:
    degrees = p[2] * (1.0 - math.exp(-(max(s[TIME], 0.0) + p[5]) / p[3]))
    # Where the temperature is not recorded (NaN) it is taken to rise with time.
    if s[OIL_TEMPERATURE] == s[OIL_TEMPERATURE]:
        degrees = s[OIL_TEMPERATURE] - p[4]
    return p[0] * (math.exp(-_LN2 * degrees / p[1]) - 1.0) * s[PISTON_VELOCITY]


PRESLIDING = Effect(
    name="presliding_friction",
    channel="force",
    equation="F = Fc w,  d w' = v - |v| w",
    source="Dahl, A solid friction model (1968); the bristle of Canudas de Wit, Olsson, Astrom and"
    " Lischinsky, IEEE Trans. Automatic Control 40 (1995), without Stribeck part",
    parameters=(
        ParameterSpec("force", "N", "Fc, once it slides", 0.0, 1e5, 3000.0, linear=True),
        ParameterSpec("distance", "m", "d, travel in which the bristle bends", 2e-5, 5e-3, 2e-4),
    ),
    terms=(Term(Stage.FRICTION, _bristle),),
    states=(bristle(1, 2),),
    looks_like=("coulomb_friction", "stribeck_friction", "backlash"),
    separating_experiment="reversals of less than a millimetre around several poses",
    needs_cylinder=False,
    limits="the whole sliding friction is in it: beside coulomb_friction the two forces add",
)

POSITION_DEPENDENT = Effect(
    name="position_dependent_friction",
    channel="force",
    equation="F = f(x) tanh(v / v0),  f linear between five stations at even distances from x1 to"
    " x2, 0 or more, and even beyond",
    source="wear and bend of barrel and rod along the stroke",
    parameters=(
        ParameterSpec("retracted", "N", "f at x1", 0.0, 1e5, 3000.0, linear=True),
        ParameterSpec("quarter", "N", "f a quarter on", 0.0, 1e5, 2500.0, linear=True),
        ParameterSpec("middle", "N", "f half-way", 0.0, 1e5, 2000.0, linear=True),
        ParameterSpec("three_quarters", "N", "f three quarters on", 0.0, 1e5, 3000.0, linear=True),
        ParameterSpec("extended", "N", "f at x2", 0.0, 1e5, 4000.0, linear=True),
        VELOCITY_SCALE,
        ParameterSpec("begin", "1", "x1 over the stroke", 0.0, 1.0, 0.0, optional=True),
        ParameterSpec("end", "1", "x2 over the stroke", 0.0, 1.0, 1.0, optional=True),
    ),
    terms=(Term(Stage.FRICTION, _along_stroke),),
    looks_like=("coulomb_friction", "pin_friction"),
    separating_experiment="slow reversals at many places of the stroke under the same load",
    needs_cylinder=False,
    limits="coulomb_friction is the case of five equal numbers; a diagnosis puts the stations"
    " where the piston has been",
)

PIN_FRICTION = Effect(
    name="pin_friction",
    channel="force",
    equation="F = mu r |F_p| / (dx/dq) tanh(qd / w0);  with d: mu r |F_p| / |dx/dq| w,"
    "  d w' = v - |v| w",
    source="Coulomb's law at the bushings of pins, of radius r and loaded by the piston force",
    parameters=(
        ParameterSpec("radius", "m", "mu r", 0.0, 0.1, 1.5e-3, linear=True),
        ParameterSpec(
            "velocity_scale",
            "rad/s",
            "w0, joint velocity over which the sign is rounded",
            1e-5,
            0.3,
            0.01,
            optional=True,
        ),
        BEND,
    ),
    terms=(Term(Stage.FRICTION, _pins),),
    states=(bristle(2, 3),),
    looks_like=("coulomb_friction", "pressure_dependent_friction"),
    separating_experiment="slow reversals at poses of small and of large lever, with two loads",
    limits="the piston force stands for the load of all pins that turn with the joint",
)

TEMPERATURE_DRIFT = Effect(
    name="temperature_drift",
    channel="force",
    equation="F = b (2^(-(T - T0) / Th) - 1) v;  unknown T: T - T0 = R (1 - exp(-(t + ta) / tau))",
    source="viscosity of oil falls by half every 15 to 20 K (Vogel; ISO 3448 oils near 40 deg C)",
    parameters=(
        ParameterSpec("viscous", "N s/m", "b, viscous friction at T0", 0.0, 1e6, 2e4, linear=True),
        ParameterSpec(
            "halving_temperature", "K", "Th, rise that halves it", 5.0, 60.0, 17.5, optional=True
        ),
        ParameterSpec(
            "rise", "K", "R, in the end (temperature not recorded)", -60.0, 60.0, 15.0,
            optional=True,
        ),
        ParameterSpec(
            "time_constant", "s", "tau (temperature not recorded)", 1.0, 1e5, 600.0, optional=True
        ),
        ParameterSpec("reference", "deg C", "T0", -40.0, 120.0, 40.0, optional=True),
        ParameterSpec(
            "warm_s", "s", "ta, since when it has been warming as the recording begins", 0.0, 1e6,
            0.0, optional=True,
        ),
    ),
    terms=(Term(Stage.FRICTION, _warming),),
    head_start="warm_s",
    looks_like=("viscous friction", "payload_change", "quadratic_friction"),
    separating_experiment="the same run cold and warm, with the oil's temperature recorded",
    needs_cylinder=False,
    limits="the drift of flows is left out; without recorded temperature it is a drift with time"
    " from `warm_s` before the start of the recording, whose rise and halving temperature are one"
    " number",
)  # fmt: skip

FRICTION_CONDITION_EFFECTS = (
    PRESLIDING,
    POSITION_DEPENDENT,
    PIN_FRICTION,
    TEMPERATURE_DRIFT,
)
