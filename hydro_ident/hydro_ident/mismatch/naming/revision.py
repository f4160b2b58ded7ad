"""Findings weighed once more, each with the others in place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import NEAR, fit, fit_without
from hydro_ident.mismatch.naming.contenders import CLOSE_SHARE
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.rows.modelled import same
from hydro_ident.mismatch.trials.exclusion import rival
from hydro_model.effects.targets import ActiveEffect

_ROUNDS = 3
#: Share (of squares) of what a finding alone explains from which what was found since leaves it as
#: it was, and factor by which its own size may have changed: what others could do more of, or what
#: they have halved, is another finding's, and is weighed anew.
_KEPT, _SIZE = 0.5, 2.0


class Revision:
    """Drops what the others explain, and names every finding with the others in place.

    Parameters
    ----------
    contest : Contest
    """

    def __init__(self, contest: Contest) -> None:
        self._contest, self._training = contest, contest.training

    def revised(self, named: Sequence[Named], current: Fitted) -> tuple[list[Named], Fitted]:
        """Findings that stand beside each other, and the model with them.

        A finding is weighed again where its channels' model has changed since it was: the last of
        a channel had the others in place already.

        Parameters
        ----------
        named : sequence of Named
            In the order in which they were found.
        current : Fitted
            With all of them.
        """
        named = list(named)
        reach = {n: self._reach(current, n) for n in named}
        due = [n for k, n in enumerate(named) if any(reach[n] & reach[o] for o in named[k + 1 :])]
        for _ in range(_ROUNDS):
            changed = set[int]()
            for one in due:
                if self._stands(one, named, current):
                    continue
                without, fresh = self.again(one, current)
                if fresh is None or not fresh.pays:
                    changed |= reach[one]
                    named.remove(one)
                    current = without
                    continue
                named[named.index(one)] = fresh
                current = fit(self._training, fresh.modelled.fitted.model, passes=NEAR)
                reach[fresh] = self._reach(current, fresh)
                if not same(fresh.term, one.term):
                    changed |= reach[one] | reach[fresh]
            due = [n for n in named if changed & reach[n]]
            if not due:
                break
        return named, current

    def again(self, one: Named, current: Fitted) -> tuple[Fitted, Named | None]:
        """The model without a finding, and its set with the other findings in place.

        Two findings that have become the same effect are one: None.

        Parameters
        ----------
        one : Named
        current : Fitted
            With it.
        """
        others = tuple(t for t in current.model.terms if not same(t, one.term))
        noise, without = current.bench.noise, fit_without(self._training, current, others)
        terms = [t for t in _near(one) if not any(rival(t, other) for other in others)]
        if not terms:
            return without, None
        few = self._contest.few.of([one.term])
        again = self._contest.members(self._contest.fitted(without, terms, noise))
        # What was found beside all that has been named since had its sums spread by that.
        leading = max(again, key=lambda c: c.held_out)
        spread = min(one.spread, self._contest.spread_left(without, leading))
        fresh = named_of(again, one.p_value, spread, few, one.allowance)
        if one.alike and same(fresh.term, one.term):
            shares = one.probability[-len(one.alike) :]
            own = 1.0 - sum(shares)
            odds = {n: p / own for n, p in zip(one.alike, shares, strict=True)}
            # Names near another law's limit are the fresh set's matter.
            odds = {n: p for n, p in odds.items() if n not in one.foremost.border_names}
            fresh = fresh.beside(odds)
        return without, fresh

    def _stands(self, one: Named, named: Sequence[Named], current: Fitted) -> bool:
        """Whether what was found since has left a finding with one name as it was.

        It acts about as much as when it was found, and little of what it does beyond the base and
        what was found before could be done by the others as well.
        """
        if len(_near(one)) > 1 or one.alike:
            return False
        model, mask = current.model, self._training.mask
        own = [t for t in model.terms if same(t, one.term)]
        contribution = self._training.predictor.contribution
        then_and_now = [contribution(model, t)[mask] for t in (one.modelled.term, *own)]
        columns = np.stack([then_and_now[0], then_and_now[-1]], axis=1)
        later = [n.modelled.term for n in named[named.index(one) + 1 :]]
        alone, beside = (
            np.sum(self._bench_without(current, terms).beyond(columns) ** 2, axis=0)
            for terms in ([*own, *later], own)
        )
        kept = float(beside[1]) / max(float(alone[1]), 1e-300)
        alike = float(alone[0]) / _SIZE**2 <= float(alone[1]) <= float(alone[0]) * _SIZE**2
        best = one.modelled
        return alike and kept >= _KEPT and 0.5 * kept * best.held_out / one.spread > best.cost

    def _bench_without(self, current: Fitted, terms: Sequence[ActiveEffect]) -> Bench:
        """Rows of a fit whose columns are those of all but some of its effects."""
        prefix = tuple(f"{t.target}.{t.effect.name}." for t in terms)
        columns = current.columns.copy()
        columns[:, [k for k, n in enumerate(current.names) if n.startswith(prefix)]] = 0.0
        return self._training.bench(current.bench.noise, current.residual, columns, current.offset)

    def _reach(self, current: Fitted, one: Named) -> frozenset[int]:
        """Channels in which a finding does anything."""
        values = self._training.predictor.contribution(current.model, one.term)
        acting = self._training.mask & (values != 0.0)
        channels = self._training.predictor.material.channel[acting]
        return frozenset(np.unique(channels).tolist())


def _near(one: Named) -> list[ActiveEffect]:
    """What was tried and gained about as much as the best, and the finding's own effect.

    Its own, whatever another gained on the rows that it was fitted to.
    """
    least = CLOSE_SHARE * max(c.gain for c in one.tried)
    return [c.term for c in one.tried if c.gain >= least or same(c.term, one.term)]
