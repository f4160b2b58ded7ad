"""A base that was to be kept, and that the recordings moved further than its file allows.

Rows outweigh what a file states: a load that no effect was named for moves the base by dozens of
its deviations, and nothing is left that a residual would show. Then the file is not this machine.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.locating.precision import drift_of, measured_size
from hydro_ident.mismatch.settings import FORM_TOLERANCE, MOVED, PRECISION, PRECISION_FLOW

#: Share of a usual drift of the transducers from which a force counts, as of static effects.
_DRIFT_SHARE = 0.25
#: Numbers that are told of a channel, those that moved furthest.
_TOLD = 3


def moved_base(training: Training, whole: Fitted, *, grossly: bool = False) -> dict[str, str]:
    """Channels to which a kept base's numbers moved beyond their deviations, in words.

    What it moves there counts from where an effect does.

    Parameters
    ----------
    training : Training
    whole : Fitted
        The final model.
    grossly : bool
        Without edges, moduli and friction that moved by less than their laws are good for:
        minutes of a quiet machine tell an edge to a hundredth of a per cent, and no oil stays so.
    """
    prior, predictor = training.prior, training.predictor
    if prior is None or not np.any(np.abs(training.off(whole.model)) > MOVED):
        return {}
    now, std = predictor.parameters(whole.model), prior.deviations()
    for index, at in predictor.delay_columns.items():
        now[at] = whole.model.delays_s[index]
    step = now - prior.values
    moved = np.flatnonzero(np.abs(step) > MOVED * std).tolist()
    far = {k: float(abs(step[k]) / std[k]) for k in moved}
    links, found = predictor.material.forces.base.names, dict[str, list[int]]()
    for k in sorted(far, key=lambda one: -far[one]):
        of_law = predictor.names[k] not in links
        if grossly and of_law and abs(step[k]) < FORM_TOLERANCE * abs(prior.values[k]):
            continue
        channel = _shows(training, whole, k, float(step[k]))
        if channel:
            found.setdefault(channel, []).append(k)
    names = predictor.names
    return {
        channel: _text(
            channel,
            [_number(names[k], prior.values[k], now[k], far[k]) for k in numbers[:_TOLD]],
            len(numbers) - _TOLD,
        )
        for channel, numbers in found.items()
    }


def _shows(training: Training, whole: Fitted, at: int, step: float) -> str:
    """The channel in which a number's step shows most; empty where it is too small for any."""
    material, mask = training.predictor.material, training.mask
    best, largest = "", 1.0
    for k, name in enumerate(material.channels):
        rows = whole.columns[mask & (material.channel == k), at] * step
        size = float(np.sqrt(np.mean(rows**2))) if rows.size else 0.0
        share = PRECISION_FLOW if material.is_flow(k) else PRECISION
        least = share * measured_size(training, whole.model, k)
        times = size / max(least, _DRIFT_SHARE * drift_of(material, k))
        if times > largest:
            best, largest = name, times
    return best


def _number(name: str, given: float, now: float, deviations: float) -> str:
    if name.endswith(INVERSE_BULK):
        name = name.removesuffix(INVERSE_BULK) + "bulk_modulus"
        given, now = 1.0 / given, 1.0 / now
    return f"{name} {given:.4g} to {now:.4g} ({deviations:.2g} deviations)"


def _text(channel: str, numbers: list[str], more: int) -> str:
    others = f" and {more} more" if more > 0 else ""
    return (
        f"the base is kept, and what fits {channel} is beyond what the robot file states of it:"
        f" {', '.join(numbers)}{others}: a load, an offset or another machine that no effect was"
        " named for, or deviations that are stated too small"
    )
