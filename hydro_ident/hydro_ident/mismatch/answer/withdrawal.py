"""Names that explain less than what is left in their own channel are taken back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hydro_ident.mismatch.answer.contributing import gains_of, without_these
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.answer.spoilt import sides_of
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.settings import FAR, NAMED_SHARE
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.where import VARIABLES
from hydro_ident.mismatch.unnamed.unknown import Unexplained, unexplained
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_ident.mismatch.verifying.judging import FAINTLY

#: Share of what a name explains from which a confirmed remainder takes it away.
_CONFIRMED_SHARE = (1.0 - NAMED_SHARE) / NAMED_SHARE
#: The same for a name that held-out rows do not exercise: less than this is its law's own form.
_BESIDE_SILENT = 0.1
#: Rmse of held-out rows with all findings, over that without any, from which a name that nothing
#: replaces stays, or share of its rows' variance.
_HALVED, _MOSTLY = 0.5, 0.5


def withdrawn(
    work: Residuals, whole: Fitted, findings: list[Finding]
) -> tuple[Fitted, list[Finding], list[Finding], list[Dependence]]:
    """Take back names that explain less than what is left in their own channel.

    Returns
    -------
    whole : Fitted
        Without them.
    findings, taken : list of Finding
    left : list of Dependence
        Of the residual then.
    """
    taken: list[Finding] = []
    given, everything = whole, list(findings)
    left = first = dependences(work.training, whole)
    while weak := _explain_less(work, whole, findings, left):
        whole = without_these(work, whole, [f.named for f in weak])
        findings = [f for f in findings if f not in weak]
        taken += weak
        left = dependences(work.training, whole)
    told = _significant(work, whole, left) if taken else {}
    back = _better_answers(work, given, first, taken, told)
    if back:
        taken = [f for f in taken if f not in back]
        findings = [f for f in everything if f not in taken]
        whole = without_these(work, given, [f.named for f in taken]) if taken else given
        left = dependences(work.training, whole)
    return whole, findings, taken, left


def _better_answers(
    work: Residuals,
    given: Fitted,
    first: Sequence[Dependence],
    taken: Sequence[Finding],
    told: Mapping[str, Unexplained],
) -> list[Finding]:
    """Of names that were taken back, those that say more than what is told without them.

    Where nothing is, a name that explains much is the better answer. Where a dependence is, and
    with the name none was, it is that dependence's name if it acts through the same variable, or
    if held-out rows are off by half without it: they may not exercise the effect itself, and tell
    by a base that had taken it up.
    """
    if not taken:
        return []
    before, sides = _significant(work, given, first), sides_of(work, given)
    result = []
    for finding in taken:
        channel = finding.channels[0]
        instead = told.get(channel)
        without, with_it = sides.get(channel, (0.0, 0.0))
        halved = with_it < _HALVED * without
        if instead is None:
            if halved or _share(work, given, finding) > _MOSTLY:
                result.append(finding)
        elif channel not in before and (
            halved or _alike(instead.dependence.variable, _variable(finding))
        ):
            result.append(finding)
    return result


def _alike(one: str, other: str) -> bool:
    """Whether two variables are the same, whichever chamber's pressure they are."""
    return one == other or {one, other} == {"pressure_a", "pressure_b"}


def _share(work: Residuals, whole: Fitted, finding: Finding) -> float:
    """How much of what is left without a finding it explains on the training rows (variance)."""
    channel = finding.channels[0]
    material, mask = work.training.predictor.material, work.training.mask
    own = mask & (material.channel == material.channels.index(channel))
    without = without_these(work, whole, [finding.named])
    return 1.0 - (rms(whole.residual[own]) / max(rms(without.residual[own]), 1e-300)) ** 2


def _significant(
    work: Residuals, whole: Fitted, left: Sequence[Dependence]
) -> dict[str, Unexplained]:
    """What has no name, by channel."""
    holds = Confirmer(work.training, work.check, whole).holds
    return {one.channel: one for one in unexplained(work.training, whole, left, holds)}


def _explain_less(
    work: Residuals, whole: Fitted, findings: Sequence[Finding], left: Sequence[Dependence]
) -> list[Finding]:
    """Findings that explain less than what is left in their own channel."""
    material, taken = work.training.predictor.material, list[Finding]()
    significant = _significant(work, whole, left).values()
    # What other rows confirm takes a name away sooner than what they could not.
    for finding in findings:
        channel = finding.channels[0]
        at, formed = material.channels.index(channel), _variable(finding)
        total = gains_of(work, whole, finding.named)[at]
        # What follows the variable of a larger law that was found there, too, is that one's form.
        larger = {
            _variable(f): float(gains_of(work, whole, f.named)[at])
            for f in findings
            if f is not finding and channel in f.channels
        }
        own = [
            u
            for u in significant
            if u.channel == channel
            and u.dependence.gain > larger.get(u.dependence.variable, 0.0) * _CONFIRMED_SHARE
        ]
        # What follows its own variable is its own form: that takes it away later.
        doubted = [u.confirmed and u.dependence.variable != formed for u in own]
        most = [total * (_CONFIRMED_SHARE if sooner else 1.0) for sooner in doubted]
        # What held-out rows cannot show is no name beside what is something else: little of it
        # where they show that, more where they cannot.
        doubtful = _far_from_floor(work, whole, channel) or any(
            u.dependence.gain > total * (_BESIDE_SILENT if u.confirmed else _CONFIRMED_SHARE)
            for u in own
        )
        silent = finding.verification.silent and finding.verification.p_value > FAINTLY
        if (silent and doubtful) or any(
            u.dependence.gain > limit for u, limit in zip(own, most, strict=True)
        ):
            taken.append(finding)
    return taken


def _far_from_floor(work: Residuals, whole: Fitted, channel: str) -> bool:
    """Whether the model as a whole does not describe a channel: who knows what else is in it."""
    material, mask = work.training.predictor.material, work.training.mask
    own = mask & (material.channel == material.channels.index(channel))
    floor = work.noise_floors().get(channel, np.inf)
    return bool(rms(whole.residual[own]) > FAR * floor)


def _variable(finding: Finding) -> str:
    """The variable through which a finding acts; empty for none."""
    return VARIABLES.get(finding.named.term.effect.name, "")
