"""Edges of the valve that do not open as four orifices of one opening.

All are what the flow into a chamber differs by from that of the four edges, so that they need no
second model of the valve. They see the edges' coefficients and the valve's flows (`VALVE_FLOW_A`,
`_B`) with what the laws before them add: what a share is taken of has passed the others.
"""

from __future__ import annotations

import math

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import ParameterSpec, Row, Stage, Term
from hydro_model.effects.signals import (
    EDGE_AT,
    EDGE_BT,
    EDGE_PA,
    EDGE_PB,
    PRESSURE_A,
    PRESSURE_B,
    SUPPLY_PRESSURE,
    TANK_PRESSURE,
    VALVE_FLOW_A,
    VALVE_FLOW_B,
    VALVE_SIGNAL,
)
from hydro_model.hydraulics.valve import SMOOTH_PRESSURE_PA

# Laws call no helpers, so the smoothed signed root of hydro_model.hydraulics.valve stands in each:
# root(d) = d / (d^2 + d0^2)^(1/4).
_SMOOTH = SMOOTH_PRESSURE_PA**2


def _lap_a(s: Row, p: Row) -> float:
    u = s[VALVE_SIGNAL]
    supply = s[SUPPLY_PRESSURE] - s[PRESSURE_A]
    tank = s[PRESSURE_A] - s[TANK_PRESSURE]
    inwards = s[EDGE_PA] * supply / math.sqrt(math.sqrt(supply * supply + _SMOOTH))
    outwards = s[EDGE_AT] * tank / math.sqrt(math.sqrt(tank * tank + _SMOOTH))
    shut = max(p[0] - abs(u), 0.0)
    open_too = shut + p[1] * min(abs(u), p[0])
    return inwards * (open_too if u > 0.0 else shut) - outwards * (shut if u > 0.0 else open_too)


def _lap_b(s: Row, p: Row) -> float:
    u = s[VALVE_SIGNAL]
    supply = s[SUPPLY_PRESSURE] - s[PRESSURE_B]
    tank = s[PRESSURE_B] - s[TANK_PRESSURE]
    inwards = s[EDGE_PB] * supply / math.sqrt(math.sqrt(supply * supply + _SMOOTH))
    outwards = s[EDGE_BT] * tank / math.sqrt(math.sqrt(tank * tank + _SMOOTH))
    shut = max(p[0] - abs(u), 0.0)
    open_too = shut + p[1] * min(abs(u), p[0])
    return inwards * (shut if u > 0.0 else open_too) - outwards * (open_too if u > 0.0 else shut)


def _held_a(s: Row, p: Row) -> float:
    supply, tank = s[SUPPLY_PRESSURE] - s[PRESSURE_A], s[PRESSURE_A] - s[TANK_PRESSURE]
    kept, kept_out = min(supply, p[1]), min(tank, p[1])
    inwards = kept / math.sqrt(math.sqrt(kept * kept + _SMOOTH))
    inwards -= supply / math.sqrt(math.sqrt(supply * supply + _SMOOTH))
    outwards = kept_out / math.sqrt(math.sqrt(kept_out * kept_out + _SMOOTH))
    outwards -= tank / math.sqrt(math.sqrt(tank * tank + _SMOOTH))
    opened, back = max(s[VALVE_SIGNAL], 0.0), max(-s[VALVE_SIGNAL], 0.0)
    return p[0] * s[EDGE_PA] * opened * inwards - p[2] * s[EDGE_AT] * back * outwards


def _held_b(s: Row, p: Row) -> float:
    supply, tank = s[SUPPLY_PRESSURE] - s[PRESSURE_B], s[PRESSURE_B] - s[TANK_PRESSURE]
    kept, kept_out = min(supply, p[1]), min(tank, p[1])
    inwards = kept / math.sqrt(math.sqrt(kept * kept + _SMOOTH))
    inwards -= supply / math.sqrt(math.sqrt(supply * supply + _SMOOTH))
    outwards = kept_out / math.sqrt(math.sqrt(kept_out * kept_out + _SMOOTH))
    outwards -= tank / math.sqrt(math.sqrt(tank * tank + _SMOOTH))
    opened, back = max(-s[VALVE_SIGNAL], 0.0), max(s[VALVE_SIGNAL], 0.0)
    return p[0] * s[EDGE_PB] * opened * inwards - p[2] * s[EDGE_BT] * back * outwards


def _shut_a(s: Row, p: Row) -> float:
    pilot = s[PRESSURE_A] + p[3] * s[PRESSURE_B] - p[1]
    opened = min(max(pilot / p[2], 0.0), 1.0)
    edge = p[0] * max(-s[VALVE_SIGNAL], 0.0)
    if edge <= 0.0:
        return 0.0
    return (1.0 - opened / math.sqrt(opened * opened + edge * edge)) * max(-s[VALVE_FLOW_A], 0.0)


def _shut_b(s: Row, p: Row) -> float:
    pilot = s[PRESSURE_B] + p[3] * s[PRESSURE_A] - p[1]
    opened = min(max(pilot / p[2], 0.0), 1.0)
    edge = p[0] * max(s[VALVE_SIGNAL], 0.0)
    if edge <= 0.0:
        return 0.0
    return (1.0 - opened / math.sqrt(opened * opened + edge * edge)) * max(-s[VALVE_FLOW_B], 0.0)


#: Whether an edge that is open stays wider by the underlap.
SHIFT = ParameterSpec(
    "shift",
    "1",
    "s, share of w by which an edge is wider beyond it",
    0.0,
    1.0,
    1.0,
    optional=True,
)

UNDERLAP = Effect(
    name="valve_underlap",
    channel="flow",
    equation="the edge that u opens is open by |u| + max(w - |u|, 0) + s min(|u|, w), the other by"
    " max(w - |u|, 0): s = 1, w + |u| and w - |u|",
    source="open-centre valves; Merritt, Hydraulic Control Systems (1967), section 5.3; s = 0:"
    " rounded edges, whose openings are the rated ones beyond w",
    parameters=(
        ParameterSpec("width", "1", "w, opening at null", 0.0, 0.3, 0.01),
        SHIFT,
    ),
    terms=(Term(Stage.FLOW_A, _lap_a), Term(Stage.FLOW_B, _lap_b)),
    channels=("flow_a", "flow_b"),
    needs_valve=True,
    looks_like=("internal_leakage", "valve_gain_nonlinearity", "valve_null_bias"),
    separating_experiment="valve at null against a blocked port: pressures go to the middle of"
    " supply and tank, where a leaking piston makes them equal",
    limits="the standing flow from supply to tank is not added to supply_droop's flow",
)

PRESSURE_COMPENSATION = Effect(
    name="pressure_compensation",
    channel="flow",
    equation="inflow c u (a root(min(d, dc)) + (1 - a) root(d)),  d = p_S - p;"
    "  outflow likewise with b, d = p - p_T",
    source="compensator that keeps a constant drop over the metering edge (load sensing)",
    parameters=(
        ParameterSpec("share", "1", "a, share compensated", 0.0, 1.0, 1.0, True, True),
        ParameterSpec("margin", "Pa", "dc, drop kept", 1e5, 1e7, 7e5),
        ParameterSpec(
            "outflow", "1", "b, share of the outflow compensated", 0.0, 1.0, 1.0, True, True, 0.0
        ),
    ),
    terms=(Term(Stage.FLOW_A, _held_a), Term(Stage.FLOW_B, _held_b)),
    channels=("flow_a", "flow_b"),
    needs_valve=True,
    looks_like=("edge coefficients", "supply_droop", "valve_gain_nonlinearity"),
    separating_experiment="the same commands under three loads: the speed does not change",
    limits="the compensator's own motion is left out",
)

COUNTERBALANCE_VALVE = Effect(
    name="counterbalance_valve",
    channel="flow",
    equation="outflow q y / sqrt(y^2 + (r u)^2),  y = clip((p + R p_o - ps) / dp, 0, 1),"
    " u the edge's opening, p_o the other chamber's pressure",
    source="pilot-opened load-holding valves, an orifice in series with the edge; Zaehe,"
    " Counterbalance Stability (Sun Hydraulics)",
    parameters=(
        ParameterSpec("restriction", "1", "r, edge over valve, both fully open", 0.0, 10.0, 0.5),
        ParameterSpec("setting", "Pa", "ps, where it begins to open", 0.0, 6e7, 2e7),
        ParameterSpec("range", "Pa", "dp, from shut to open", 1e5, 2e8, 2e6),
        ParameterSpec("pilot_ratio", "1", "R", 0.0, 20.0, 4.0),
    ),
    sided=True,
    terms=(Term(Stage.FLOW_A, _shut_a), Term(Stage.FLOW_B, _shut_b)),
    channels=("flow_a", "flow_b"),
    needs_valve=True,
    looks_like=("edge coefficients c_at and c_bt", "asymmetric_friction"),
    separating_experiment="lower three different loads with the same commands",
    limits="quasi-static, without the line between the valves; sits at a chamber"
    " (<cylinder>/a), or with the cylinder as target at both. Its spring is vented: one whose"
    " spring chamber drains into the line behind it opens at p + R p_o = ps + (1 + R) p_back,"
    " which is left out, so where the edge or a tank line builds up p_back the fitted ps and dp"
    " hold what that made of them in the recording, and no other flow or tank pressure",
)

EDGE_EFFECTS = (UNDERLAP, PRESSURE_COMPENSATION, COUNTERBALANCE_VALVE)
