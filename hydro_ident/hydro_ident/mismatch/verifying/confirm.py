"""Unnamed dependence put to rows that took no part: it has to be there, too.

The function as found is laid over the other rows' variables, behind a refit of the base to these
rows. What follows time cannot be looked for at other times: it is left to its own chance level.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.training import Training, block_of
from hydro_ident.mismatch.locating.dependence import Dependence, alone, values_of
from hydro_ident.mismatch.locating.lines import waves
from hydro_ident.mismatch.naming.instants import at_own_instants
from hydro_ident.mismatch.rows.state_space import factors_of, hats
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.trials.chance import reached
from hydro_ident.mismatch.verifying.looks import VERIFIED
from hydro_model.robot import FloatArray

#: Blocks below which held-out rows can tell nothing.
_LEAST_BLOCKS = 20


class Confirmer:
    """Rows to confirm on, laid out once.

    Parameters
    ----------
    training : Training
        The rows that the dependence was found on.
    check : Check
    whole : Fitted
        The final model on the training rows.

    Attributes
    ----------
    training : Training
        The rows that took no part.
    fitted : Fitted
        The model on them: what comes and goes does when it does there.
    """

    def __init__(self, training: Training, check: Check, whole: Fitted) -> None:
        self._channels = training.predictor.material.channels
        own = check.training(training)
        # Held-out blocks of one recording are a fifth of its time.
        self.training = replace(own, block_s=block_of(own.layout.occupied_s))
        self.fitted = fitted(self.training, at_own_instants(training, check, whole.model)[0], None)

    def holds(self, found: Dependence) -> bool | None:
        """Whether a dependence is there on the other rows; None where they cannot say."""
        names, name = self.training.predictor.material.channels, self._channels[found.channel]
        if name not in names or found.variable == "time":
            return None
        channel = names.index(name)
        own, bench = alone(self.training, self.fitted, channel)
        if bench is None:
            return None
        values = values_of(own, self.fitted, channel)
        factor = np.ones(own.mask.size)
        if found.times:
            model = self.fitted.model
            factor = factors_of(own.predictor, model, channel, values, own.mask)[found.times]
        at = values[found.variable]
        if not np.isfinite(at[own.mask]).all() or not np.isfinite(factor[own.mask]).all():
            return None
        if found.period:
            pieces = waves(at[own.mask] / found.period)
        else:
            pieces = hats(at[own.mask], found.knots)
        column = np.zeros(own.mask.size)
        column[own.mask] = pieces @ found.coefficients * factor[own.mask]
        chance = _chance(bench, column[own.mask])
        return None if chance is None else chance <= VERIFIED


def _chance(bench: Bench, column: FloatArray) -> float | None:
    """Share of sign flips of whole blocks that reach the column's product with the residual.

    None where there are too few blocks to say.
    """
    white = bench.beyond(column[:, None])
    sums = bench.by_block(white * bench.residual[:, None])[:, 0]
    return None if sums.size < _LEAST_BLOCKS else reached(sums)
