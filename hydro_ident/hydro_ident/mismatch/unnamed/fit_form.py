"""Short forms fitted to the rows of a channel, behind a refit of its base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.locating.dependence import inverse_of
from hydro_ident.mismatch.locating.forms import PERIOD, PLACE, Kind, shape_values
from hydro_ident.mismatch.locating.lines import waves
from hydro_ident.mismatch.rows.state_space import hats
from hydro_ident.mismatch.settings import FORM_TOLERANCE
from hydro_ident.mismatch.trials.scoring import SWALLOWED
from hydro_model.arrays import IndexArray
from hydro_model.robot import FloatArray

#: Deviations beyond which a constant beside a form is not chance.
_SURE = 3.0
#: Share of the range between its neighbours to which a shape value is refined.
_FINE = 1.0e-3
#: Step of a derivative by a shape value, of what the rows can tell of it.
_STEP = 1.0e-3


@dataclass(frozen=True, slots=True)
class Rows:
    """A channel's rows with the variable of a dependence on them.

    Attributes
    ----------
    bench : Bench
        Of the channel's rows alone: what counts is beyond a refit of the base.
    at, factor : (n,) array
        The variable, and what a function of it is multiplied by.
    recording : (n,) int array
    variable : str
    """

    bench: Bench
    at: FloatArray
    factor: FloatArray
    recording: IndexArray
    variable: str

    def columns(self, kind: Kind, shape: float, offset: bool) -> FloatArray:
        """Columns (n, k) of a form times the factor, with a constant last where asked for.

        `shape` is the form's one number that it is not linear in.
        """
        found = kind.columns(self.at, shape)
        if offset:
            found = np.concatenate([found, np.ones((found.shape[0], 1))], axis=1)
        return np.asarray(found * self.factor[:, None])

    def curve(self, knots: FloatArray, period: float) -> FloatArray:
        """Columns (n, m) of the free curve: straight pieces, or a wave.

        `knots` (m,) are where pieces meet; `period` is that of a wave, 0 for pieces.
        """
        found = waves(self.at / period) if period else hats(self.at, knots)
        return np.asarray(found * self.factor[:, None])

    def beyond(self, columns: FloatArray, theta: FloatArray) -> FloatArray:
        """Whitened function (M,) of columns, the base refitted around it."""
        return self.bench.beyond((columns @ theta)[:, None])[:, 0]

    def improvement(self, function: FloatArray) -> FloatArray:
        """What a whitened function (M,) takes off the sum of squares, by block of time."""
        change = function * (2.0 * self.bench.residual - function)
        return self.bench.by_block(change[:, None])[:, 0]


@dataclass(frozen=True, slots=True)
class FittedForm:
    """A short form at its best shape value.

    Attributes
    ----------
    kind : Kind
    shape : float
    offset : bool
        Whether a constant stands beside it.
    theta : (k,) array
        Coefficients, that of the constant last.
    covariance : (k, k) or (k + 1, k + 1) array
        Of the coefficients, and of the shape value, last, where the rows tell it. Robust against
        dependence in blocks; holds what the form, an idealisation, is off by.
    gain : float
        Reduction of the sum of squares, in units of the noise's variance.
    """

    kind: Kind
    shape: float
    offset: bool
    theta: FloatArray
    covariance: FloatArray
    gain: float

    @property
    def freedom(self) -> int:
        """Coefficients, and the shape value."""
        return self.kind.freedom + self.offset

    @property
    def size_std(self) -> float:
        """Deviation of the size of the form as a whole, as a share of it."""
        own = self.covariance[: self.theta.size, : self.theta.size]
        weight = float(self.theta @ np.linalg.solve(own, self.theta))
        return weight**-0.5 if weight > 0.0 else np.inf

    @property
    def net(self) -> float:
        """The gain, less what as many coefficients gain by chance."""
        return self.gain - self.freedom


def gain_of(rows: Rows, columns: FloatArray) -> tuple[float, int]:
    """What columns gain as a free fit, and how many directions they have."""
    partial = rows.bench.partial(columns)
    rank, inverse = inverse_of(partial.gram)
    sums = partial.scores.sum(axis=0)
    return float(sums @ inverse @ sums), rank


def theta_of(rows: Rows, columns: FloatArray) -> FloatArray:
    """Coefficients (k,) of columns as a free fit."""
    partial = rows.bench.partial(columns)
    return np.asarray(inverse_of(partial.gram)[1] @ partial.scores.sum(axis=0))


def fit_kind(rows: Rows, kind: Kind, offset: bool, period: float = 0.0) -> FittedForm | None:
    """A form at its best shape value; None where a refit of the base swallows part of it.

    Parameters
    ----------
    rows : Rows
    kind : Kind
    offset : bool
    period : float
        About which a period is looked for, where it is known.
    """
    tried = _about(period, rows.at) if period else shape_values(kind, rows.at)
    gains = [_gain(rows, kind, shape, offset) for shape in tried.tolist()]
    if not gains or max(gains) <= 0.0:
        return None
    best = int(np.argmax(gains))
    shape = float(tried[best])
    if kind.shape and tried.size > 1:
        shape = _refined(rows, kind, offset, tried, best)
    return _fitted(rows, kind, shape, offset)


def _about(period: float, at: FloatArray) -> FloatArray:
    """A period with the neighbours that the rows can tell from it."""
    return np.asarray(1.0 / (1.0 / period + np.array([0.5, 0.0, -0.5]) / np.ptp(at)))


def needs_offset(plain: FittedForm | None, more: FittedForm | None) -> bool:
    """Whether a constant beside a form is beyond chance and beyond what a form is good for.

    `plain` is the form alone, `more` the form with a constant; None where it could not be
    fitted.
    """
    if plain is None or more is None:
        return plain is None
    last = more.theta.size - 1
    sure = abs(more.theta[last]) > _SURE * float(np.sqrt(more.covariance[last, last]))
    return sure and more.gain - plain.gain > FORM_TOLERANCE**2 * more.gain


def _refined(rows: Rows, kind: Kind, offset: bool, tried: FloatArray, best: int) -> float:
    """The best shape value between a value's neighbours; its own one where none is better."""
    # Periods are refined as wave numbers, scales as logarithms: the gain is smooth in these.
    low, high = tried[max(best - 1, 0)], tried[min(best + 1, tried.size - 1)]
    if kind.shape == PERIOD:
        low, high = 1.0 / high, 1.0 / low

    def loss(value: float) -> float:
        return -_gain(rows, kind, 1.0 / value if kind.shape == PERIOD else value, offset)

    found = minimize_scalar(
        loss, bounds=(float(low), float(high)), method="bounded",
        options={"xatol": _FINE * float(high - low)},
    )  # fmt: skip
    start = float(tried[best])
    if -float(found.fun) <= _gain(rows, kind, start, offset):
        return start
    return 1.0 / float(found.x) if kind.shape == PERIOD else float(found.x)


def _solved(
    rows: Rows, kind: Kind, shape: float, offset: bool
) -> tuple[FloatArray, FloatArray, float] | None:
    """Coefficients, inverse of their Gram matrix and gain."""
    partial = rows.bench.partial(rows.columns(kind, shape, offset))
    diagonal = np.diag(partial.gram)
    if (diagonal <= SWALLOWED * partial.plain).any():
        return None
    size = np.sqrt(diagonal)
    rank, inverse = inverse_of(partial.gram / np.outer(size, size))
    if rank < size.size:
        return None
    inverse = inverse / np.outer(size, size)
    sums = partial.scores.sum(axis=0)
    theta = inverse @ sums
    return theta, inverse, float(sums @ theta)


def _gain(rows: Rows, kind: Kind, shape: float, offset: bool) -> float:
    solved = _solved(rows, kind, shape, offset)
    return 0.0 if solved is None else solved[2]


def _fitted(rows: Rows, kind: Kind, shape: float, offset: bool) -> FittedForm | None:
    solved = _solved(rows, kind, shape, offset)
    if solved is None:
        return None
    theta, inverse, gain = solved
    columns = rows.columns(kind, shape, offset)
    white = rows.bench.beyond(columns)
    rest = rows.bench.residual - white @ theta
    if kind.shape:
        slope = rows.bench.beyond(_slope(rows, kind, shape, offset, theta))
        white = np.concatenate([white, slope], axis=1)
        size = np.linalg.norm(white, axis=0)
        size[size == 0.0] = 1.0
        rank, whole = inverse_of(white.T @ white / np.outer(size, size))
        if rank == size.size:
            inverse = whole / np.outer(size, size)
        white = white[:, : inverse.shape[0]]
    scores = rows.bench.by_block(white * rest[:, None])
    covariance = inverse @ (scores.T @ scores) @ inverse
    # Never below what independent rows would give.
    at = np.arange(inverse.shape[0])
    variance = np.maximum(np.diag(covariance), np.diag(inverse))
    variance[: theta.size] += (FORM_TOLERANCE * theta) ** 2
    covariance[at, at] = variance
    return FittedForm(kind, shape, offset, theta, covariance, gain)


def _slope(
    rows: Rows, kind: Kind, shape: float, offset: bool, theta: FloatArray
) -> FloatArray:  # fmt: skip
    """Derivative (n, 1) of a form with respect to its shape value."""
    span = float(np.ptp(rows.at))
    usual = {PERIOD: shape * shape / span, PLACE: span}.get(kind.shape, shape)
    step = _STEP * usual
    ahead = rows.columns(kind, shape + step, offset) @ theta
    behind = rows.columns(kind, shape - step, offset) @ theta
    return np.asarray((ahead - behind)[:, None] / (2.0 * step))
