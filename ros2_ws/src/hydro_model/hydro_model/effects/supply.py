"""Supply and tank lines that give way under flow; they act on every valve of the robot.

Both follow the flow with a lag. It is physical (the line stores oil) and it makes the pressure a
state, so that flow and pressure need not be solved for together.
"""

from __future__ import annotations

from hydro_model.effects.effect import Effect
from hydro_model.effects.law import InternalState, ParameterSpec, Row, Stage, Term
from hydro_model.effects.signals import RETURN_FLOW, STATE_0, SUPPLY_FLOW


def _lower_supply(s: Row, p: Row) -> float:
    return -s[STATE_0]


def _droop(s: Row, p: Row) -> float:
    return p[0] * s[SUPPLY_FLOW]


def _droop_rate(s: Row, p: Row) -> float:
    return (p[0] * s[SUPPLY_FLOW] - s[STATE_0]) / p[1]


def _raise_tank(s: Row, p: Row) -> float:
    return s[STATE_0]


def _back_pressure(s: Row, p: Row) -> float:
    return p[0] * s[RETURN_FLOW] * abs(s[RETURN_FLOW])


def _back_pressure_rate(s: Row, p: Row) -> float:
    return (p[0] * s[RETURN_FLOW] * abs(s[RETURN_FLOW]) - s[STATE_0]) / p[1]


SUPPLY_DROOP = Effect(
    name="supply_droop",
    channel="flow",
    equation="p_S = p_S0 - d,  tau d' = R Q_S - d",
    source="pump controller and supply line under the flow of all valves",
    parameters=(
        ParameterSpec("resistance", "Pa s/m^3", "R", 0.0, 1e11, 4e8),
        ParameterSpec("time_constant", "s", "tau", 1e-3, 10.0, 0.1),
    ),
    terms=(Term(Stage.SUPPLY, _lower_supply),),
    states=(InternalState(_droop_rate, _droop, 1e6, linear=True),),
    channels=("flow_a", "flow_b"),
    acts_on="robot",
    looks_like=("valve_gain_nonlinearity", "edge coefficients"),
    separating_experiment="record the supply pressure; move one joint, then both",
)

TANK_BACK_PRESSURE = Effect(
    name="tank_back_pressure",
    channel="flow",
    equation="p_T = p_T0 + b,  tau b' = R Q_T |Q_T| - b",
    source="turbulent return line",
    parameters=(
        ParameterSpec("resistance", "Pa s^2/m^6", "R", 0.0, 1e14, 2e11),
        ParameterSpec("time_constant", "s", "tau", 1e-3, 10.0, 0.02, optional=True),
    ),
    terms=(Term(Stage.TANK, _raise_tank),),
    states=(InternalState(_back_pressure_rate, _back_pressure, 1e6, linear=True),),
    channels=("flow_a", "flow_b"),
    acts_on="robot",
    looks_like=("edge coefficients c_at and c_bt",),
    separating_experiment="record the tank pressure; staircase of speeds",
)

SUPPLY_EFFECTS = (SUPPLY_DROOP, TANK_BACK_PRESSURE)
