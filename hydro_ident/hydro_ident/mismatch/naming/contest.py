"""Trials refined and weighed against each other on held-out blocks: the sets of names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.scoring.scores import GUARD_PERIODS
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import fit, fit_term, reach_of
from hydro_ident.mismatch.fitting.side_by_side import side_by_side
from hydro_ident.mismatch.fitting.stepping import WAYS, is_free
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.weighed import Weighed
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.locating.encoders import Encoders
from hydro_ident.mismatch.naming.contenders import (
    behind,
    best_of_each,
    firsts,
    leading,
    of_all_valves,
)
from hydro_ident.mismatch.naming.few_motions import FewMotions
from hydro_ident.mismatch.naming.fit_starts import Starts
from hydro_ident.mismatch.naming.lags import OF_VALVES, base_delay, resolved
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.naming.valley import begun_anew
from hydro_ident.mismatch.naming.worth import bears, in_reach
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.rows.prediction import Model
from hydro_ident.mismatch.settings import FOLD_BLOCK_S, FOLDS
from hydro_ident.mismatch.trials.chance import overdispersed, overdispersion, told_best
from hydro_ident.mismatch.trials.contender import Contender, at_a_bound, sizes_told
from hydro_ident.mismatch.trials.scoring import Score
from hydro_model.effects.targets import ActiveEffect

#: Trials beyond the best whose fit is refined, and the least share of its gain to be one.
CONTENDERS, CONTENDER_SHARE = 8, 0.4
#: Passes of a first and of a thorough fit.
_ROUGH, PASSES = 6, 4


@dataclass(frozen=True, slots=True, eq=False)
class Each:
    """What a finding became: itself, or one at every place, and the model with it."""

    named: list[Named]
    model: Model


class Contest:
    """Fits trials in each other's place and makes sets of what cannot be told apart.

    Parameters
    ----------
    training : Training
    few : FewMotions, optional
        Every motion is one of many by default.
    processes : int
        How many fits may go on side by side.
    """

    def __init__(
        self, training: Training, few: FewMotions | None = None, processes: int = 1
    ) -> None:
        self.training, self.encoders = training, Encoders(training)
        self.starts = Starts(training)
        self.few = few or FewMotions(training.predictor.material, 0.0)
        self._processes = processes

    def between(
        self, current: Fitted, noise: Noise, scores: Sequence[Score], best: Score, p: float
    ) -> tuple[Named, bool]:
        """Refine the best trials and weigh them against each other on held-out blocks.

        Returns
        -------
        named : Named
        told : bool
            Whether what fits best is more than sampling can tell.
        """
        # What acts on other rows altogether is another cause, not another name for this one.
        chosen = [
            s
            for s in firsts(scores)
            if CONTENDER_SHARE * best.value <= s.value <= best.value
            and (s.entry.rows & best.entry.rows).any()
        ][:CONTENDERS]
        without = fitted(self.training, current.model, noise)
        begun = side_by_side(
            lambda one: self.starts.of(without, one, scores), chosen, self._processes
        )
        terms = [start for starts in begun for start in starts]
        contenders = best_of_each(self.fitted(without, terms, noise))
        told = [
            c
            for c in contenders
            if resolved(self.training, without, c)
            and in_reach(self.training, without, c)
            and bears(self.training, c)
            and self.encoders.tell(without, c)
        ]
        members = self.members(told or contenders)
        leader = leading(contenders, told)
        # Of what the best law leaves: a trial's own misfit is no noise.
        spread = min(overdispersion(best), self.spread(without, best, leader.fitted))
        allowance = base_delay(self.training, without, leader.term)
        few = self.few.of([leader.term])
        return named_of(members, p, spread, few, allowance), leader in told

    def spread(self, without: Fitted, best: Score, whole: Weighed) -> float:
        """As `overdispersion`, of the residual that a fit leaves.

        Parameters
        ----------
        without : Fitted
        best : Score
            Of the effect that was added to it.
        whole : Weighed
            With it.
        """
        bench, mask = without.bench, self.training.mask
        left = bench.beyond(best.entry.columns(mask.size)[mask][:, [told_best(best)]])
        return overdispersed(bench, left, whole.left)

    def spread_left(self, without: Fitted, one: Contender) -> float:
        """As `spread`, of a contender's own contribution.

        Parameters
        ----------
        without : Fitted
        one : Contender
            Fitted on top of it.
        """
        bench, mask = without.bench, self.training.mask
        column = self.training.predictor.contribution(one.fitted.model, one.term)[mask]
        return overdispersed(bench, bench.beyond(column[:, None]), one.fitted.left)

    def weighed(
        self, without: Fitted, terms: Sequence[ActiveEffect], noise: Noise, spread: float
    ) -> Named:
        """The set of some effects, each fitted in the others' place on top of a model.

        Parameters
        ----------
        without : Fitted
            The model with none of them, weighed by `noise`.
        terms : sequence of ActiveEffect
            Where their fits start.
        noise : Noise
        spread : float
            As `overdispersion`.
        """
        few = self.few.of(terms)
        return named_of(self.fitted(without, terms, noise), 0.0, spread, few)

    def at_each(
        self, current: Fitted, noise: Noise | None, found: Named, scores: Sequence[Score]
    ) -> Each:
        """A finding of the whole robot, or effects at every cylinder that fit better in its place.

        One delay of all commands explains more than the lag of any one spool does, also where all
        spools lag: each is then a cause, and together they may leave less. What is the robot's
        own is time or a pressure's, whose laws have one form: no tolerance is left for it.

        Parameters
        ----------
        current : Fitted
            The model without the finding.
        noise : Noise or None
        found : Named
        scores : sequence of Score
            Of the step that found it: where the fits of what was not tried start.
        """
        whole = Each([found], found.modelled.fitted.model)
        of_one = found.term.cylinder is not None or found.term.joint is not None
        if of_one or noise is None:
            return whole
        without = fitted(self.training, current.model, noise)
        before, unit = self.held_out(without), 0.5 / found.spread
        own_gain = unit * found.modelled.held_out
        most, alike = own_gain - found.modelled.cost, dict[str, float]()
        names = dict.fromkeys(c.term.effect.name for c in found.tried)
        if found.term.effect.name == DELAY:
            # Beside a base whose delays have moved any law fits as well: its gain is not its own.
            names = dict.fromkeys(name for name in names if name in OF_VALVES)
        for name in names:
            own = self._at_all(without, noise, found, scores, name)
            if len(own) < 2:
                continue
            together = self._together(current.model, noise, own)
            if together is None:
                continue
            gain = unit * (before - self.held_out(together))
            if found.term.effect.name == DELAY:
                # All spools alike are one number as well: what fits alike is not told apart.
                alike[name] = float(np.exp(min(gain - own_gain, 0.0)))
            if gain - sum(c.cost for c in own) > most:
                most = gain - sum(c.cost for c in own)
                whole = Each([self._one_of(found, c) for c in own], together.model)
        return whole if whole.named[0] is not found else Each([found.beside(alike)], whole.model)

    def _at_all(
        self,
        without: Fitted,
        noise: Noise,
        found: Named,
        scores: Sequence[Score],
        name: str,
    ) -> list[Contender]:
        """An effect fitted at every target that it may have; none where it is the robot's."""
        own = [c for c in found.tried if c.term.effect.name == name]
        if any(c.term.cylinder is None for c in own):
            return []
        at = {c.term.target for c in own}
        rest = [s for s in firsts(scores) if s.entry.trial.name == name]
        rest = [s for s in rest if s.entry.trial.target not in at]
        return own + self.fitted(without, [self.starts.start(without, s) for s in rest], noise)

    def _together(self, model: Model, noise: Noise, own: Sequence[Contender]) -> Fitted | None:
        """A model with an effect at every target; None where that says no more than a delay."""
        for one in own:
            model = model.with_term(one.term)
        # One alone makes the other valves late by what the base has, and comes out as it may.
        whole = begun_anew(self.training, fit(self.training, model, noise, PASSES))
        terms = whole.model.terms[-len(own) :]
        deviations = whole.weighed.deviations
        if any(at_a_bound(t) for t in whole.model.terms):
            return None
        # Numbers that only together come to a delay are none of a hose.
        return whole if all(all(sizes_told(t, deviations)) for t in terms) else None

    def _one_of(self, found: Named, one: Contender) -> Named:
        """A contender as a finding, beside those that were tried at its target."""
        rest = [c for c in found.tried if c is not one and c.term.target == one.term.target]
        return replace(
            found, contenders=(one,), probability=(1.0,), gain=one.gain, tried=(one, *rest)
        )

    def members(self, contenders: list[Contender]) -> list[Contender]:
        """Contenders that a set may hold: possible ones, if there are any.

        In a few motions a law that has run to the end of its range is not told apart from those
        that it is known to look like; it stays beside them.
        """
        possible = [c for c in contenders if not at_a_bound(c.term)]
        alike = {name for c in possible for name in c.term.effect.looks_like}
        kept = [
            c
            for c in contenders
            if c in possible or (self.few.of([c.term]) > 1.0 and c.term.effect.name in alike)
        ]
        return kept if possible else contenders

    def fitted(
        self, without: Fitted, terms: Sequence[ActiveEffect], noise: Noise
    ) -> list[Contender]:
        """Contenders fitted: all roughly, those not far behind the best to the end."""
        if not terms:
            return []
        before = self.held_out(without)

        def roughly(term: ActiveEffect) -> Contender:
            whole = fit_term(self.training, without, term, noise, _ROUGH)
            return self._contender(without, before, whole)

        def thoroughly(one: Contender) -> Contender:
            whole = fit(self.training, one.fitted.model, noise, PASSES)
            return self._contender(without, before, whole)

        result = side_by_side(roughly, terms, self._processes)
        gains = {k: one.gain for k, one in enumerate(result)}
        late = behind(gains, {k for k in gains if of_all_valves(terms[k])})
        close = [k for k in gains if k not in late]
        whole = side_by_side(thoroughly, [result[k] for k in close], self._processes)
        for k, one in zip(close, whole, strict=True):
            result[k] = one
        return result

    def _contender(self, without: Fitted, before: float, whole: Fitted) -> Contender:
        term = whole.model.terms[-1]
        held = before - self.held_out(whole)
        gain = without.squares - whole.squares
        return Contender(term, whole.weighed, gain, held, self._cost(without, whole))

    def _cost(self, without: Fitted, whole: Fitted) -> float:
        """What the numbers of the last term cost, in units of log-likelihood.

        Half the logarithm of the number of rows for the first, and for each further one at most
        that: the logarithm of how much narrower than its own reach the rows make it (Occam's
        factor, MacKay 2003, ch. 28). What the rows, or a refit, leave of a law beside one
        number is then no dearer than a law that has that number alone.
        """
        term, mask = whole.model.terms[-1], self.training.mask
        specs = term.effect.parameters
        free = [i for i in range(term.parameters.size) if is_free(term, i)]
        # What one dry friction turns around over is the next one's as well, and no freedom of it.
        beside = [t for t in without.model.terms if t.target == term.target]
        rubs = any(p.name in WAYS for t in beside for p in t.effect.parameters)
        own = [k for k, i in enumerate(free) if not (rubs and specs[i].name in WAYS)]
        reach = np.maximum(np.abs(term.parameters), [abs(spec.typical) for spec in specs])[free]
        columns = (whole.columns[mask, len(whole.names) - len(free) :] * reach)[:, own]
        told = np.linalg.svd(without.bench.beyond(columns), compute_uv=False)
        whole_cost = 0.5 * float(np.log(max(without.bench.measured, 3)))
        further = np.log(np.maximum(told[1:], 1.0))
        return whole_cost + float(np.sum(np.minimum(further, whole_cost)))

    def held_out(self, one: Fitted) -> float:
        """Sum of squares on held-out blocks, in units of the noise's variance.

        Parameters
        ----------
        one : Fitted
        """
        # Around held-out blocks, as far as the filters reach.
        guard_s = GUARD_PERIODS / self.training.predictor.material.filters.parallel_hz
        left = one.bench.held_out(FOLD_BLOCK_S, FOLDS, guard_s, reach_of(one))
        return float(np.sum(left))
