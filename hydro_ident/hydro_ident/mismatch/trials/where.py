"""Where in state space a finding shows: the variable that it acts through, and its range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.mismatch.rows.line_flow import line_flow
from hydro_ident.mismatch.rows.prediction import Model
from hydro_ident.mismatch.rows.state_space import SIGNALS, row_values
from hydro_ident.mismatch.trials.places import mean_oil_c
from hydro_model.effects.effect import Stage
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: The variable of the contract that each effect is best seen against.
VARIABLES = {
    "coulomb_friction": "piston_velocity",
    "stribeck_friction": "piston_velocity",
    "asymmetric_friction": "piston_velocity",
    "pressure_dependent_friction": "piston_velocity",
    "presliding_friction": "piston_velocity",
    "quadratic_friction": "piston_velocity",
    "position_dependent_friction": "piston_position",
    "temperature_drift": "time",
    "pin_friction": "piston_velocity",
    "rotor_inertia": "piston_acceleration",
    "load_dependent_friction": "piston_velocity",
    "payload_change": "time",
    "cylinder_inertia": "joint_angle",
    "structural_flexibility": "piston_acceleration",
    "backlash": "piston_force",
    "encoder_offset": "joint_angle",
    "base_tilt": "joint_angle",
    "pressure_sensor_gain": "piston_force",
    "counterbalance_spring": "piston_position",
    "joint_coupling": "other_joint",
    "external_contact": "piston_position",
    "valve_deadband": "valve_signal",
    "valve_underlap": "valve_signal",
    "valve_null_bias": "valve_signal",
    "valve_gain_nonlinearity": "valve_signal",
    "valve_spool_lag": "valve_rate",
    "valve_rate_limit": "valve_rate",
    "valve_hysteresis": "valve_rate",
    "internal_leakage": "piston_force",
    "external_leakage": "pressure_a",
    "dead_volume": "piston_acceleration",
    "entrained_air": "pressure_b",
    "cavitation": "pressure_b",
    "supply_droop": "total_flow",
    "tank_back_pressure": "total_flow",
    "counterbalance_valve": "pressure_b",
    "pressure_compensation": "supply_pressure",
    "end_cushion": "piston_position",
    "line_dynamics": "valve_rate",
    "pressure_delay": "valve_rate",
    "command_delay": "valve_rate",
}
#: Effects of each chamber by itself: seen against its own pressure, whichever it is.
_OF_CHAMBERS = frozenset({"external_leakage", "entrained_air", "cavitation"})
#: The two variables of a chamber's pressure, by its channel.
_OWN_PRESSURE = {"flow_a": "pressure_a", "flow_b": "pressure_b"}
#: What is no signal of the channel's own cylinder.
_TOTAL_FLOW = "total_flow"
#: Share of a finding's size that lies below and above the range that is given.
_TAIL = 0.05


@dataclass(frozen=True, slots=True)
class Where:
    """A place in state space.

    Attributes
    ----------
    variable : str
        Of the contract.
    low, high : float
        Range that holds nine tenths of the finding's squared size.
    text : str
    """

    variable: str
    low: float
    high: float
    text: str


def where_of(training: Training, model: Model, term: ActiveEffect, channel: str) -> Where:
    """Where a term of a model shows.

    Parameters
    ----------
    training : Training
    model : Model
        With the term.
    term : ActiveEffect
    channel : str
        In which it is looked at.
    """
    predictor = training.predictor
    material = predictor.material
    variable = _variable_of(training, term, channel)
    number = material.channels.index(channel)
    rows = (material.channel == number) & training.mask
    overall = f"in {channel}, over the whole recording"
    values = _values(training, model, term, number, variable)
    if values is None:
        return Where(variable, 0.0, 0.0, overall)
    values = values[rows]
    size = predictor.contribution(model, term)[rows] ** 2
    known = np.isfinite(values)
    values, size = values[known], size[known]
    if not values.size or size.sum() <= 0.0:
        return Where("everywhere", 0.0, 0.0, overall)
    order = np.argsort(values)
    share = np.cumsum(size[order]) / size.sum()
    low, high = (
        float(values[order][min(int(np.searchsorted(share, q)), values.size - 1)])
        for q in (_TAIL, 1.0 - _TAIL)
    )
    words = ChannelWords(material.robot, channel)
    unit = words.unit(variable)
    text = f"in {channel}, at a {words.prose(variable)} of {low:.3g} to {high:.3g}"
    text += "" if unit == "1" else f" {unit}"
    text += " through all valves" if variable == _TOTAL_FLOW else ""
    return Where(variable, low, high, text)


def _variable_of(training: Training, term: ActiveEffect, channel: str) -> str:
    """The variable of the contract that a term is best seen against in a channel."""
    name = term.effect.name
    if name == "temperature_drift" and mean_oil_c(training.predictor.material) is not None:
        return "oil_temperature"
    variable = VARIABLES.get(name, "everywhere")
    own = _OWN_PRESSURE.get(channel.rpartition("/")[2], variable)
    return own if name in _OF_CHAMBERS else variable


def _values(
    training: Training, model: Model, term: ActiveEffect, channel: int, variable: str
) -> FloatArray | None:
    """That variable on the rows, (N,); None where it is none of any row."""
    if variable == _TOTAL_FLOW:
        on_tank = Stage.TANK in term.effect.stages
        return line_flow(training.predictor, model, channel, on_tank=on_tank)
    if variable not in SIGNALS:
        return None
    return row_values(training.predictor, model, channel, variable)
