"""The diagnosis, step by step: the pure core of `hydro_ident diagnose`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.bag.recording import Recording
from hydro_ident.errors import IdentError
from hydro_ident.free_run import FreeRun, free_run
from hydro_ident.mismatch.agreement import fitted_there
from hydro_ident.mismatch.check import Check
from hydro_ident.mismatch.confirm import Confirmer
from hydro_ident.mismatch.dependence import Dependence
from hydro_ident.mismatch.describe import form_of
from hydro_ident.mismatch.fitting import Fitted, fit
from hydro_ident.mismatch.locate import dependences
from hydro_ident.mismatch.model import robot_of, summary_of
from hydro_ident.mismatch.name import Search, Searcher
from hydro_ident.mismatch.named import Named
from hydro_ident.mismatch.refinement import Refinement, refine
from hydro_ident.mismatch.residuals import Residuals, residuals
from hydro_ident.mismatch.settings import FEW_MOTIONS, NAMED_SHARE, DiagnosisSettings
from hydro_ident.mismatch.unknown import NotTestable, Unexplained, not_testable, unexplained
from hydro_ident.mismatch.verify import Verification, verify
from hydro_ident.recording_summary import RecordingSummary, recording_summaries
from hydro_ident.sources import Source, sources_of
from hydro_ident.survey import Survey, survey_source
from hydro_ident.verdict import BagLoss, losses_of, wrong_robot
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray, Robot
from hydro_model.terminal import advance

_FEW = (
    "motions of the joints in all: {}. What is held out is of the same ones, so that findings are"
    " confirmed within them alone, and position, pressures and time are hard to tell apart"
)
#: Searches, each without what the ones before named and held-out rows did not confirm.
_ROUNDS = 4
MATCHES, EXPLAINED, PARTLY = "matches", "explained", "partly_explained"
UNKNOWN, NO_IMPROVEMENT, NOT_ENOUGH = "unknown", "no_improvement", "not_enough_data"


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """A named cause that held-out rows confirm.

    Attributes
    ----------
    named : Named
    verification : Verification
    channels : tuple of str
        Where it shows, strongest first.
    """

    named: Named
    verification: Verification
    channels: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ChannelResult:
    """A channel on rows that took no part, or on those that did.

    Attributes
    ----------
    name, unit : str
    time_s, measured, before, after : (T,) array
        Measured values, and what the base and the final model predict.
    noise_floor : float
    """

    name: str
    unit: str
    time_s: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray
    noise_floor: float


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """What a diagnosis found.

    Attributes
    ----------
    verdict : str
    given : Robot
    robot : Robot or None
        With the findings; None with the verdict `not_enough_data`.
    findings : tuple of Finding
    rejected : tuple of Finding
        Named, but not confirmed.
    unexplained : tuple of Unexplained
    not_testable : tuple of NotTestable
    channels : tuple of ChannelResult
    located : tuple of Dependence
        Of the base model's residual, strongest first.
    free_run : FreeRun or None
    problems, notes : tuple of str
    losses : tuple of BagLoss
    work : Residuals or None
    whole : Fitted or None
        The final model on the training rows.
    fitted : tuple of ChannelResult
        As `channels`, on the training rows.
    recordings : tuple of RecordingSummary
    refinement : Refinement or None
        By roll-outs, where it was asked for.
    """

    verdict: str
    given: Robot
    robot: Robot | None
    findings: tuple[Finding, ...] = ()
    rejected: tuple[Finding, ...] = ()
    unexplained: tuple[Unexplained, ...] = ()
    not_testable: tuple[NotTestable, ...] = ()
    channels: tuple[ChannelResult, ...] = ()
    located: tuple[Dependence, ...] = ()
    free_run: FreeRun | None = None
    problems: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    losses: tuple[BagLoss, ...] = ()
    work: Residuals | None = None
    whole: Fitted | None = None
    fitted: tuple[ChannelResult, ...] = ()
    recordings: tuple[RecordingSummary, ...] = ()
    refinement: Refinement | None = None


#: Of a diagnosis, as `advance` counts them.
_STAGES = 7


def diagnose(
    robot: Robot,
    training: Sequence[Recording | Source],
    validation: Sequence[Recording | Source] = (),
    settings: DiagnosisSettings | None = None,
) -> Diagnosis:
    """Find the physics that a robot's model leaves out.

    Parameters
    ----------
    robot : Robot
        Its structure, with the effects it lists, is what is refitted first.
    training : sequence of Recording or Source
        To fit and select on; at least one.
    validation : sequence of Recording or Source
        To verify on; without them every fifth block of `training` is kept for it.
    settings : DiagnosisSettings, optional

    Returns
    -------
    Diagnosis

    Raises
    ------
    IdentError
        No recording was given.
    RobotError
        The robot lists an effect that does not resolve.
    """
    if not training:
        raise IdentError("expected at least one recording to diagnose, found none")
    settings = settings or DiagnosisSettings()
    sources, others = sources_of(training), sources_of(validation)
    advance("first look at the bags", 0, _STAGES)
    surveys = [survey_source(source, robot) for source in (*sources, *others)]
    losses = losses_of([s.recording for s in surveys])
    recordings = recording_summaries(surveys, len(sources))
    wrong = wrong_robot(robot, [s.recording for s in surveys])
    advance("fitting the structure", 1, _STAGES)
    work = None if wrong else residuals(robot, sources, others, surveys, settings)
    if work is None:
        problems = tuple(wrong) or (_too_little(surveys),)
        return Diagnosis(
            NOT_ENOUGH, robot, None, problems=problems, losses=losses, recordings=recordings
        )
    return replace(_diagnosed(work, settings, losses), recordings=recordings)


def _too_little(surveys: Sequence[Survey]) -> str:
    total = sum(s.duration_s for s in surveys)
    return (
        f"{total:.3g} s of recording leave too few rows in any channel: record positions of every"
        " joint in motion, with chamber pressures (or joint torques), for half a minute or more"
    )


def _diagnosed(
    work: Residuals, settings: DiagnosisSettings, losses: tuple[BagLoss, ...]
) -> Diagnosis:
    advance("looking where residuals depend on something", 2, _STAGES)
    base = work.base if work.scan is work.training else fit(work.scan, work.base.model, passes=2)
    located = dependences(work.scan, base)
    advance("searching for effects and testing them", 3, _STAGES)
    search, whole, findings, rejected = _searched(work, base)
    advance("verifying on what was held out", 4, _STAGES)
    left = dependences(work.training, whole)
    whole, findings, withdrawn = _withdrawn(work, whole, findings, left)
    if withdrawn:
        left = dependences(work.training, whole)
    advance("describing what has no name", 5, _STAGES)
    unknown = _described(work, whole, left)
    names = [n for f in findings for n in f.named.names]
    # What was tried and not taken was testable.
    tried = [f.named.term.effect.name for f in rejected] + [n for n, _, _ in search.impossible]
    modelled = robot_of(work.training.predictor, whole, work.robot, settings.fixed_base)
    before = modelled
    if findings:
        before = robot_of(work.training.predictor, work.base, work.robot, settings.fixed_base)
    refined = None
    if settings.refine is not None:
        refined = refine(work, whole, modelled.robot, settings.refine, settings.fixed_base)
        whole, modelled = refined.whole, replace(modelled, robot=refined.robot)
    advance("rolling the models out", 6, _STAGES)
    run = free_run(
        before.robot, modelled.robot, work.check_traces, work.split,
        work.training.predictor.material.filters,
    )  # fmt: skip
    motions = work.training.predictor.material.motions
    few = motions < FEW_MOTIONS
    notes = [_FEW.format(motions)] if few else []
    notes += [*work.notes, *modelled.notes, *run.rejected]
    notes += [refined.note] if refined is not None else []
    notes += [
        f"{f.named.term.effect.name} of {f.named.term.target} was named on the training rows and"
        f" not confirmed: {f.verification.reason}"
        for f in rejected
    ]
    notes += [
        f"{f.named.term.effect.name} of {f.named.term.target} explains too little of what depends"
        " on the same channel to be its name: withdrawn"
        for f in withdrawn
    ]
    notes += [f"not taken: {name} of {at}: {why}" for name, at, why in search.impossible]
    notes.append(f"model: {summary_of(whole.model.terms)}")
    return Diagnosis(
        _verdict(findings, rejected, unknown, few),
        work.robot,
        modelled.robot,
        tuple(findings),
        tuple(rejected),
        unknown,
        not_testable(work.scan, search.scanned, [*names, *tried]),
        _channels(work, whole, work.check),
        tuple(located),
        run,
        (),
        tuple(notes),
        losses,
        work,
        whole,
        fitted=_channels(work, whole, _of_training(work)),
        refinement=refined,
    )


def _described(
    work: Residuals, whole: Fitted, left: Sequence[Dependence]
) -> tuple[Unexplained, ...]:
    """Dependence without a name, with its short form where the data allow one."""
    confirmer = Confirmer(work.training, work.check, whole)
    found = unexplained(work.training, whole, left, confirmer.holds)
    return tuple(
        replace(one, form=form_of(work.training, whole, confirmer, one.dependence))
        for one in found
    )


def _of_training(work: Residuals) -> Check:
    """The rows that were fitted, to look at as those to check on."""
    mask = work.training.mask
    return Check(work.training.predictor, mask, mask)


def _searched(
    work: Residuals, base: Fitted
) -> tuple[Search, Fitted, list[Finding], list[Finding]]:
    """Search and confirm; where nothing stands, what failed may have stood in another's place."""
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
        there = fitted_there(work.training, work.check, whole)
        found = [_checked(work, whole, there, n) for n in named]
        failed = [f for f in found if not f.verification.stands]
        if not failed:
            return whole, found, rejected
        # The worse half at a time: what fails beside a wrong effect may stand without it.
        failed.sort(key=lambda f: (-f.verification.p_value, f.named.gain))
        worst = failed[: (len(failed) + 1) // 2]
        rejected += worst
        named = [n for n in named if not any(n is f.named for f in worst)]
        others = [other for f in worst if (other := f.named.alternative()) is not None]
        named += others
        terms = [other.term for other in others]
        whole = _without(work, whole, [f.named for f in worst], terms)
    return whole, [], rejected


def _checked(work: Residuals, whole: Fitted, there: Fitted | None, named: Named) -> Finding:
    """A finding with what held-out rows say of it."""
    channels = _acting(work, whole, named)
    if channels:
        return Finding(named, verify(work.training, whole, named, work.check, there), channels)
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


def _withdrawn(
    work: Residuals, whole: Fitted, findings: list[Finding], left: Sequence[Dependence]
) -> tuple[Fitted, list[Finding], list[Finding]]:
    """Take back names that explain less than what is left in their own channel."""
    material, taken = work.training.predictor.material, list[Finding]()
    holds = Confirmer(work.training, work.check, whole).holds
    significant = unexplained(work.training, whole, left, holds)
    # What other rows could not confirm takes no name away.
    remains = {u.channel: u.dependence.gain for u in significant if u.confirmed}
    for finding in findings:
        channel = finding.channels[0]
        total = _gains(work, whole, finding.named)[material.channels.index(channel)]
        if remains.get(channel, 0.0) > (1.0 - NAMED_SHARE) / NAMED_SHARE * total:
            taken.append(finding)
    if taken:
        whole = _without(work, whole, [f.named for f in taken])
    return whole, [f for f in findings if f not in taken], taken


def _gains(work: Residuals, whole: Fitted, named: Named) -> FloatArray:
    """What a finding explains beyond a refit of the base, by channel of the training rows."""
    training = work.training
    terms = [t for t in whole.model.terms if _is_of(named, t.effect.name, t.target)]
    base = whole.columns[:, : len(training.predictor.names)]
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


def _channels(work: Residuals, whole: Fitted, check: Check) -> tuple[ChannelResult, ...]:
    floors = work.noise_floors()
    before, after = check.residual(work.base.model), check.residual(whole.model)
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


def _verdict(
    findings: Sequence[Finding],
    rejected: Sequence[Finding],
    unknown: Sequence[Unexplained],
    few: bool,
) -> str:
    if findings:
        return PARTLY if unknown or few else EXPLAINED
    if unknown:
        return UNKNOWN
    return NO_IMPROVEMENT if rejected else MATCHES
