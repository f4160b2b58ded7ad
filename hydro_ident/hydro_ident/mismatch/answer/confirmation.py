"""From what a search names to findings: held-out rows confirm them, or another is looked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_ident.mismatch.answer.cancelling import cancelled
from hydro_ident.mismatch.answer.contributing import acting_channels, without_these
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.answer.spoilt import made_worse
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import FROM_AFAR, NEAR, fit, settled
from hydro_ident.mismatch.fitting.side_by_side import side_by_side
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.naming.name import Search, Searcher
from hydro_ident.mismatch.naming.named import Named
from hydro_ident.mismatch.naming.revision import Revision
from hydro_ident.mismatch.naming.valley import from_one_delay
from hydro_ident.mismatch.rows.modelled import same
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.verifying.agreement import fitted_there
from hydro_ident.mismatch.verifying.verify import Verification, verify

#: Searches, each without what the ones before named and held-out rows did not confirm.
_ROUNDS = 4


def searched(work: Residuals, base: Fitted) -> tuple[Search, Fitted, list[Finding], list[Finding]]:
    """Search and confirm; where nothing stands, what failed may have stood in another's place.

    `base` is the fit that is searched from.
    """
    rejected: dict[tuple[str, str], Finding] = {}
    excluded = set[tuple[str, str]]()
    for _ in range(_ROUNDS):
        floors = work.noise_floors()
        searcher = Searcher(work.scan, base, excluded, work.bank, floors, work.processes)
        search = searcher.run()
        whole, findings, failed = _confirmed(work, search)
        if failed:
            findings = [_told_anew(searcher.contest, work, whole, f) for f in findings]
        excluded |= _not_again(search.named, failed, set(rejected))
        rejected |= {_key(f): f for f in failed}
        if findings or not failed:
            break
    stand = {_key(f) for f in findings}
    return search, whole, findings, [f for key, f in rejected.items() if key not in stand]


def _key(finding: Finding) -> tuple[str, str]:
    return finding.named.term.effect.name, finding.named.term.target


def _not_again(
    named: Sequence[Named], failed: Sequence[Finding], before: set[tuple[str, str]]
) -> set[tuple[str, str]]:
    """Effects and targets of refused findings that are not looked for again.

    What was named behind one that is refused, and does not stand out without it, had been fitted
    to what that one left: it may be found by itself, once more.
    """
    order = [(n.term.effect.name, n.term.target) for n in named]
    idle = {_key(f) for f in failed if f.verification.idle}
    blamed = [order.index(key) for key in map(_key, failed) if key in order and key not in idle]
    again = set(order[min(blamed, default=len(order)) + 1 :]) & idle
    return {_key(f) for f in failed} - (again - before)


def _told_anew(contest: Contest, work: Residuals, whole: Fitted, found: Finding) -> Finding:
    """A finding in few motions with its set as it is without what was refused.

    What it was weighed beside may have been what told its names apart. Where motions are many,
    each of them tells; in few, what is refused had run together with it.
    """
    if found.named.few <= 1.0:
        return found
    current = whole if work.scan is work.training else fit(work.scan, whole.model, passes=NEAR)
    _, fresh = Revision(contest).again(found.named, current)
    if fresh is None or not fresh.pays or not same(fresh.term, found.named.term):
        return found
    return replace(found, named=fresh)


def _confirmed(work: Residuals, search: Search) -> tuple[Fitted, list[Finding], list[Finding]]:
    """Findings that stand on held-out rows, the model with them, and those that do not."""
    whole, named = search.fitted, list(search.named)
    if work.scan is not work.training:
        model = replace(work.base.model, terms=search.fitted.model.terms)
        whole = fit(work.training, model, passes=FROM_AFAR)
    rejected, due = list[Finding](), named
    while named:
        whole = from_one_delay(work.training, settled(work.training, whole))
        there = fitted_there(work.training, work.check, whole)
        found, failed = _all_checked(work, whole, there, named, due, len(search.scanned))
        failed = failed or cancelled(work, whole, found) or made_worse(work, whole, found)
        if not failed:
            return whole, found, rejected
        # The worse half at a time: what fails beside a wrong effect may stand without it.
        failed.sort(key=lambda f: (-f.verification.p_value, f.named.gain))
        worst = failed[: (len(failed) + 1) // 2]
        rejected += worst
        named = [n for n in named if not any(n is f.named for f in worst)]
        others = _instead(worst, named)
        named += others
        due = [f.named for f in failed if f not in worst] + others
        terms = [other.term for other in others]
        whole = without_these(work, whole, [f.named for f in worst], terms)
    return whole, [], rejected


def _all_checked(
    work: Residuals,
    whole: Fitted,
    there: Fitted | None,
    named: Sequence[Named],
    due: Sequence[Named],
    tried: int,
) -> tuple[list[Finding], list[Finding]]:
    """All that was named, checked, and what does not stand of it.

    What failed before is checked first: where it fails again the others can wait.
    """
    found = _each_checked(work, whole, there, due, tried)
    failed = [f for f in found.values() if not f.verification.stands]
    if failed:
        return [], failed
    rest = [n for n in named if n not in found]
    found |= _each_checked(work, whole, there, rest, tried)
    return [found[n] for n in named], [f for f in found.values() if not f.verification.stands]


def _instead(refused: Sequence[Finding], kept: Sequence[Named]) -> list[Named]:
    """What may stand in the place of refused findings, beside what was kept and each other."""
    chosen: list[Named] = []
    for one in refused:
        beside = [n.modelled for n in (*kept, *chosen)]
        other = one.named.alternative(beside, unheard=one.verification.silent)
        if other is not None:
            chosen.append(other)
    return chosen


def _each_checked(
    work: Residuals, whole: Fitted, there: Fitted | None, named: Sequence[Named], tried: int
) -> dict[Named, Finding]:
    """Findings with what held-out rows say of each."""

    def said(one: Named) -> tuple[Verification, tuple[str, ...]]:
        found = _checked(work, whole, there, one, tried)
        return found.verification, found.channels

    told = side_by_side(said, named, work.processes)
    return {n: Finding(n, *one) for n, one in zip(named, told, strict=True)}


def _checked(
    work: Residuals, whole: Fitted, there: Fitted | None, named: Named, tried: int
) -> Finding:
    """A finding with what held-out rows say of it."""
    channels = acting_channels(work, whole, named)
    if channels:
        checked = verify(work.training, whole, named, work.check, there, tried, channels)
        return Finding(named, checked, channels)
    reason = "it does nothing once everything is fitted together"
    return Finding(named, Verification(1.0, {}, {}, 0.0, False, reason), ())
