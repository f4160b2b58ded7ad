"""From what a search names to findings: held-out rows confirm them, or another is looked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.answer.spoilt import made_worse, sides_of
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit, settled
from hydro_ident.mismatch.fitting.handover import late_valves
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.naming.name import Search, Searcher
from hydro_ident.mismatch.naming.named import Named
from hydro_ident.mismatch.naming.one_delay import from_one_delay
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.settings import FAR, NAMED_SHARE
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.where import VARIABLES
from hydro_ident.mismatch.unnamed.unknown import Unexplained, unexplained
from hydro_ident.mismatch.verifying.agreement import fitted_there
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_ident.mismatch.verifying.judging import FAINTLY
from hydro_ident.mismatch.verifying.verify import Verification, verify
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Share of what a name explains from which a confirmed remainder takes it away.
_CONFIRMED_SHARE = (1.0 - NAMED_SHARE) / NAMED_SHARE
#: The same for a name that held-out rows do not exercise: less than this is its law's own form.
_BESIDE_SILENT = 0.1
#: Rmse of held-out rows with all findings, over that without any, from which a name that nothing
#: replaces stays, or share of its rows' variance.
_HALVED, _MOSTLY = 0.5, 0.5
#: Searches, each without what the ones before named and held-out rows did not confirm.
_ROUNDS = 4


def searched(work: Residuals, base: Fitted) -> tuple[Search, Fitted, list[Finding], list[Finding]]:
    """Search and confirm; where nothing stands, what failed may have stood in another's place.

    `base` is the fit that is searched from.
    """
    rejected: list[Finding] = []
    for _ in range(_ROUNDS):
        excluded = {(f.named.term.effect.name, f.named.term.target) for f in rejected}
        search = Searcher(work.scan, base, excluded, work.bank).run()
        whole, findings, failed = _confirmed(work, search)
        rejected += failed
        if findings or not failed:
            break
    return search, whole, findings, rejected


def _confirmed(work: Residuals, search: Search) -> tuple[Fitted, list[Finding], list[Finding]]:
    """Findings that stand on held-out rows, the model with them, and those that do not."""
    whole, named = search.fitted, list(search.named)
    if work.scan is not work.training:
        model = replace(work.base.model, terms=search.fitted.model.terms)
        whole = fit(work.training, model, passes=4)
    rejected: list[Finding] = []
    while named:
        whole = from_one_delay(work.training, settled(work.training, whole))
        there = fitted_there(work.training, work.check, whole)
        found = [_checked(work, whole, there, n, len(search.scanned)) for n in named]
        failed = [f for f in found if not f.verification.stands]
        failed = failed or made_worse(work, whole, found)
        if not failed:
            return whole, found, rejected
        # The worse half at a time: what fails beside a wrong effect may stand without it.
        failed.sort(key=lambda f: (-f.verification.p_value, f.named.gain))
        worst = failed[: (len(failed) + 1) // 2]
        rejected += worst
        named = [n for n in named if not any(n is f.named for f in worst)]
        others = _instead(worst, named)
        named += others
        terms = [other.term for other in others]
        whole = _without(work, whole, [f.named for f in worst], terms)
    return whole, [], rejected


def _instead(refused: Sequence[Finding], kept: Sequence[Named]) -> list[Named]:
    """What may stand in the place of refused findings, beside what was kept and each other."""
    chosen: list[Named] = []
    for one in refused:
        beside = [n.modelled for n in (*kept, *chosen)]
        other = one.named.alternative(beside, unheard=one.verification.silent)
        if other is not None:
            chosen.append(other)
    return chosen


def _checked(
    work: Residuals, whole: Fitted, there: Fitted | None, named: Named, tried: int
) -> Finding:
    """A finding with what held-out rows say of it."""
    channels = _acting(work, whole, named)
    if channels:
        checked = verify(work.training, whole, named, work.check, there, tried, channels)
        return Finding(named, checked, channels)
    reason = "it does nothing once everything is fitted together"
    return Finding(named, Verification(1.0, {}, {}, 0.0, False, reason), ())


def _without(
    work: Residuals,
    whole: Fitted,
    without: Sequence[Named],
    instead: Sequence[ActiveEffect] = (),
) -> Fitted:
    kept = tuple(
        t
        for t in whole.model.terms
        if not any(_is_of(named, t.effect.name, t.target) for named in without)
    )
    # From the base's own numbers: what a wrong effect has driven the others to may be anything.
    model = replace(work.base.model, terms=(*kept, *instead))
    return fit(work.training, model, passes=4)


def _is_of(named: Named, name: str, target: str) -> bool:
    return named.term.effect.name == name and named.term.target == target


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
        whole = _without(work, whole, [f.named for f in weak])
        findings = [f for f in findings if f not in weak]
        taken += weak
        left = dependences(work.training, whole)
    told = _significant(work, whole, left) if taken else {}
    back = _better_answers(work, given, first, taken, told)
    if back:
        taken = [f for f in taken if f not in back]
        findings = [f for f in everything if f not in taken]
        whole = _without(work, given, [f.named for f in taken]) if taken else given
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
    without = _without(work, whole, [finding.named])
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
        total = _gains(work, whole, finding.named)[at]
        # What follows the variable of a larger law that was found there, too, is that one's form.
        larger = {
            _variable(f): float(_gains(work, whole, f.named)[at])
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


def _gains(work: Residuals, whole: Fitted, named: Named) -> FloatArray:
    """What a finding explains beyond a refit of the base, by channel of the training rows."""
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


def _acting(work: Residuals, whole: Fitted, named: Named) -> tuple[str, ...]:
    """Channels in which a finding shows beyond a refit, strongest first; none if it is idle."""
    gains = dict(
        zip(
            work.training.predictor.material.channels,
            _gains(work, whole, named).tolist(),
            strict=True,
        )
    )
    strongest = max(gains.values())
    # A finding shows in a channel where it would have been found from that channel alone.
    shown = [n for n, g in gains.items() if g > 0.0 and g >= min(_SHOWN, strongest)]
    return tuple(sorted(shown, key=lambda n: -gains[n]))


#: Gain at which a contribution stands out in a channel by itself.
_SHOWN = 25.0
