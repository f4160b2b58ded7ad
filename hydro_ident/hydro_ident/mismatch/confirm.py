"""Unnamed dependence put to rows that took no part: it has to be there, too.

The function as found is laid over the other rows' variables, behind a refit of the base to these
rows. What follows time cannot be looked for at other times: it is left to its own chance level.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.check import Check
from hydro_ident.mismatch.dependence import Dependence, alone, values_of
from hydro_ident.mismatch.fitting import Fitted, fitted
from hydro_ident.mismatch.lines import waves
from hydro_ident.mismatch.scoring import signs
from hydro_ident.mismatch.state_space import factors_of, hats
from hydro_ident.mismatch.training import Training
from hydro_ident.mismatch.verify import VERIFIED
from hydro_model.robot import FloatArray

#: Blocks below which held-out rows can tell nothing.
_LEAST_BLOCKS = 20


class Confirmer:
    """Rows to confirm on, laid out once.

    Parameters
    ----------
    check : Check
    whole : Fitted
        The final model on the training rows.

    Attributes
    ----------
    training : Training
        The rows that took no part.
    fitted : Fitted
        The model on them.
    """

    def __init__(self, check: Check, whole: Fitted) -> None:
        self.training = Training.of(check.predictor, check.mask & check.moving)
        self.fitted = fitted(self.training, whole.model, None)

    def holds(self, found: Dependence) -> bool:
        """Whether a dependence is there on the other rows."""
        names = self.training.predictor.material.channels
        if found.channel >= len(names) or found.variable == "time":
            return True
        own, bench = alone(self.training, self.fitted, found.channel)
        if bench is None:
            return True
        values = values_of(own, self.fitted, found.channel)
        factor = np.ones(own.mask.size)
        if found.times:
            model = self.fitted.model
            factor = factors_of(own.predictor, model, found.channel, values, own.mask)[found.times]
        at = values[found.variable]
        if not np.isfinite(at[own.mask]).all() or not np.isfinite(factor[own.mask]).all():
            return True
        if found.period:
            pieces = waves(at[own.mask] / found.period)
        else:
            pieces = hats(at[own.mask], found.knots)
        column = np.zeros(own.mask.size)
        column[own.mask] = pieces @ found.coefficients * factor[own.mask]
        return _chance(bench, column[own.mask]) <= VERIFIED


def _chance(bench: Bench, column: FloatArray) -> float:
    """Share of sign flips of whole blocks that reach the column's product with the residual."""
    white = bench.beyond(column[:, None])
    sums = bench.by_block(white * bench.residual[:, None])[:, 0]
    if sums.size < _LEAST_BLOCKS:
        return 0.0  # Too few to speak against it.
    total = float(sums.sum())
    if total <= 0.0:
        return 1.0
    drawn = signs(sums.size) @ sums
    return float((1 + np.sum(drawn >= total)) / (1 + drawn.size))
