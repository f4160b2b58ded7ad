"""Joint refits: base and chosen effects together, by Gauss and Newton on the whitened rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted, fitted, fitted_at, fitted_with, reweighed
from hydro_ident.mismatch.fitting.handover import handed_over
from hydro_ident.mismatch.fitting.limits import Limits
from hydro_ident.mismatch.fitting.slopes import Start, slopes_of, start_at
from hydro_ident.mismatch.fitting.stepping import (
    is_free,
    limits_of,
    longest_delay,
    moved,
    stepped,
    term_limits,
)
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.fitting.whitening import Noise
from hydro_ident.mismatch.rows.prediction import Model
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Halvings of a step that makes things worse, and the share of improvement below which a fit has
#: settled.
_HALVINGS, _SETTLED = 4, 1.0e-7
#: Shares of an effect's reach to which its numbers are held, the next where a step promises more
#: than this share of what it would leave and gains less than that share of what it promises.
_SHARES, _STUCK, _POOR = (1.0, 1.0e-2, 1.0e-3, 1.0e-4), 0.1, 0.1
#: Share of what is left that one more step has to promise to be taken, and how many are.
_PROMISED, _LONGEST = 1.0e-3, 12
#: Passes of a fit that begins near its end: one effect is new or gone, or the rows are others. The
#: second takes up what the first has bent; who needs more goes on with `settled`.
NEAR = 2
#: Of one that begins at the base's own numbers, with every effect at once: what they have in
#: common is shared out anew, and numbers have far to go.
FROM_AFAR = 4
#: A single step: where the next one is taken under noise found anew or with other effects, or the
#: residual is only looked at.
ONE_STEP = 1
#: Effects do little where without them no more is left than so many times what there is with them.
_LITTLE = 2.0


def fit(training: Training, model: Model, noise: Noise | None = None, passes: int = 3) -> Fitted:
    """Refit the base and every effect of a model together.

    Parameters
    ----------
    training : Training
    model : Model
        Start.
    noise : Noise, optional
        How rows are weighed; by default that of the residual, pass by pass.
    passes : int

    Returns
    -------
    Fitted
    """
    return _taken_on(
        training, lambda: fitted(training, _owned(training, model), noise), noise, passes
    )


def _taken_on(
    training: Training, begun: Callable[[], Fitted], noise: Noise | None, passes: int
) -> Fitted:
    """A fit taken further, as `fit` does from a model.

    `begun` makes the first: nobody else keeps its rows.
    """
    current, held = begun(), 0
    for _ in range(passes):
        start, held = _further(training, current, held)
        if start is None:
            break
        before, weighed_by = current.start_squares, current.bench.noise
        # Its rows are as many as those of the next one, which is made while it would be kept.
        del current
        current = fitted_at(training, start, weighed_by)
        gained = before - current.start_squares
        if noise is None:
            current = reweighed(training, current)
        elif gained < _SETTLED * max(current.start_squares, 1.0):
            break
    return current


def _further(training: Training, current: Fitted, held: int) -> tuple[Start | None, int]:
    """The model a step further, and which share of an effect's reach it was held to; or none.

    Along a bent valley an effect's numbers run off together, and a step that promises much gains
    little or nothing: held nearer to what they are, the others still find their way.

    Parameters
    ----------
    training : Training
    current : Fitted
    held : int
        Where among the shares to begin: with what the last step was held to.
    """
    share = _promised(training, current)
    promised = share * current.squares
    best, most, at = None, -np.inf, held
    for k in range(held, len(_SHARES)):
        start, gain = _better(training, current, _SHARES[k])
        if start is not None and gain > most:
            best, most, at = start, gain, k
        if share <= _STUCK or most >= _POOR * promised:
            break
    if best is None and held:
        return _further(training, current, 0)
    return best, at


def _better(training: Training, current: Fitted, share: float) -> tuple[Start | None, float]:
    """A step, halved until it is better, and what it gains; None where it never is.

    Parameters
    ----------
    training : Training
    current : Fitted
    share : float
        Of how far an effect's numbers reach (`reach_of`).
    """
    step, factor = _within_range(training, current, share), 1.0
    for _ in range(_HALVINGS):
        further = _owned(training, moved(training, current.model, factor * step))
        start = start_at(training.predictor, further)
        # A step is judged by the weights that it was found with.
        noise, offset = current.bench.noise, training.offset(further)
        gain = current.start_squares - training.squares(noise, start.residual, offset)
        if gain >= 0.0:
            return start, gain
        factor *= 0.5
    return None, 0.0


def _promised(training: Training, one: Fitted) -> float:
    """What a linear step within limits would take out, as a share of what is left."""
    step = _within_range(training, one)
    return one.bench.taken_out(step) / max(one.squares, 1.0)


def _owned(training: Training, model: Model) -> Model:
    """A model in which what base and effect both say is the effect's."""
    columns = training.predictor.delay_columns
    longest_s = {index: longest_delay(training, index) for index in columns}
    return handed_over(training.predictor, model, training.own_delay_s, longest_s)


def settled(training: Training, current: Fitted) -> Fitted:
    """A fit taken on until a further step promises next to nothing.

    Numbers that go together, a lag's and a delay's, take more passes than those of most laws; what
    a last linear step would still take out no model has, neither on other rows nor in a file.

    Parameters
    ----------
    training : Training
    current : Fitted

    Returns
    -------
    Fitted
    """
    for _ in range(_LONGEST):
        if _promised(training, current) <= _PROMISED:
            break
        # Under noise found anew: of what hardly shows, that of the fit before is of no size.
        fresh = fit(training, current.model, passes=ONE_STEP)
        if fresh.model is current.model:
            break
        current = fresh
    return current


def fit_without(
    training: Training, whole: Fitted, terms: Sequence[ActiveEffect], passes: int = NEAR
) -> Fitted:
    """Refit a model without some of its effects, from a fit with them.

    How the others' numbers move what is predicted is hardly another thing without some that do
    little: the first step is taken with the slopes that are known.

    Parameters
    ----------
    training : Training
    whole : Fitted
    terms : sequence of ActiveEffect
        Those that the model keeps.
    passes : int

    Returns
    -------
    Fitted
        Weighed by the same noise.
    """
    model, noise = replace(whole.model, terms=tuple(terms)), whole.bench.noise
    prefixes = tuple(
        f"{t.target}.{t.effect.name}."
        for t in whole.model.terms
        if not any(t is one for one in terms)
    )
    kept = [k for k, name in enumerate(whole.names) if not name.startswith(prefixes)]
    start = start_at(training.predictor, model)
    if training.squares(noise, start.residual, whole.offset) > _LITTLE * whole.squares:
        return fit(training, model, noise, passes)

    def begun() -> Fitted:
        columns = whole.columns[:, kept]
        # A bound that held with them need not without: such columns are nil in the whole.
        nil = [k for k in range(start.base.shape[1]) if not columns[:, k].any()]
        columns[:, nil] = start.base[:, nil]
        return fitted_with(training, start, columns, [whole.names[k] for k in kept], noise)

    result = _taken_on(training, begun, noise, passes)
    # Where no step with those slopes leads further, one with its own may.
    return result if result.model is not model else fit(training, model, noise, passes)


def fit_term(
    training: Training, without: Fitted, term: ActiveEffect, noise: Noise, passes: int
) -> Fitted:
    """Fit one more effect, everything else following to first order: quick, for a comparison.

    Parameters
    ----------
    training : Training
    without : Fitted
    term : ActiveEffect
        Start.
    noise : Noise
    passes : int

    Returns
    -------
    Fitted
        Of the model without the effect, with the effect last.
    """
    current = _with_term(training, without, term, noise)
    for _ in range(passes):
        own = term_limits(current.model.terms[-1])
        free = np.full(without.columns.shape[1], np.inf)
        limits = Limits(np.append(-free, own.lower), np.append(free, own.upper))
        step, factor, better = current.bench.solve(reach_of(current), limits), 1.0, False
        step = step[free.size :]
        for _ in range(_HALVINGS):
            moved = stepped(current.model.terms[-1], factor * step)
            fresh = _with_term(training, without, moved, noise)
            better = fresh.squares <= current.squares
            if better:
                break
            factor *= 0.5
        if not better:
            break
        gained, current = current.squares - fresh.squares, fresh
        if gained < _SETTLED * max(current.squares, 1.0):
            break
    return current


def _within_range(training: Training, current: Fitted, share: float = 1.0) -> FloatArray:
    """A linear step of numbers that go no further than they may.

    What else goes with one that is at its limit follows how far that really goes.
    """
    limits = limits_of(training, current.model)
    return current.bench.solve(share * reach_of(current), limits)


def reach_of(one: Fitted) -> FloatArray:
    """How far a step goes in what the rows do not tell: an effect's own size, or a usual one.

    A spring beside links of unknown weight is told by what its force at one place comes to; the
    numbers that would come to the same run off to where a step of them means nothing.

    Parameters
    ----------
    one : Fitted

    Returns
    -------
    (p,) array
        Of every column; infinite for the base's.
    """
    sizes = [
        max(abs(float(term.parameters[i])), abs(spec.typical)) or np.inf
        for term in one.model.terms
        for i, spec in enumerate(term.effect.parameters)
        if is_free(term, i)
    ]
    return np.array([*[np.inf] * (one.columns.shape[1] - len(sizes)), *sizes])


def _with_term(training: Training, without: Fitted, term: ActiveEffect, noise: Noise) -> Fitted:
    predictor, model = training.predictor, without.model
    own = predictor.contribution(model, term)
    slopes, names = slopes_of(predictor, model, term, own)
    columns = np.concatenate([without.columns, *slopes], axis=1)
    residual = without.residual - own
    bench = training.bench(noise, residual, columns, without.offset)
    whole = (*without.names, *names)
    return Fitted(
        model.with_term(term), residual, columns, whole, bench, without.offset, held=without.held
    )
