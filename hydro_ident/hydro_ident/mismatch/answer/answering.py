"""What a recording says was left out: searched, confirmed, and what has no name beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.answer.channel_results import channels_of, rows_of_training
from hydro_ident.mismatch.answer.confirmation import searched
from hydro_ident.mismatch.answer.lacking import (
    lacking,
    lacking_elsewhere,
    readings_apart,
    with_more,
)
from hydro_ident.mismatch.answer.late_positions import without_late
from hydro_ident.mismatch.answer.loads_apart import with_loads
from hydro_ident.mismatch.answer.moved_base import moved_base
from hydro_ident.mismatch.answer.odd_valve import explains, held_to_others, odd_valve, slower_spool
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.answer.reversed_valves import reversed_valves, untold
from hydro_ident.mismatch.answer.withdrawal import withdrawn
from hydro_ident.mismatch.fitting.as_listed import LISTED_GAIN, relisted
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import NEAR, ONE_STEP, fit
from hydro_ident.mismatch.locating.dependence import Dependence
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.locating.precision import accuracy_of
from hydro_ident.mismatch.naming.name import Search
from hydro_ident.mismatch.split.listed_friction import bends_of_listed, with_bristles
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.exclusion import SPOOL
from hydro_ident.mismatch.unnamed.describe import form_of
from hydro_ident.mismatch.unnamed.nearest import with_nearest
from hydro_ident.mismatch.unnamed.unknown import Unexplained, unexplained
from hydro_ident.mismatch.unnamed.wavering import wavering
from hydro_ident.mismatch.verifying.confirm import Confirmer
from hydro_model.command_line.terminal import advance

#: Of a diagnosis, as `advance` counts them.
STAGES = 7


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """Findings, what failed, and what is left.

    Attributes
    ----------
    work : Residuals
        The rows and the base that it was found with.
    search : Search
    whole : Fitted
        With every finding.
    findings : tuple of Finding
    rejected, taken : tuple of Finding
        Not confirmed by held-out rows; taken back for what is left in their channels.
    unknown : tuple of Unexplained
    left : tuple of Dependence
        Of what the final model leaves, strongest first.
    """

    work: Residuals
    search: Search
    whole: Fitted
    findings: tuple[Finding, ...]
    rejected: tuple[Finding, ...]
    taken: tuple[Finding, ...]
    unknown: tuple[Unexplained, ...]
    left: tuple[Dependence, ...]

    @property
    def names(self) -> set[tuple[str, int | None]]:
        """Names and cylinders of the findings."""
        terms = [f.named.term for f in self.findings]
        return {(term.effect.name, term.cylinder) for term in terms}


def answered(work: Residuals, base: Fitted) -> Answer:
    """Search, confirm and describe, again from a base that what was found shows to be another's.

    That is where listed friction bends, and where one valve is later than the others unexplained.

    Parameters
    ----------
    work : Residuals
    base : Fitted
        On the rows to search.

    Returns
    -------
    Answer
    """
    work, answer = _answered_bent(work, _answered(work, base, 3))
    odd = None if answer.unknown else odd_valve(work.training, answer.whole)
    if odd is not None:
        answer = _answered_held(work, answer, odd)
    return replace(answer, unknown=_completed(answer))


def _answered_bent(work: Residuals, first: Answer) -> tuple[Residuals, Answer]:
    """The answer with listed friction as the bristles found beside it, and what it began with.

    The first is kept where that finds less else, or no fewer names.
    """
    bends = bends_of_listed(work.training, (f.named.term for f in first.findings))
    if not bends:
        return work, first
    fresh = replace(work, base=with_bristles(work.training, work.base, bends))
    again = _answered(fresh, base_to_search(fresh), 3)
    others = first.names - {(bend.effect.name, bend.cylinder) for bend in bends}
    whole = others <= again.names and len(again.unknown) <= len(first.unknown)
    better = whole and len(again.names) < len(first.names)
    return (fresh, again) if better else (work, first)


def _answered_held(work: Residuals, first: Answer, odd: int) -> Answer:
    """The answer with one valve held to the others, or the first where that is the better one."""
    held = held_to_others(work, first.whole, odd)
    again = _answered(held, base_to_search(held), 3)
    kept = first.names <= again.names and not again.unknown
    slower = slower_spool(again.work, first.whole, again.whole, odd)
    if not kept or not explains(again.names, odd) or slower > LISTED_GAIN:
        return first
    odds = {SPOOL: float(np.exp(min(0.5 * slower, 0.0)))}
    found = tuple(
        replace(f, named=f.named.beside(odds)) if _makes_late(f, odd) else f
        for f in again.findings
    )
    return replace(again, findings=found)


def _makes_late(one: Finding, index: int) -> bool:
    return explains({(one.named.term.effect.name, one.named.term.cylinder)}, index)


def base_to_search(work: Residuals) -> Fitted:
    """The base on the rows that are searched.

    Parameters
    ----------
    work : Residuals
    """
    return (
        work.base if work.scan is work.training else fit(work.scan, work.base.model, passes=NEAR)
    )


def _answered(work: Residuals, base: Fitted, stage: int) -> Answer:
    advance("searching for effects and testing them", stage, STAGES)
    search, whole, findings, rejected = searched(work, base)
    advance("verifying on what was held out", stage + 1, STAGES)
    whole, findings, taken, left = withdrawn(work, whole, findings)
    whole, findings, late = without_late(work, whole, findings)
    if late:
        rejected, left = [*rejected, *late], dependences(work.training, whole)
    work, whole = _relisted(work, whole)
    advance("describing what has no name", stage + 2, STAGES)
    unknown = _described(work, whole, left, findings, rejected)
    unknown = _with_nearest(work, whole, search, unknown)
    found = tuple(findings), tuple(rejected), tuple(taken)
    return Answer(work, search, whole, *found, unknown, tuple(left))


def _relisted(work: Residuals, whole: Fitted) -> tuple[Residuals, Fitted]:
    """As `relisted`, of all that is searched as well."""
    training, whole = relisted(work.training, whole)
    same = work.scan is work.training
    scan = training if same else replace(work.scan, as_listed=training.as_listed)
    return replace(work, training=training, scan=scan), whole


def _described(
    work: Residuals,
    whole: Fitted,
    left: Sequence[Dependence],
    findings: Sequence[Finding],
    rejected: Sequence[Finding],
) -> tuple[Unexplained, ...]:
    """Dependence without a name, with its short form where the data allow one."""
    confirmer = Confirmer(work.training, work.check, whole)
    material = work.training.predictor.material
    least = {name: accuracy_of(material, k) for k, name in enumerate(material.channels)}
    here, there = (channels_of(work, whole, c) for c in (rows_of_training(work), work.check))
    far = lacking(here, there, least)
    named = {name for f in findings for name in f.channels}
    going = {
        f.channels[0]: f.named.term.effect.name
        for f in rejected
        if f.verification.comes_and_goes and f.channels[0] not in named
    }
    wavers = wavering(work.training, whole, confirmer)
    found = unexplained(work.training, whole, left, confirmer.holds, far, going, wavers)
    # What a channel keeps beside a dependence has that one's form no more.
    firsts = {one.channel: one for one in reversed(found)}
    return tuple(
        replace(one, form=form_of(work.training, whole, confirmer, one.dependence))
        if one is firsts[one.channel]
        else one
        for one in found
    )


def _with_nearest(
    work: Residuals, whole: Fitted, search: Search, unknown: tuple[Unexplained, ...]
) -> tuple[Unexplained, ...]:
    """As `with_nearest`, on the rows that were searched."""
    if not unknown:
        return unknown
    same = work.scan is work.training
    here = whole if same else fit(work.scan, whole.model, passes=ONE_STEP)
    return with_nearest(work.scan, here, search.scanned, unknown)


def _completed(answer: Answer) -> tuple[Unexplained, ...]:
    """What has no name, with channels that other recordings contradict and readings apart."""
    work, whole, left = answer.work, answer.whole, answer.left
    material = work.training.predictor.material
    least = {name: accuracy_of(material, k) for k, name in enumerate(material.channels)}
    there = replace(work.check, mask=work.check.rows_in_motion)
    here, moving = (channels_of(work, whole, c) for c in (rows_of_training(work), there))
    floors = work.noise_floors(work.check_traces)
    contradicted = lacking_elsewhere(here, moving, least, floors)
    found = with_more(answer.unknown, contradicted, left, confirmed=True)
    found = with_loads(found, work.training, whole, work.check)
    found = with_more(found, moved_base(work.training, whole, grossly=True), left)
    found = with_more(found, readings_apart(work.training, whole), left)
    wrong = reversed_valves(work.training, work.base)
    return untold(found, wrong, work.robot, left) if wrong else found
