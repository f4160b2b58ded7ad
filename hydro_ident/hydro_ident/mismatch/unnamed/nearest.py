"""Of what has no name, the effect of the catalogue that comes nearest to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.naming.contenders import firsts
from hydro_ident.mismatch.trials.scoring import Score
from hydro_ident.mismatch.unnamed.unknown import Unexplained

#: Share of a channel's residual (variance, whitened) from which an effect is said to come near.
_NEAR = 0.5
#: How many effects of a channel are looked at, those that gained most.
_MOST = 3


def with_nearest(
    training: Training,
    whole: Fitted,
    scanned: Sequence[Score],
    unknown: Sequence[Unexplained],
) -> tuple[Unexplained, ...]:
    """What has no name, each with the effect that would take most of its channel's residual.

    It was tried and not named: where few blocks hold it, or something else is in them too, no
    flips of their signs tell it from chance, or held-out rows do not gain by it.

    Parameters
    ----------
    training : Training
    whole : Fitted
        With all findings.
    scanned : sequence of Score
        Of the last search, those that were not named.
    unknown : sequence of Unexplained
    """
    leading = firsts(scanned) if unknown else []
    return tuple(_with_nearest(training, whole, leading, one) for one in unknown)


def _with_nearest(
    training: Training, whole: Fitted, leading: Sequence[Score], one: Unexplained
) -> Unexplained:
    material = training.predictor.material
    channel = material.channels.index(one.channel)
    own = material.channel == channel
    there = {(t.effect.name, t.target) for t in whole.model.terms}
    near = [s for s in leading if (s.entry.rows & own).any() and _of(s) not in there][:_MOST]
    shares = [_share(training, whole, s, channel) for s in near]
    best = int(np.argmax(shares)) if shares else -1
    if best < 0 or shares[best] < _NEAR:
        return one
    name, target = _of(near[best])
    told = f"; {name} of {target} comes nearest, with {shares[best]:.0%} of what is left there"
    return replace(one, text=one.text + told + ", and could not be confirmed")


def _of(one: Score) -> tuple[str, str]:
    return one.entry.trial.name, one.entry.trial.target


def _share(training: Training, whole: Fitted, one: Score, channel: int) -> float:
    """Share of a channel's whitened residual that a trial takes, at whatever size does best."""
    mask, bench = training.mask, whole.bench
    column = one.entry.columns(mask.size)[mask] @ one.coefficients
    rows = bench.channel == channel
    left, residual = bench.beyond(column[:, None])[rows, 0], bench.residual[rows]
    along = float(left @ residual)
    whole_of_it = float(left @ left) * float(residual @ residual)
    return along**2 / whole_of_it if along > 0.0 and whole_of_it > 0.0 else 0.0
