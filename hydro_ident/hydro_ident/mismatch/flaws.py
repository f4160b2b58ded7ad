"""What flaws of a model's form may leave in a channel: dependence that is no missing physics.

A law that is a little off leaves smooth functions of what the machine does: they neither repeat
several times over the stroke nor swing at frequencies at which nothing moves.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.mismatch.dependence import Dependence
from hydro_ident.mismatch.fitting import Fitted
from hydro_ident.mismatch.precision import measured_size
from hydro_ident.mismatch.settings import (
    FORM_TOLERANCE,
    PRECISION,
    PRECISION_FLOW,
    PRECISION_UNNAMED,
)
from hydro_ident.mismatch.state_space import row_values
from hydro_ident.mismatch.training import Training
from hydro_model.robot import FloatArray

#: What the machine does, of which flaws are functions.
_DOES = ("piston_velocity", "piston_acceleration", "valve_signal")
#: A law may make so many times as much at a frequency of what moves there.
_MADE = 10.0


def flaw_of_form(
    training: Training, fitted: Fitted, one: Dependence, *, wandering: bool = False
) -> float:
    """Rms below which a function is a flaw of the model's form and precision, in its unit.

    Parameters
    ----------
    training : Training
    fitted : Fitted
    one : Dependence
    wandering : bool
        It is one of time that does not repeat: no form's.
    """
    share = 0.0 if wandering else _share(training, fitted, one)
    return least_of_form(training, fitted, one.channel, share)


def least_of_form(
    training: Training,
    fitted: Fitted,
    channel: int,
    share: float = PRECISION_UNNAMED,
    tolerance: float = FORM_TOLERANCE,
) -> float:
    """Rms below which what is left is a flaw of named effects' form, or a share of the measured.

    Parameters
    ----------
    training : Training
    fitted : Fitted
    channel : int
    share, tolerance : float
        Of what the channel measures, and of what named effects do there.
    """
    predictor = training.predictor
    own = (predictor.material.channel == channel) & training.mask
    parts = [predictor.contribution(fitted.model, term)[own] for term in fitted.model.terms]
    named = tolerance * float(np.sqrt(sum(float(np.var(part)) for part in parts)))
    return max(named, share * measured_size(training, fitted.model, channel) if share else 0.0)


def _share(training: Training, fitted: Fitted, one: Dependence) -> float:
    """Of what a channel measures."""
    flow = training.predictor.material.is_flow(one.channel)
    least = PRECISION_FLOW if flow else PRECISION
    if not one.period or one.times:
        return PRECISION_UNNAMED
    if one.variable != "time":
        return least
    moved = max(_moved(training, fitted, one, name) for name in _DOES)
    return float(np.clip(_MADE * PRECISION_UNNAMED * moved, least, PRECISION_UNNAMED))


def _moved(training: Training, fitted: Fitted, one: Dependence, variable: str) -> float:
    """Share (rms) of a variable that swings at a dependence's frequency; 0 where not known."""
    predictor = training.predictor
    own = (predictor.material.channel == one.channel) & training.mask
    values = row_values(predictor, fitted.model, one.channel, variable)[own]
    if not np.isfinite(values).all() or np.ptp(values) <= 0.0:
        return 0.0
    return swinging(predictor.material.time_s[own], values, 1.0 / one.period)


def swinging(time_s: FloatArray, values: FloatArray, frequency_hz: float) -> float:
    """Share (rms) of a signal that swings at a frequency.

    Parameters
    ----------
    time_s, values : (N,) array
    frequency_hz : float
    """
    swing = values - values.mean()
    line = np.mean(swing * np.exp(-2j * np.pi * frequency_hz * time_s))
    size = float(np.sqrt(np.mean(swing**2)))
    return float(np.sqrt(2.0) * np.abs(line)) / size if size > 0.0 else 0.0
