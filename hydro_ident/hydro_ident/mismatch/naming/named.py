"""Sets of effects that recordings cannot tell apart, with probabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.settings import FORM_TOLERANCE, SET_PROBABILITY
from hydro_ident.mismatch.trials.contender import Contender, at_a_bound, shape_at_a_bound
from hydro_ident.mismatch.trials.exclusion import SPOOL
from hydro_model.effects.targets import ActiveEffect

#: Share of a set's gain from which another effect may stand in the place of a refused one.
_ALTERNATIVE = 0.9
#: Probability of the best name from which a finding in a few motions is one.
_LEAST_SURE = 0.25
#: Share of a law's tolerance that is a delay's: it is time and nothing else, and what it shifts
#: has a form of its own.
_OF_TIME = 0.1
#: Evidence (nats) by which a law whose size may be anything goes before all whose size is told:
#: its numbers make up for one another, but no other law does what they do.
_FAR_BETTER = 20.0
#: Log-likelihood (twice) that a difference of the form's tolerance is worth.
_FORM_NATS = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """One cause: effects that the recordings cannot tell apart.

    Attributes
    ----------
    contenders : tuple of Contender
        Best first: the members of the set.
    probability : tuple of float
    p_value : float
        Family-wise, over everything that was tried.
    gain : float
        Of the best.
    tried : tuple of Contender
        All that were weighed, best first.
    spread : float
        Overdispersion of sums over blocks.
    refused : int
        Effects of the set that held-out rows have refused before.
    few, allowance : float
        As `named_of`.
    alike : tuple of str
        Names of effects that, one at every cylinder, fit as well as one of the whole robot, and of
        a law near another one's limit; their probabilities follow those of the contenders' names.
    """

    contenders: tuple[Contender, ...]
    probability: tuple[float, ...]
    p_value: float
    gain: float
    tried: tuple[Contender, ...]
    spread: float
    refused: int = 0
    few: float = 1.0
    allowance: float = 0.0
    alike: tuple[str, ...] = ()

    def beside(self, odds: Mapping[str, float]) -> Named:
        """The set with effects that are not told from it, one at every cylinder.

        Parameters
        ----------
        odds : mapping of str to float
            How likely each is, over the set itself.
        """
        least = (1.0 - SET_PROBABILITY) / SET_PROBABILITY
        kept = {n: o for n, o in odds.items() if o >= least and n not in self.names}
        if not kept:
            return self
        total = 1.0 + sum(kept.values())
        shares = (*self.probability, *kept.values())
        alike = (*self.alike, *kept)
        return replace(self, probability=tuple(s / total for s in shares), alike=alike)

    @property
    def foremost(self) -> Contender:
        """The member of the set that speaks for it.

        The best name's, unless another predicts better by more than laws' forms are good for.
        """
        possible = self._possible
        first, best = possible[0], max(possible, key=lambda c: c.held_out)
        margin = FORM_TOLERANCE**2 * max(first.gain, best.gain)
        return best if best.held_out - first.held_out > margin else first

    @property
    def modelled(self) -> Contender:
        """The member of the set that stands in the model.

        Of the laws that bear the foremost one's name whichever predicts better: no name depends on
        it, but forces do, in motions that show more of their difference than the fitted ones.
        """
        one = self.foremost
        mates = [c for c in self._possible if c.name == one.name and _near(c, one)]
        return max(mates, key=lambda c: 0.5 * c.held_out / self.spread - c.cost)

    @property
    def _possible(self) -> Sequence[Contender]:
        return [c for c in self.contenders if not at_a_bound(c.term)] or self.contenders

    @property
    def term(self) -> ActiveEffect:
        """The effect that stands in the model."""
        return self.modelled.term

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the set, best first, each once."""
        return (*dict.fromkeys(c.name for c in self.contenders), *self.alike)

    @property
    def pays(self) -> bool:
        """Whether what it gains on held-out blocks is worth its parameters."""
        return self.margin > 0.0

    @property
    def margin(self) -> float:
        """Log-likelihood that it gains on held-out blocks beyond what its parameters cost."""
        best = self.modelled
        return 0.5 * best.held_out / self.spread - best.cost

    def alternative(
        self, beside: Sequence[Contender] = (), *, unheard: bool = False
    ) -> Named | None:
        """The set without the effect that stands in the model; None where no other comes near.

        Parameters
        ----------
        beside : sequence of Contender
            What stands in the model already: nothing is named twice, nor what excludes it.
        unheard : bool
            Held-out rows did not refuse it, but had nothing to say.
        """
        rest = [
            c
            for c in self.tried
            if c.term.effect.name != self.term.effect.name
            and c.gain >= _ALTERNATIVE * self.gain
            and not at_a_bound(c.term)
            and not any(c.rivals(one) for one in beside)
        ]
        if not rest:
            return None
        other = named_of(rest, self.p_value, self.spread, self.few, self.allowance)
        return replace(other, refused=self.refused + (not unheard))

    @property
    def first(self) -> Contender:
        """The best one whose law is the first name's own, or else the best of that name.

        A law that runs to the first name's limit speaks for it where it stands in the model and
        its own predicts worse by more than laws' forms are good for: what rounds a reversal shows
        in the size as well.
        """
        own = [c for c in self.tried if c.name == self.names[0]]
        plain = [c for c in own if c.term.effect.name == c.name]
        mine = self.modelled if self.modelled.name == self.names[0] else own[0]
        margin = FORM_TOLERANCE**2 * mine.gain
        return plain[0] if plain and mine.held_out - plain[0].held_out <= margin else mine


def untold_by_few(named: Named, term: ActiveEffect) -> str:
    """Why a finding in a few motions names nothing; empty where it does, or motions are many.

    In a few position, pressures, openings and time run together: where no name has one chance in
    four, that something is missing is all that they tell.

    Parameters
    ----------
    named : Named
    term : ActiveEffect
        Its effect as it was fitted last.
    """
    if named.few <= 1.0:
        return ""
    if named.probability[0] < _LEAST_SURE:
        count = len(named.names)
        return f"in so few motions {count} effects fit alike, and none is told from the others"
    return shape_at_a_bound(term)


def named_of(
    contenders: Sequence[Contender],
    p: float,
    spread: float,
    few: float = 1.0,
    allowance: float = 0.0,
) -> Named:
    """The set of contenders that are not out of reach of the best.

    Log-likelihood counts in units of the sums' overdispersion, and of the catalogue's form: laws
    that differ by less than `FORM_TOLERANCE` of the effect itself are told apart by their
    parameters' cost alone, since no machine follows either to the last newton. A delay has no form
    but time: what it leaves where another law leaves less speaks against it.

    Parameters
    ----------
    contenders : sequence of Contender
    p : float
    spread : float
        Overdispersion of sums over blocks.
    few : float
        Blocks per motion, where there are so few motions that each counts as one observation of
        the laws' forms.
    allowance : float
        Sum of squares of what the base has of the same effect (`lags.base_delay`).
    """
    whole = max(c.gain for c in contenders) + allowance
    form = FORM_TOLERANCE**2 * whole / _FORM_NATS
    own, spread = spread, max(spread, form, few)
    costs = {id(c): _cost_among(c, contenders) for c in contenders}

    timed = max(own, _OF_TIME**2 * form, few)
    most = max((c.held_out for c in contenders if not at_a_bound(c.term)), default=-np.inf)

    def own_evidence(one: Contender) -> float:
        missed = max(most - one.held_out, 0.0) if one.term.effect.name == DELAY else 0.0
        misfit = 0.5 * missed * (1.0 / min(timed, spread) - 1.0 / spread)
        return 0.5 * one.held_out / spread - misfit - costs[id(one)]

    told = {id(c): own_evidence(c) for c in contenders}
    behind, limit = _behind(contenders, told)

    def evidence_of(one: Contender) -> float:
        return min(told[id(one)], limit) if behind[id(one)] else told[id(one)]

    ranked = sorted(contenders, key=lambda c: (-evidence_of(c), behind[id(c)]))
    evidence = np.array([evidence_of(c) for c in ranked])
    weights = np.exp(evidence - evidence[0])
    weights /= weights.sum()
    count = int(np.searchsorted(np.cumsum(weights), SET_PROBABILITY)) + 1
    kept = tuple(ranked[:count])
    kept += tuple(c for c in ranked[count:] if c.name == kept[0].name and _near(c, kept[0]))
    total = {
        n: float(sum(w for c, w in zip(ranked, weights, strict=True) if c.name == n))
        for n in dict.fromkeys(c.name for c in kept)
    }
    # The likeliest name first, which more than one law may bear.
    kept = tuple(sorted(kept, key=lambda c: -total[c.name]))
    names = dict.fromkeys(c.name for c in kept)
    gain = ranked[0].gain
    shares = tuple(total[n] for n in names)
    one = Named(kept, shares, p, gain, tuple(ranked), own, few=few, allowance=allowance)
    # Near a limit either name may be meant.
    return one.beside(dict.fromkeys(one.foremost.border_names, shares[0]))


def _behind(
    contenders: Sequence[Contender], evidence: Mapping[int, float]
) -> tuple[dict[int, bool], float]:
    """Which contenders are never before those that are told, and the best evidence of these.

    Neither at the end of its range nor where its size may be anything is a law told from others,
    unless, for its size, they are out of its reach. Without any that is told nothing limits them.
    """
    bound = {id(c): bool(at_a_bound(c.term)) for c in contenders}
    sure = [evidence[id(c)] for c in contenders if c.sized and not bound[id(c)]]
    limit = max(sure, default=np.inf)
    behind = {
        id(c): bound[id(c)] or not (c.sized or evidence[id(c)] > limit + _FAR_BETTER)
        for c in contenders
    }
    return behind, limit


def _cost_among(one: Contender, contenders: Sequence[Contender]) -> float:
    """What a contender's numbers cost beside the others.

    A delay of one valve is the lag of its spool in one shape of many: having chosen it is no
    cheaper than the lag's damping.
    """
    if not (one.term.effect.name == DELAY and one.term.cylinder is not None):
        return one.cost
    lags = [c.cost for c in contenders if c.term.effect.name == SPOOL and _near(c, one)]
    return max([one.cost, *lags])


def _near(one: Contender, other: Contender) -> bool:
    """Whether two contenders act on the same target."""
    return one.term.target == other.term.target
