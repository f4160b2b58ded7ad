"""Findings that undo one another in a channel: neither is told by it, and each needs the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.naming.worth import STATIC
from hydro_ident.mismatch.rows.modelled import same
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.robot import FloatArray

#: Share of the smaller one that two effects leave of one another at most, where they cancel.
_LEFT = 0.1


def cancelled(work: Residuals, whole: Fitted, findings: Sequence[Finding]) -> list[Finding]:
    """Two findings that undo one another in a channel, with the reason; none where no two do.

    A transducer's zero that is not there, named for what another law left in a flow, pushes the
    force, and a force that nobody exerts is named to hold against it. That two true causes do so
    to a tenth would be chance.

    Parameters
    ----------
    work : Residuals
    whole : Fitted
        With all findings.
    findings : sequence of Finding

    Returns
    -------
    list of Finding
        None or two.
    """
    static = [f for f in findings if f.named.term.effect.name in STATIC]
    parts = {id(f): _contribution(work, whole, f) for f in static}
    for one, other in combinations(static, 2):
        for channel, rows in _shared(work, one, other):
            own, others = parts[id(one)][rows], parts[id(other)][rows]
            smaller = min(rms(own), rms(others))
            if smaller > 0.0 and rms(own + others) <= _LEFT * smaller:
                return [_refused(f, g, channel) for f, g in ((one, other), (other, one))]
    return []


def _contribution(work: Residuals, whole: Fitted, finding: Finding) -> FloatArray:
    """What a finding adds to the prediction of the training rows, (N,)."""
    terms = [t for t in whole.model.terms if same(t, finding.named.term)]
    predictor = work.training.predictor
    none = np.zeros(work.training.mask.size)
    return sum((predictor.contribution(whole.model, t) for t in terms), start=none)


def _shared(work: Residuals, one: Finding, other: Finding) -> Iterator[tuple[str, FloatArray]]:
    """Channels in which one of two findings shows, and their rows of the training."""
    material, mask = work.training.predictor.material, work.training.mask
    for k, name in enumerate(material.channels):
        if name in one.channels or name in other.channels:
            yield name, mask & (material.channel == k)


def _refused(finding: Finding, other: Finding, channel: str) -> Finding:
    beside = other.named.term
    reason = (
        f"{beside.effect.name} of {beside.target} undoes it in {channel}: neither is told by that"
    )
    verification = replace(finding.verification, stands=False, reason=reason)
    return replace(finding, verification=verification)
