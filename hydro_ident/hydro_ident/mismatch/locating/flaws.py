"""What flaws of a model's form may leave in a channel: dependence that is no missing physics.

A law that is a little off leaves smooth functions of what the machine does: they neither repeat
several times over the stroke nor swing at frequencies at which nothing moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.precision import measured_sizes
from hydro_ident.mismatch.rows.state_space import row_values
from hydro_ident.mismatch.settings import (
    FORM_TOLERANCE,
    PRECISION,
    PRECISION_FLOW,
    PRECISION_UNNAMED,
)
from hydro_model.arrays import IndexArray
from hydro_model.robot import FloatArray

#: What the machine does, of which flaws are functions.
_DOES = ("piston_velocity", "piston_acceleration", "valve_signal")
#: A law may make so many times as much at a frequency of what moves there.
_MADE = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Flaws:
    """What flaws of a fitted model may leave, with what it needs of all rows worked out once.

    Attributes
    ----------
    training : Training
    fitted : Fitted
    named : (K,) array
        What named effects do in each channel, rms about its mean, in its unit.
    measured : (K,) array
        What each channel measures, rms.
    """

    training: Training
    fitted: Fitted
    named: FloatArray
    measured: FloatArray

    @staticmethod
    def of(training: Training, fitted: Fitted) -> Flaws:
        """Those of a model on its training rows."""
        predictor, mask = training.predictor, training.mask
        every = range(len(predictor.material.channels))
        rows = [(predictor.material.channel == k) & mask for k in every]
        squares = np.zeros(len(rows))
        for term in fitted.model.terms:
            part = predictor.contribution(fitted.model, term)
            squares += [float(np.var(part[own])) if own.any() else 0.0 for own in rows]
        return Flaws(training, fitted, np.sqrt(squares), measured_sizes(training, fitted.model))

    def least(
        self, channel: int, share: float = PRECISION_UNNAMED, tolerance: float = FORM_TOLERANCE
    ) -> float:
        """Rms below which what is left is one of named effects' form or of what is measured.

        Parameters
        ----------
        channel : int
        share, tolerance : float
            Of what the channel measures, and of what named effects do there.
        """
        return max(tolerance * float(self.named[channel]), share * float(self.measured[channel]))

    def of_form(self, one: Dependence, *, wandering: bool = False) -> float:
        """Rms below which a function is a flaw of the model's form and precision, in its unit.

        Parameters
        ----------
        one : Dependence
        wandering : bool
            It is one of time that does not repeat: no form's.
        """
        share = 0.0 if wandering else _share(self.training, self.fitted, one)
        return self.least(one.channel, share)


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
    material = predictor.material
    return swinging(material.time_s[own], values, 1.0 / one.period, material.recording[own])


def swinging(
    time_s: FloatArray, values: FloatArray, frequency_hz: float, recording: IndexArray
) -> float:
    """Share (rms) of a signal that swings at a frequency, in each recording at its own phase.

    Parameters
    ----------
    time_s, values : (N,) array
    frequency_hz : float
    recording : (N,) int array
    """
    swing = values - values.mean()
    turned = swing * np.exp(-2j * np.pi * frequency_hz * time_s)
    lines = [turned[recording == r] for r in np.unique(recording)]
    square = sum(float(np.abs(own.sum()) ** 2) / own.size for own in lines) / values.size
    size = float(np.sqrt(np.mean(swing**2)))
    return float(np.sqrt(2.0 * square)) / size if size > 0.0 else 0.0
