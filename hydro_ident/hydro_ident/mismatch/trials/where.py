"""Where in state space a finding shows: the variable that it acts through, and its range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.channel_words import ChannelWords
from hydro_ident.mismatch.rows.prediction import Model
from hydro_ident.mismatch.rows.state_space import SIGNALS, row_values
from hydro_ident.mismatch.trials.places import mean_oil_c
from hydro_model.effects.targets import ActiveEffect

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
    variable = VARIABLES.get(term.effect.name, "everywhere")
    if term.effect.name == "temperature_drift" and mean_oil_c(material) is not None:
        variable = "oil_temperature"
    number = material.channels.index(channel)
    rows = (material.channel == number) & training.mask
    if variable not in SIGNALS:
        text = f"in {channel}, over the whole recording"
        return (
            Where(variable, 0.0, 0.0, text) if variable == "everywhere" else _flow(variable, text)
        )
    values = row_values(predictor, model, number, variable)[rows]
    size = predictor.contribution(model, term)[rows] ** 2
    known = np.isfinite(values)
    values, size = values[known], size[known]
    if not values.size or size.sum() <= 0.0:
        return Where("everywhere", 0.0, 0.0, f"in {channel}, over the whole recording")
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
    return Where(variable, low, high, text)


def _flow(variable: str, text: str) -> Where:
    return Where(variable, 0.0, 0.0, text + ", with the flow of all valves")
