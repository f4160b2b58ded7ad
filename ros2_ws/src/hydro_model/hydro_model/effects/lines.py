"""Between valve and piston: hoses with inertia, cushions at the ends of the stroke, cavities."""

from __future__ import annotations

import math

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import InternalState, ParameterSpec, Row, Stage, Term, nothing
from hydro_model.effects.signals import (
    ATMOSPHERIC_PRESSURE,
    PISTON_POSITION,
    PRESSURE_A,
    PRESSURE_B,
    STATE_0,
    STATE_1,
    STATE_2,
    STATE_3,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    TRAVEL_HIGH,
    TRAVEL_LOW,
    VALVE_FLOW_A,
    VALVE_FLOW_B,
)
from hydro_model.numerics.kernel import inlined

#: Time in which a cavity collapses once the pressure is up again, s.
COLLAPSE_TIME_S = 0.002
#: Pressure above the cavity's at which it collapses at full rate, Pa.
COLLAPSE_PRESSURE_PA = 1.0e4
#: Drop at an edge below which a hose's pressure changes its flow no more, Pa.
LEAST_DROP_PA = 1.0e5
#: Largest share of an edge's flow that a hose's pressure gives or takes.
MOST_TAKEN = 0.5


@inlined
def _left(flow: float, drop: float, moved: float, resistance: float) -> float:
    """What an edge's flow keeps of itself where a hose takes a part of its drop.

    From ``y^2 = 1 - (L q_c' + R y |q|) / dp``: the flow goes with the root of what is left.
    """
    most = max(drop, LEAST_DROP_PA)
    r = resistance * abs(flow) / most
    root = math.sqrt(max(r * r + 4.0 * (1.0 - moved / most), 0.0))
    return min(max(0.5 * (root - r), 1.0 - MOST_TAKEN), 1.0 + MOST_TAKEN)


def _behind_a(s: Row, p: Row) -> float:
    flow, drop, way = s[VALVE_FLOW_A], s[SUPPLY_PRESSURE] - s[PRESSURE_A], 1.0
    if flow < 0.0:
        drop, way = s[PRESSURE_A] - s[TANK_PRESSURE], -1.0
    left = float(_left(flow, drop, way * p[0] * s[STATE_1], p[3]))
    return s[STATE_0] - flow - (1.0 - left) * flow


def _behind_b(s: Row, p: Row) -> float:
    flow, drop, way = s[VALVE_FLOW_B], s[SUPPLY_PRESSURE] - s[PRESSURE_B], 1.0
    if flow < 0.0:
        drop, way = s[PRESSURE_B] - s[TANK_PRESSURE], -1.0
    left = float(_left(flow, drop, way * p[0] * s[STATE_3], p[3]))
    return s[STATE_2] - flow - (1.0 - left) * flow


def _flow_a(s: Row, p: Row) -> float:
    return s[VALVE_FLOW_A]


def _flow_b(s: Row, p: Row) -> float:
    return s[VALVE_FLOW_B]


def _change_a(s: Row, p: Row) -> float:
    return s[STATE_1]


def _change_b(s: Row, p: Row) -> float:
    return s[STATE_3]


def _ring_a(s: Row, p: Row) -> float:
    omega = 1.0 / math.sqrt(p[0] * p[1])
    return omega * (omega * (s[VALVE_FLOW_A] - s[STATE_0]) - 2.0 * p[2] * s[STATE_1])


def _ring_b(s: Row, p: Row) -> float:
    omega = 1.0 / math.sqrt(p[0] * p[1])
    return omega * (omega * (s[VALVE_FLOW_B] - s[STATE_2]) - 2.0 * p[2] * s[STATE_3])


def _cushion_a(s: Row, p: Row) -> float:
    left = max(s[PISTON_POSITION] - s[TRAVEL_LOW], 0.0)
    return p[0] * max(1.0 - left / p[1], 0.0) * max(-s[VALVE_FLOW_A], 0.0)


def _cushion_b(s: Row, p: Row) -> float:
    left = max(s[TRAVEL_HIGH] - s[PISTON_POSITION], 0.0)
    return p[0] * max(1.0 - left / p[1], 0.0) * max(-s[VALVE_FLOW_B], 0.0)


def _cavity_a(s: Row, p: Row) -> float:
    short = p[1] - (s[PRESSURE_A] + s[ATMOSPHERIC_PRESSURE])
    closing = min(max(-short / COLLAPSE_PRESSURE_PA, 0.0), 1.0)
    return p[0] * max(short, 0.0) - closing * s[STATE_0] / COLLAPSE_TIME_S


def _cavity_b(s: Row, p: Row) -> float:
    short = p[1] - (s[PRESSURE_B] + s[ATMOSPHERIC_PRESSURE])
    closing = min(max(-short / COLLAPSE_PRESSURE_PA, 0.0), 1.0)
    return p[0] * max(short, 0.0) - closing * s[STATE_1] / COLLAPSE_TIME_S


LINE_DYNAMICS = Effect(
    name="line_dynamics",
    channel="flow",
    equation="q_c'' = W^2 (q - q_c) - 2 zeta W q_c',  W = 1/sqrt(L C);  into the chamber goes"
    " q_c - (1 - y) q,  y^2 = 1 - (L q_c' + R y q) / dp: the oil in the hose takes L q_c' to be"
    " moved and R y q to go on, which the edge's drop dp lacks",
    source="first mode of a hose with inertance and compliance; Stecki and Davis, Proc. IMechE A"
    " 200 (1986)",
    parameters=(
        ParameterSpec("inertance", "Pa s^2/m^3", "L", 1.0e5, 1.0e10, 2.0e7),
        ParameterSpec("compliance", "m^3/Pa", "C", 1.0e-15, 1.0e-11, 1.0e-13, optional=True),
        ParameterSpec("damping", "1", "zeta", 0.01, 3.0, 0.2, optional=True),
        ParameterSpec(
            "resistance", "Pa s/m^3", "R", 0.0, 1.0e11, 4.0e8, optional=True, default=0.0
        ),
    ),
    terms=(Term(Stage.FLOW_A, _behind_a), Term(Stage.FLOW_B, _behind_b)),
    states=(
        InternalState(_change_a, _flow_a, 1e-4, linear=True, averaged=True),
        InternalState(_ring_a, nothing, 5e-2, linear=True, averaged=True),
        InternalState(_change_b, _flow_b, 1e-4, linear=True, averaged=True),
        InternalState(_ring_b, nothing, 5e-2, linear=True, averaged=True),
    ),
    channels=("flow_a", "flow_b"),
    needs_valve=True,
    looks_like=("valve_spool_lag", "pressure_delay", "structural_flexibility"),
    separating_experiment="steps of the valve with pressures sampled at 1 kHz or more",
    limits="one mode, the same in both lines, which the edge does not damp; laminar resistance",
)

END_CUSHION = Effect(
    name="end_cushion",
    channel="flow",
    equation="outflow (1 - k (1 - d / L)) q for d < L,  d: distance to the stop ahead",
    source="cushion plungers that close the port over the last stretch of the stroke",
    parameters=(
        ParameterSpec("strength", "1", "k, share of the port closed at the stop", 0.0, 1.0, 0.9,
                      linear=True),
        ParameterSpec("length", "m", "L", 1e-3, 1.0, 0.02),
    ),
    terms=(Term(Stage.FLOW_A, _cushion_a), Term(Stage.FLOW_B, _cushion_b)),
    channels=("flow_a", "flow_b"),
    needs_valve=True,
    looks_like=("external_contact", "dead_volume", "position-dependent friction"),
    separating_experiment="run into both ends slowly and fast, and start out of them",
    limits="outflow alone; a chamber as target (<cylinder>/a) has it at that end alone",
)  # fmt: skip

CAVITATION = Effect(
    name="cavitation",
    channel="flow",
    equation="q = Vg',  Vg' = g (pv - p) below pv, -Vg / tau above until Vg = 0; p absolute",
    source="discrete vapour cavity; Wylie and Streeter, Fluid Transients in Systems (1993)",
    parameters=(
        ParameterSpec(
            "conductance", "m^3/(s Pa)", "g, growth of the cavity per pressure missing", 0.0, 1e-5,
            1e-7, linear=True, optional=True,
        ),
        ParameterSpec("pressure", "Pa", "pv, absolute, of vapour or released air", 0.0, 1e5, 2e4),
    ),
    terms=(Term(Stage.FLOW_A, _cavity_a), Term(Stage.FLOW_B, _cavity_b)),
    states=(
        InternalState(_cavity_a, nothing, 1e-6),
        InternalState(_cavity_b, nothing, 1e-6),
    ),
    channels=("flow_b", "flow_a"),
    looks_like=("entrained_air", "pressure_sensor_bias"),
    separating_experiment="lower a heavy load faster and faster: the pressure stops falling",
    limits="how fast released air dissolves again is left out",
)  # fmt: skip

LINE_EFFECTS = (LINE_DYNAMICS, END_CUSHION, CAVITATION)
