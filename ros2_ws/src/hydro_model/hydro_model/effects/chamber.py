"""Chambers beyond two rigid volumes of one bulk modulus: leakage, dead volume, air."""

from __future__ import annotations

import math

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import ParameterSpec, Row, Stage, Term
from hydro_model.effects.signals import ATMOSPHERIC_PRESSURE, PRESSURE_A, PRESSURE_B

#: Absolute pressure below which air counts as if it were at this pressure, Pa: the model does
#: not cavitate, and its laws stay finite for any pressure.
PRESSURE_FLOOR_PA = 1.0e4


def _cross_into_a(s: Row, p: Row) -> float:
    return p[0] * (s[PRESSURE_B] - s[PRESSURE_A])


def _cross_into_b(s: Row, p: Row) -> float:
    return p[0] * (s[PRESSURE_A] - s[PRESSURE_B])


def _out_of_a(s: Row, p: Row) -> float:
    return -p[0] * s[PRESSURE_A]


def _out_of_b(s: Row, p: Row) -> float:
    return -p[1] * s[PRESSURE_B]


def _first(s: Row, p: Row) -> float:
    return p[0]


def _second(s: Row, p: Row) -> float:
    return p[1]


def _air_in_a(s: Row, p: Row) -> float:
    p0 = s[ATMOSPHERIC_PRESSURE]
    absolute = max(s[PRESSURE_A] + p0, PRESSURE_FLOOR_PA)
    return p[0] / (p[1] * absolute) * math.pow(p0 / absolute, 1.0 / p[1])


def _air_in_b(s: Row, p: Row) -> float:
    p0 = s[ATMOSPHERIC_PRESSURE]
    absolute = max(s[PRESSURE_B] + p0, PRESSURE_FLOOR_PA)
    return p[0] / (p[1] * absolute) * math.pow(p0 / absolute, 1.0 / p[1])


INTERNAL_LEAKAGE = Effect(
    name="internal_leakage",
    channel="flow",
    equation="q_A = -c (p1 - p2),  q_B = c (p1 - p2)",
    source="laminar flow past the piston seal",
    parameters=(ParameterSpec("coefficient", "m^3/(s Pa)", "c", 0.0, 1e-9, 5e-13, linear=True),),
    terms=(Term(Stage.FLOW_A, _cross_into_a), Term(Stage.FLOW_B, _cross_into_b)),
    channels=("flow_a", "flow_b"),
    looks_like=("valve_null_bias", "valve_underlap"),
    separating_experiment="valve closed under load, with the load acting either way",
)

EXTERNAL_LEAKAGE = Effect(
    name="external_leakage",
    channel="flow",
    equation="q_A = -c_A p1,  q_B = -c_B p2",
    source="laminar flow out of a chamber to atmosphere",
    parameters=(
        # A chamber that a robot file says nothing of does not leak.
        ParameterSpec("coefficient_a", "m^3/(s Pa)", "c_A", 0.0, 1e-9, 5e-13, True, True, 0.0),
        ParameterSpec("coefficient_b", "m^3/(s Pa)", "c_B", 0.0, 1e-9, 5e-13, True, True, 0.0),
    ),
    terms=(Term(Stage.FLOW_A, _out_of_a), Term(Stage.FLOW_B, _out_of_b)),
    channels=("flow_a", "flow_b"),
    looks_like=("internal_leakage", "valve_null_bias"),
    separating_experiment="valve closed: both pressures decay, where internal leakage equalises",
)

DEAD_VOLUME = Effect(
    name="dead_volume",
    channel="flow",
    equation="V_A = A1 x + V0_A,  V_B = A2 (S - x) + V0_B",
    source="ports, hoses and manifold beyond the stroke",
    parameters=(
        ParameterSpec("volume_a", "m^3", "V0_A", 0.0, 0.05, 1e-3, linear=True),
        ParameterSpec("volume_b", "m^3", "V0_B", 0.0, 0.05, 1e-3, linear=True),
    ),
    terms=(Term(Stage.VOLUME_A, _first), Term(Stage.VOLUME_B, _second)),
    channels=("flow_a", "flow_b"),
    looks_like=("bulk modulus", "entrained_air"),
    separating_experiment="small steps near both ends of the stroke",
)

ENTRAINED_AIR = Effect(
    name="entrained_air",
    channel="flow",
    equation="1/beta = 1/beta_l + a / (n p) (p0 / p)^(1/n), p absolute",
    source="polytropic bubbles of volume fraction a at atmospheric pressure p0; Merritt,"
    " Hydraulic Control Systems (1967)",
    parameters=(
        ParameterSpec("fraction", "1", "a, volume of air at p0", 0.0, 0.2, 0.005, linear=True),
        ParameterSpec(
            "polytropic_exponent", "1", "n, 1 isothermal to 1.4 adiabatic", 1.0, 1.67, 1.4,
            optional=True,
        ),
    ),
    terms=(Term(Stage.COMPLIANCE_A, _air_in_a), Term(Stage.COMPLIANCE_B, _air_in_b)),
    channels=("flow_a", "flow_b"),
    looks_like=("dead_volume", "bulk modulus", "cavitation"),
    separating_experiment="steps of the valve at low and at high chamber pressure",
)  # fmt: skip

CHAMBER_EFFECTS = (INTERNAL_LEAKAGE, EXTERNAL_LEAKAGE, DEAD_VOLUME, ENTRAINED_AIR)
