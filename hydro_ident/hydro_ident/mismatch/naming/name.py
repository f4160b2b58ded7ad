"""Which effects of the catalogue a recording shows: forward, one at a time, then back again."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import NEAR, ONE_STEP, fit
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.naming.contenders import firsts
from hydro_ident.mismatch.naming.contest import PASSES, Contest
from hydro_ident.mismatch.naming.few_motions import FewMotions
from hydro_ident.mismatch.naming.given_up import GivenUp
from hydro_ident.mismatch.naming.named import Named
from hydro_ident.mismatch.naming.one_delay import as_one_delay
from hydro_ident.mismatch.naming.pairs import best_pair
from hydro_ident.mismatch.naming.revision import Revision
from hydro_ident.mismatch.naming.worth import worth, worthy
from hydro_ident.mismatch.rows.modelled import Model, same
from hydro_ident.mismatch.settings import (
    FAMILY_ERROR,
    FAMILY_ERROR_UNNAMED,
    LEAST_EFFECTIVE,
    MOST_EFFECTS,
)
from hydro_ident.mismatch.trials.candidates import Trial
from hydro_ident.mismatch.trials.chance import (
    chances,
    effective_blocks,
    foremost,
    lost_by_fits,
    signs,
    used_columns,
)
from hydro_ident.mismatch.trials.contender import at_a_bound
from hydro_ident.mismatch.trials.exclusion import exclude
from hydro_ident.mismatch.trials.scoring import Bank, Score, score
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Contests of a step whose winners do not pay on held-out blocks before nothing more is sought.
_CONTESTS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """Outcome of the search.

    Attributes
    ----------
    base : Fitted
        Without findings.
    fitted : Fitted
        With the best of every finding.
    named : tuple of Named
    scanned : tuple of Score
        The last scan, in which nothing more was found.
    impossible : tuple of (str, str, str)
        Effects and targets that fitted best at the end of what is possible, and why they were not
        taken.
    small : Score or None
        The best of the last scan that stands out, but explains so little beside what was found
        that the laws' own form may be what it is.
    """

    base: Fitted
    fitted: Fitted
    named: tuple[Named, ...]
    scanned: tuple[Score, ...]
    impossible: tuple[tuple[str, str, str], ...] = ()
    small: Score | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """What one step forward came to: a finding, all scores, and those that do not stand out.

    `small` stands out, but is no more than the form of what was found may be off by.
    """

    found: Named | None
    scores: tuple[Score, ...]
    quiet: tuple[Score, ...]
    noise: Noise | None = None
    small: Score | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Scan:
    """All scores, best first, and of every effect and target the best with its chance."""

    bench: Bench
    scores: tuple[Score, ...]
    leading: tuple[Score, ...]
    chances: tuple[float, ...]


class Searcher:
    """Adds effects to a model until nothing significant is left.

    Parameters
    ----------
    training : Training
    base : Fitted
    excluded : collection of (str, str)
        Effects and targets that are not tried.
    bank : Bank, optional
        Of an earlier search on the same rows.
    floors : mapping of str to float, optional
        What the sensors' noise leaves of channels: in those that laws hardly bring nearer to it no
        more are looked for.
    processes : int
        How many fits may go on side by side.
    """

    def __init__(
        self,
        training: Training,
        base: Fitted,
        excluded: Collection[tuple[str, str]] = (),
        bank: Bank | None = None,
        floors: Mapping[str, float] = MappingProxyType({}),
        processes: int = 1,
    ) -> None:
        self.training, self.base, self.excluded = training, base, set(excluded)
        self.bank = bank or Bank(training.predictor)
        few = FewMotions(training.predictor.material, base.bench.blocks)
        self.contest = Contest(training, few, processes)
        # Tried in earlier steps, and not worth what they cost.
        self._refuted = set[tuple[str, str]]()
        self._lost = GivenUp(training, base, floors)

    def run(self) -> Search:
        """Forward, then every finding again with the others in place."""
        current, named, impossible = self.base, list[Named](), list[tuple[str, str, str]]()
        while len(named) < MOST_EFFECTS:
            known = bool(self._refuted)
            step = self._next(current, named)
            if step.found is None and known:
                # With the others in place they may be.
                self._refuted.clear()
                step = self._next(current, named)
            found = step.found
            if found is None:
                both, current = self._pair(current, step.quiet)
                named += both
                if not both:
                    break
                continue
            if why := at_a_bound(found.term):
                # What would have to be impossible is not the cause: another may be.
                self.excluded.add((found.term.effect.name, found.term.target))
                impossible.append((found.term.effect.name, found.term.target, why))
                continue
            each = self.contest.at_each(current, step.noise, found, step.scores)
            fresh = fit(self.training, each.model, passes=NEAR)
            terms = [one.term for one in each.named]
            if self._lost.of(current, fresh, terms):
                # Once more it would come out the same, whatever channels its trial acts in.
                self.excluded |= {(term.effect.name, term.target) for term in terms}
                continue
            named, current = [*named, *each.named], fresh
        named, current = Revision(self.contest).revised(named, current)
        named, current = as_one_delay(self.contest, named, current, self.excluded)
        return Search(self.base, current, tuple(named), step.scores, tuple(impossible), step.small)

    # One step forward ----------------------------------------------------------------------

    def _next(self, current: Fitted, named: Sequence[Named]) -> _Step:
        """The next finding, if any stands out."""
        scan = self._scan(current, named)
        if scan is None:
            return _Step(None, (), ())
        scores, leading = scan.scores, list(zip(scan.leading, scan.chances, strict=True))
        quiet = tuple(s for s, p in leading if p > FAMILY_ERROR)
        weighed, contests, small = list[ActiveEffect](), 0, None
        for candidate, p in leading:
            if contests == _CONTESTS:
                break
            active = candidate.entry.trial.active
            if p > FAMILY_ERROR or any(same(active, one) for one in weighed):
                continue
            if (active.effect.name, active.target) in self._refuted:
                continue
            if self._lost.covers(candidate.entry.rows):
                continue
            if effective_blocks(scan.bench, candidate, self.training.mask) < LEAST_EFFECTIVE:
                continue
            if not worth(self.training, self.base, current, scan.bench, candidate):
                small = small or candidate
            else:
                fresh = [
                    s for s in scores if not any(same(s.entry.trial.active, o) for o in weighed)
                ]
                found, told = self.contest.between(current, scan.bench.noise, fresh, candidate, p)
                if found.pays and told:
                    return _Step(found, scores, quiet, scan.bench.noise)
                weighed += [c.term for c in found.tried]
                self._refuted |= {(c.term.effect.name, c.term.target) for c in found.tried}
                contests += 1
        return _Step(None, scores, quiet, small=small)

    def _scan(self, current: Fitted, named: Sequence[Named]) -> _Scan | None:
        """Every trial scored, weighed by the noise that the best of them would leave."""
        bank = self.bank.entries(current.model, self.excluded)
        there = _places(named)
        entries = [e for e in bank if not _sibling(e.trial, there)]
        mask = self.training.mask
        scores = [s for e in entries if (s := score(current.bench, e, mask)) is not None]
        if not scores:
            return None
        taken = foremost(scores)
        noise = self._noise_without(current, taken)
        bench = self.training.bench(noise, current.residual, current.columns, current.offset)
        left = bench.witness(self._left_over(current, noise, taken))
        scores = [s for e in entries if (s := score(bench, e, mask, left)) is not None]
        scores.sort(key=lambda s: -s.value)
        leading = firsts(scores)
        found = chances(scores, leading, signs(bench.blocks))
        if min(found) <= FAMILY_ERROR:
            raised = lost_by_fits(bench, scores, foremost(scores), mask)
            found = chances(scores, leading, signs(bench.blocks), raised)
        return _Scan(bench, tuple(scores), tuple(leading), found)

    def _pair(self, current: Fitted, quiet: Sequence[Score]) -> tuple[list[Named], Fitted]:
        """Two effects of which neither stands out alone, and the model with them; or none."""
        pair = best_pair(current.bench, quiet, self.training.mask)
        if pair is None or pair.p_value > FAMILY_ERROR_UNNAMED:
            return [], current
        model = current.model
        for term in pair.effects:
            model = model.with_term(term)
        noise, gain = current.bench.noise, pair.gain
        both = fit(self.training, model, noise, PASSES)
        if not all(self._worthy(current, noise, both.model, one, gain) for one in pair.effects):
            return [], current
        named: list[Named] = []
        for one in pair.effects:
            others = tuple(t for t in both.model.terms if not same(t, one))
            found, told = self._beside(replace(both.model, terms=others), noise, pair.p_value)
            if found is None or not (found.pays and told):
                return [], current
            beside = found.modelled.fitted.model
            # Another may have come in its place.
            if not self._worthy(current, noise, beside, found.term, gain):
                return [], current
            named.append(found)
            both = fit(self.training, beside, noise, ONE_STEP)
        return named, fit(self.training, both.model, passes=NEAR)

    def _worthy(
        self, current: Fitted, noise: Noise, both: Model, one: ActiveEffect, gain: float
    ) -> bool:
        """Whether one of a pair that was fitted together is more than a flaw of the form."""
        term = next(t for t in both.terms if same(t, one))
        whole = self.training.predictor.contribution(both, term)
        bench = self.training.bench(noise, current.residual, current.columns, current.offset)
        return worthy(self.training, self.base, current, bench, term, whole, gain)

    def _beside(self, model: Model, noise: Noise, p: float) -> tuple[Named | None, bool]:
        """What belongs to a model, with its effects held at their sizes, that lacks one."""
        mask = self.training.mask
        without = fitted(self.training, model, noise)
        entries = self.bank.entries(model, self.excluded)
        scores = [s for e in entries if (s := score(without.bench, e, mask)) is not None]
        if not scores:
            return None, False
        best = max(scores, key=lambda s: s.value)
        return self.contest.between(without, noise, scores, best, p)

    def _joined(self, current: Fitted, taken: Sequence[Score]) -> FloatArray:
        columns = used_columns(taken, current.residual.size)
        return np.concatenate([current.columns, columns], axis=1)

    def _noise_without(self, current: Fitted, taken: Sequence[Score]) -> Noise:
        """Noise of what is left once the best trials are taken out: what the truth would leave."""
        joined = self._joined(current, taken)
        noise = current.bench.noise
        bench = self.training.bench(noise, current.residual, joined, current.offset)
        return self.training.noise(current.residual - joined @ bench.solve())

    def _left_over(self, current: Fitted, noise: Noise, taken: Sequence[Score]) -> FloatArray:
        joined = self._joined(current, taken)
        return self.training.bench(noise, current.residual, joined, current.offset).residual


def _places(named: Sequence[Named]) -> list[tuple[str, set[str]]]:
    """Targets and names of what was found: to choose what stands in a model takes its time."""
    return [(n.term.target, {n.term.effect.name, n.modelled.name}) for n in named]


def _sibling(trial: Trial, there: Sequence[tuple[str, set[str]]]) -> bool:
    """Whether a trial cannot stand beside what was found already at its target (`_places`).

    What only was not told from that may be there as well: with it in place the set is made anew.
    """
    return any(
        target == trial.target and any(exclude(name, trial.name) for name in names)
        for target, names in there
    )
