"""Joint refits: base and chosen effects together, by Gauss and Newton on the whitened rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_ident.mismatch.bench import Bench
from hydro_ident.mismatch.handover import handed_over
from hydro_ident.mismatch.prediction import Model, Predictor, shapes
from hydro_ident.mismatch.stepping import (
    given_steps,
    held_columns,
    is_free,
    moved,
    stepped,
)
from hydro_ident.mismatch.training import Training
from hydro_ident.mismatch.whitening import Noise
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Step of a derivative as a share of a parameter's size.
_STEP = 1.0e-3
#: Halvings of a step that makes things worse, and the share of improvement below which a fit has
#: settled.
_HALVINGS, _SETTLED = 4, 1.0e-7
#: Shares of an effect's reach to which its numbers are held where no step is better, though it
#: promises this share of what it would leave.
_NEARER, _STUCK = (1.0e-2, 1.0e-3, 1.0e-4), 0.1
#: Share of what is left that one more step has to promise to be taken, and how many are.
_PROMISED, _LONGEST = 1.0e-3, 12


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A model fitted to the training rows.

    Attributes
    ----------
    model : Model
    residual : (N,) array
        Measured less predicted on all rows of the material.
    columns : (N, p) array
        Base columns, then the slopes of every effect's parameters.
    names : tuple of str
    bench : Bench
        Of the residual on the training rows: behind it nothing is left in these columns.
    offset : (m,) array
        How far the base is from what was known of it, in deviations.
    refined : (p, p) array or None
        Covariance of an output-error refinement, where the model is one's.
    """

    model: Model
    residual: FloatArray
    columns: FloatArray
    names: tuple[str, ...]
    bench: Bench
    offset: FloatArray
    refined: FloatArray | None = None

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the numbers by `names`, robust against dependence in blocks."""
        return self.bench.covariance() if self.refined is None else self.refined

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the numbers, by `names`."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return dict(zip(self.names, std.tolist(), strict=True))

    @property
    def start_squares(self) -> float:
        """Sum of squares of the whitened residual before any further linear step."""
        return self.bench.squares

    @property
    def squares(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.bench.residual @ self.bench.residual)


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
    current = _at(training, _owned(training, model), noise)
    for _ in range(passes):
        fresh = _better(training, current, 1.0)
        if fresh is None and _promised(current) > _STUCK:
            # Along a bent valley an effect's numbers run off together: held nearer to what they
            # are, the others still find their way.
            nearer = (_better(training, current, share) for share in _NEARER)
            fresh = next((one for one in nearer if one is not None), None)
        if fresh is None:
            break
        gained = current.start_squares - fresh.start_squares
        current = fresh if noise is not None else _reweighed(training, fresh)
        if noise is not None and gained < _SETTLED * max(fresh.start_squares, 1.0):
            break
    return current


def _better(training: Training, current: Fitted, share: float) -> Fitted | None:
    """A fit one step further, halved until it is better; None where it never is.

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
        # A step is judged by the weights that it was found with.
        fresh = _at(training, further, current.bench.noise)
        if fresh.start_squares <= current.start_squares:
            return fresh
        factor *= 0.5
    return None


def _promised(one: Fitted) -> float:
    """What a last linear step would take out, as a share of what it would leave."""
    return (one.start_squares - one.squares) / max(one.squares, 1.0)


def _owned(training: Training, model: Model) -> Model:
    """A model in which what base and effect both say is the effect's."""
    return handed_over(training.predictor, model, training.own_delay_s)


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
        if _promised(current) <= _PROMISED:
            break
        fresh = fit(training, current.model, passes=1)
        if fresh.model is current.model:
            break
        current = fresh
    return current


def fitted(training: Training, model: Model, noise: Noise | None) -> Fitted:
    """A model as it is, with what a last linear step would still change taken out."""
    return _at(training, model, noise)


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
        step, factor, better = current.bench.solve(reach_of(current)), 1.0, False
        step = step[without.columns.shape[1] :]
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
    """A linear step; of a delay that would leave its range no further than to the end of that.

    What else goes with a delay or a skew follows how far it really goes.
    """
    reach = share * reach_of(current)
    step = current.bench.solve(reach)
    given = given_steps(training, current.model, step)
    if not given:
        return step
    columns, residual = current.columns.copy(), current.residual.copy()
    for at, change in given.items():
        residual -= change * columns[:, at]
        columns[:, at] = 0.0
    step = training.bench(current.bench.noise, residual, columns, current.offset).solve(reach)
    for at, change in given.items():
        step[at] = change
    return step


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
    slopes, names = _slopes(predictor, model, term, own)
    columns = np.concatenate([without.columns, *slopes], axis=1)
    residual = without.residual - own
    bench = training.bench(noise, residual, columns, without.offset)
    whole = (*without.names, *names)
    return Fitted(model.with_term(term), residual, columns, whole, bench, without.offset)


def _at(training: Training, model: Model, noise: Noise | None) -> Fitted:
    residual, columns, names = linearised(training.predictor, model)
    offset = training.offset(model)
    noise = noise or training.noise(_refitted(training, None, residual, columns, offset))
    bench = training.bench(noise, residual, columns, offset)
    if held := held_columns(training, model, bench.solve()):
        # A bound that holds leaves nothing to fit: what goes beyond it is a finding's.
        columns[:, held] = 0.0
        bench = training.bench(noise, residual, columns, offset)
    return Fitted(model, residual, columns, names, bench, offset)


def _reweighed(training: Training, one: Fitted) -> Fitted:
    """A fit with the noise that its own residual has."""
    left = _refitted(training, one.bench.noise, one.residual, one.columns, one.offset)
    bench = training.bench(training.noise(left), one.residual, one.columns, one.offset)
    return replace(one, bench=bench)


def _refitted(
    training: Training,
    noise: Noise | None,
    residual: FloatArray,
    columns: FloatArray,
    offset: FloatArray,
) -> FloatArray:
    """The residual after a linear refit, for estimating its noise."""
    if noise is None:
        own = [residual[training.mask & m] for m in _by_channel(training)]
        spread = [float(np.std(rows)) if rows.size else 0.0 for rows in own]
        white = tuple(np.zeros(0) for _ in spread)
        noise = Noise(white, np.maximum(np.array(spread), training.floor))
    bench = training.bench(noise, residual, columns, offset)
    return np.asarray(residual - columns @ bench.solve())


def _by_channel(training: Training) -> list[BoolArray]:
    material = training.predictor.material
    return [material.channel == k for k in range(len(material.channels))]


def linearised(
    predictor: Predictor, model: Model
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Residual of a model and the slopes of everything in it.

    Returns
    -------
    residual : (N,) array
    columns : (N, p) array
        Slopes of the prediction: base parameters, then every effect's.
    names : tuple of str
    """
    y, x = predictor.base(model)
    residual = y - x @ predictor.parameters(model)
    columns, names = [x], list(predictor.names)
    for term in model.terms:
        own = predictor.contribution(model, term)
        if term.effect.reading is None and not shapes(term):
            residual = residual - own
        slopes, own_names = _slopes(predictor, model, term, own)
        columns += slopes
        names += own_names
    return residual, np.concatenate(columns, axis=1), tuple(names)


def _slopes(
    predictor: Predictor, model: Model, term: ActiveEffect, own: FloatArray
) -> tuple[list[FloatArray], list[str]]:
    """Slopes (N, 1) of a term's contribution in its free parameters, and their names."""
    slopes, names = [], []
    for i, spec in enumerate(term.effect.parameters):
        if is_free(term, i) and _grows_with(term, i):
            slopes.append((own / term.parameters[i])[:, None])
            names.append(f"{term.target}.{term.effect.name}.{spec.name}")
        elif is_free(term, i):
            step, moved = _step(term, i), term.parameters.copy()
            moved[i] += step
            change = predictor.contribution(model, term, moved) - own
            slopes.append((change / step)[:, None])
            names.append(f"{term.target}.{term.effect.name}.{spec.name}")
    return slopes, names


def _grows_with(term: ActiveEffect, index: int) -> bool:
    """Whether all of a contribution is in proportion to a parameter, which is not near zero."""
    effect, spec = term.effect, term.effect.parameters[index]
    alone = effect.linear == (index,) and effect.reading is None and effect.change is None
    told = abs(term.parameters[index]) > _STEP * abs(spec.typical)
    return alone and told and not shapes(term)


def _step(term: ActiveEffect, index: int) -> float:
    """Step of a derivative, inwards from a bound."""
    spec = term.effect.parameters[index]
    size = abs(term.parameters[index]) or abs(spec.typical) or 1.0
    step = size * (1.0 if spec.linear else _STEP)
    if term.parameters[index] + step > spec.upper:
        return -step
    return step
