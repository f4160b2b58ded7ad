"""Lags of several spools against one delay of all commands, once everything else stands.

Which of them fits better is first asked where other effects are still missing, and whatever has
more numbers then takes up a part of those. With the others in place it is asked again.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import NEAR, fit
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.naming.contest import PASSES, Contest
from hydro_ident.mismatch.naming.lags import OF_VALVES, resolved
from hydro_ident.mismatch.naming.named import Named, named_of
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.trials.candidates import trials
from hydro_ident.mismatch.trials.contender import Contender, at_a_bound
from hydro_ident.mismatch.trials.scoring import Score, bank_of, score


def as_one_delay(
    contest: Contest,
    named: Sequence[Named],
    current: Fitted,
    excluded: Collection[tuple[str, str]] = (),
) -> tuple[list[Named], Fitted]:
    """Findings with one delay in the place of several valves' lags that say no more than it.

    Parameters
    ----------
    contest : Contest
    named : sequence of Named
    current : Fitted
        With all of them.
    excluded : collection of (str, str)
        Effects and targets that are not tried: a delay that held-out rows refused is none again.

    Returns
    -------
    named : list of Named
    current : Fitted
    """
    result = list(named)
    if (DELAY, contest.training.predictor.material.robot.name) in excluded:
        return result, current
    listed = any(t.effect.name == DELAY and t.cylinder is None for t in current.model.terms)
    for names in (OF_VALVES, *((name,) for name in OF_VALVES)):
        lags = [n for n in result if n.term.effect.name in names and n.term.cylinder is not None]
        if listed or len({n.term.target for n in lags}) < 2:
            continue
        delay = _in_place(contest, lags, current)
        if delay is not None:
            result = [delay if n is lags[0] else n for n in result if n not in lags[1:]]
            current, listed = fit(contest.training, delay.modelled.fitted.model, passes=NEAR), True
    return result, current


def _in_place(contest: Contest, lags: Sequence[Named], current: Fitted) -> Named | None:
    """The delay as a finding; None where the lags say more."""
    training, noise = contest.training, current.bench.noise
    gone = {(n.term.effect.name, n.term.target) for n in lags}
    rest = tuple(t for t in current.model.terms if (t.effect.name, t.target) not in gone)
    without = fitted(training, replace(current.model, terms=rest), noise)
    start = _scored(training, without)
    if start is None:
        return None
    (own,) = contest.fitted(without, [contest.starts.start(without, start)], noise)
    if at_a_bound(own.term) or not resolved(training, without, own):
        return None
    own = _whole(contest, without, own)
    spread = contest.spread(without, start, own.fitted)
    unit = 0.5 / spread
    of_lags = unit * (contest.held_out(without) - contest.held_out(current))
    of_delay = unit * own.held_out
    if of_delay - own.cost < of_lags - sum(n.modelled.cost for n in lags):
        return None
    found = named_of([own], min(n.p_value for n in lags), spread, contest.few.of([own.term]))
    # All spools alike are one number as well: what fits alike is not told apart.
    odds = float(np.exp(min(of_lags - of_delay, 0.0)))
    return found.beside({lags[0].term.effect.name: odds})


def _whole(contest: Contest, without: Fitted, own: Contender) -> Contender:
    """The delay with what all bases have beyond a cycle: that is its own, too."""
    whole = fit(contest.training, own.fitted.model, without.bench.noise, PASSES)
    gain = without.squares - whole.squares
    held = contest.held_out(without) - contest.held_out(whole)
    return replace(own, term=whole.model.terms[-1], fitted=whole.weighed, gain=gain, held_out=held)


def _scored(training: Training, without: Fitted) -> Score | None:
    """The delay beside a model without the lags; None where it does nothing there."""
    predictor, model = training.predictor, without.model
    of_all = [t for t in trials(predictor, model, [DELAY]) if t.active.cylinder is None]
    bank = bank_of(predictor, model, of_all)
    scores = [s for e in bank if (s := score(without.bench, e, training.mask)) is not None]
    return max(scores, key=lambda s: s.value, default=None)
