"""What a finding does in a model, beyond what a refit of the base makes of it without."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import FROM_AFAR, fit
from hydro_ident.mismatch.fitting.handover import late_valves
from hydro_ident.mismatch.naming.named import Named
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Gain at which a contribution stands out in a channel by itself.
_SHOWN = 25.0


def without_these(
    work: Residuals,
    whole: Fitted,
    without: Sequence[Named],
    instead: Sequence[ActiveEffect] = (),
) -> Fitted:
    """The model fitted anew without some findings, and with other effects in their place.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        With all of them.
    without : sequence of Named
    instead : sequence of ActiveEffect, optional
    """
    kept = tuple(
        t
        for t in whole.model.terms
        if not any(_is_of(named, t.effect.name, t.target) for named in without)
    )
    # From the base's own numbers: what a wrong effect has driven the others to may be anything.
    model = replace(work.base.model, terms=(*kept, *instead))
    return fit(work.training, model, passes=FROM_AFAR)


def _is_of(named: Named, name: str, target: str) -> bool:
    return named.term.effect.name == name and named.term.target == target


def gains_of(work: Residuals, whole: Fitted, named: Named) -> FloatArray:
    """What a finding explains beyond a refit of the base, by channel of the training rows.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        With it.
    named : Named

    Returns
    -------
    (C,) array
        Sums of squares in units of the noise's variance; 0 where it does nothing.
    """
    training = work.training
    terms = [t for t in whole.model.terms if _is_of(named, t.effect.name, t.target)]
    base = whole.columns[:, : len(training.predictor.names)].copy()
    if named.term.effect.name == DELAY:
        # Of what is beyond a cycle a base's own delays may have next to nothing.
        columns = training.predictor.delay_columns
        base[:, [columns[i] for i in late_valves(named.term, columns)]] = 0.0
    alone = training.bench(whole.bench.noise, whole.residual, base, whole.offset)
    column = np.zeros(training.mask.size)
    for term in terms:
        column += training.predictor.contribution(whole.model, term)
    own = alone.beyond(column[training.mask][:, None])[:, 0]
    channels = training.predictor.material.channels
    acting = [column[training.predictor.material.channel == k].any() for k in range(len(channels))]
    squares = [float(np.sum(own[alone.channel == k] ** 2)) for k in range(len(channels))]
    return np.where(acting, squares, 0.0)


def acting_channels(work: Residuals, whole: Fitted, named: Named) -> tuple[str, ...]:
    """Channels in which a finding shows beyond a refit, strongest first; none if it is idle.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        With it.
    named : Named
    """
    gains = dict(
        zip(
            work.training.predictor.material.channels,
            gains_of(work, whole, named).tolist(),
            strict=True,
        )
    )
    strongest = max(gains.values())
    # A finding shows in a channel where it would have been found from that channel alone.
    shown = [n for n, g in gains.items() if g > 0.0 and g >= min(_SHOWN, strongest)]
    return tuple(sorted(shown, key=lambda n: -gains[n]))
