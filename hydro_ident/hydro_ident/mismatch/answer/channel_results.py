"""What is left of every channel before and after a diagnosis."""

from __future__ import annotations

from hydro_ident.mismatch.answer.outcome import ChannelResult
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.naming.instants import both_at_own_instants
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.split.residuals import Residuals


def rows_of_training(work: Residuals) -> Check:
    """The rows that were fitted, to look at as those to check on."""
    mask = work.training.mask
    return Check(work.training.predictor, mask, mask)


def channels_of(work: Residuals, whole: Fitted, check: Check) -> tuple[ChannelResult, ...]:
    """Measured values of some rows and what the base and a model leave of them, by channel.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
    check : Check
        Whose rows.
    """
    floors = work.noise_floors()
    models = both_at_own_instants(work.training, check, work.base.model, whole.model)
    before, after = (check.residual(model) for model in models)
    material = check.predictor.material
    measured = check.predictor.base(work.base.model)[0]
    result = []
    for k, name in enumerate(material.channels):
        rows = check.rows(k, name)
        if rows.any() and name in floors:
            # With corrected sensors the measured side moves: errors are what is compared.
            y, times, unit = measured[rows], material.time_s[rows], material.units[k]
            first, last = y - before[rows], y - after[rows]
            result.append(ChannelResult(name, unit, times, y, first, last, floors[name]))
    return tuple(result)
