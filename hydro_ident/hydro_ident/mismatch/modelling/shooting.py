"""Multiple shooting: parameters fitted to roll-outs over many short windows, by Gauss and Newton.

Every window starts from its own measured state, so that an error does not add up over a recording
and a roll-out that runs away harms its own window alone. Samples of a roll-out's error hang
together; whole windows are what is taken as independent, for the weight of all errors beside what
is known of the unknowns beforehand, and for the intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear
from scipy.stats import t as student

from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

#: Errors (measured less predicted, weighted) by window for a point; None where one has none.
Errors = Callable[[FloatArray], Sequence[FloatArray] | None]

#: Share of improvement below which a fit has settled, and halvings of a step that harms.
_SETTLED, _HALVINGS = 1.0e-4, 4
#: Share of a scaled normal matrix' trace that keeps it regular.
_RIDGE = 1.0e-12
_LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class Unknowns:
    """What is fitted; p of them.

    Attributes
    ----------
    start, lower, upper : (p,) array
    step : (p,) array
        Of the derivatives; taken inwards at a bound.
    once : (p,) bool array
        Those whose slopes are taken at the start alone.
    information : (p, p) array
        Inverse covariance of what is known beforehand: that they are at the start.
    """

    start: FloatArray
    lower: FloatArray
    upper: FloatArray
    step: FloatArray
    once: BoolArray
    information: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Outcome of a fit.

    Attributes
    ----------
    x : (p,) array
    covariance : (p, p) array
        Robust against dependence within windows, whatever the errors of windows have in common
        with those of what was known beforehand.
    quantile : float
        Deviations on either side of a 95 % interval: Student's, for so many windows.
    cost : tuple of float
        Sum of the errors' squares at the start and at the end.
    passes : int
    """

    x: FloatArray
    covariance: FloatArray
    quantile: float
    cost: tuple[float, float]
    passes: int


@dataclass(frozen=True, slots=True, eq=False)
class _Linear:
    """Errors at a point with their slopes by window, and what they make of a step.

    Attributes
    ----------
    x : (p,) array
    errors : sequence of (T,) array
    slopes : sequence of (T, p) array
    excess : float
        Variance of whole windows' scores over that of independent errors of unit variance.
    """

    x: FloatArray
    errors: Sequence[FloatArray]
    slopes: Sequence[FloatArray]
    excess: float

    @property
    def squares(self) -> float:
        return sum(float(e @ e) for e in self.errors)

    def gram(self) -> FloatArray:
        return np.asarray(sum(own.T @ own for own in self.slopes))

    def score(self) -> FloatArray:
        return np.asarray(sum(s.T @ e for s, e in zip(self.slopes, self.errors, strict=True)))


def shoot(errors: Errors, unknowns: Unknowns, passes: int = 4) -> Solution | None:
    """Fit unknowns to the errors of windows.

    Minimises ``sum_w |e_w(x)|^2 / c + (x - x0)^T P (x - x0)`` within bounds, with `c` the excess
    of the windows' scores over those of independent errors, taken anew for every step. A step is
    the bounded least-squares solution of the linearised errors, halved where it does harm.

    Parameters
    ----------
    errors : callable
    unknowns : Unknowns
    passes : int
        At most so many steps.

    Returns
    -------
    Solution or None
        None where the start or its surroundings cannot be rolled out.
    """
    first = now = _linear(errors, unknowns, unknowns.start, None, None)
    taken = 0
    while now is not None and taken < passes:
        fresh = _improved(errors, unknowns, now, _step(now, unknowns))
        if fresh is None:
            break
        gained = _cost(now.x, now.errors, now.excess, unknowns)
        gained -= _cost(fresh[0], fresh[1], now.excess, unknowns)
        taken, settled = taken + 1, gained < _SETTLED * max(now.squares / now.excess, 1e-300)
        now = _linear(errors, unknowns, fresh[0], fresh[1], now.slopes)
        if settled:
            break
    if first is None or now is None:
        return None
    freedom = max(len(now.errors) - int(np.sum(~unknowns.once)), 1)
    quantile = float(student.ppf(0.5 + 0.5 * _LEVEL, freedom))
    cost = first.squares, now.squares
    return Solution(now.x, _covariance(now, unknowns), quantile, cost, taken)


def _linear(
    errors: Errors,
    unknowns: Unknowns,
    x: FloatArray,
    known: Sequence[FloatArray] | None,
    kept: Sequence[FloatArray] | None,
) -> _Linear | None:
    """Errors at a point, if not known, and their slopes; of those taken once the kept ones."""
    now = errors(x) if known is None else known
    if now is None:
        return None
    slopes = [np.zeros((e.size, x.size)) if kept is None else kept[w] for w, e in enumerate(now)]
    for i in range(x.size):
        if kept is not None and unknowns.once[i]:
            continue
        step = unknowns.step[i]
        step = step if x[i] + step <= unknowns.upper[i] else -step
        there = x.copy()
        there[i] += step
        moved = errors(there)
        if moved is None:
            return None
        for own, before, after in zip(slopes, now, moved, strict=True):
            own[:, i] = (before - after) / step
    return _Linear(x, now, slopes, _excess(now, slopes))


def _excess(errors: Sequence[FloatArray], slopes: Sequence[FloatArray]) -> float:
    """Variance of the windows' scores over that of independent errors of unit variance.

    Of what no step of the unknowns explains: what one does is no noise.
    """
    gram = np.asarray(sum(own.T @ own for own in slopes))
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    right = sum(own.T @ e for own, e in zip(slopes, errors, strict=True)) / scale
    step = np.linalg.lstsq(gram / np.outer(scale, scale), right, rcond=1e-8)[0] / scale
    scores = [own.T @ (e - own @ step) / scale for own, e in zip(slopes, errors, strict=True)]
    return max(float(np.sum(np.square(scores))) / scale.size, 1e-12)


def _cost(x: FloatArray, errors: Sequence[FloatArray], excess: float, unknowns: Unknowns) -> float:
    away = x - unknowns.start
    return sum(float(e @ e) for e in errors) / excess + float(away @ unknowns.information @ away)


def _normal(now: _Linear, unknowns: Unknowns) -> tuple[FloatArray, FloatArray]:
    """Normal matrix in units of the columns' sizes, and these."""
    total = now.gram() / now.excess + unknowns.information
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    scaled = total / np.outer(scale, scale)
    return scaled + _RIDGE * scale.size * np.eye(scale.size), scale


def _step(now: _Linear, unknowns: Unknowns) -> FloatArray:
    normal, scale = _normal(now, unknowns)
    right = now.score() / now.excess - unknowns.information @ (now.x - unknowns.start)
    root = cholesky(normal)
    target = solve_triangular(root, right / scale, trans="T")
    low, high = (unknowns.lower - now.x) * scale, (unknowns.upper - now.x) * scale
    return np.asarray(lsq_linear(root, target, (low, high)).x / scale)


def _improved(
    errors: Errors, unknowns: Unknowns, now: _Linear, move: FloatArray
) -> tuple[FloatArray, Sequence[FloatArray]] | None:
    """The first of ever shorter steps that does no harm, with its errors."""
    cost = _cost(now.x, now.errors, now.excess, unknowns)
    for k in range(_HALVINGS):
        there = np.clip(now.x + 0.5**k * move, unknowns.lower, unknowns.upper)
        fresh = errors(there)
        if fresh is not None and _cost(there, fresh, now.excess, unknowns) < cost:
            return there, fresh
    return None


def _covariance(now: _Linear, unknowns: Unknowns) -> FloatArray:
    """Of ``N^-1 (sum_w J_w^T e_w / c + P (x0 - truth))``, the two parts together at their worst.

    What was known beforehand may come from the same recordings: a deviation is at most the sum of
    both parts' deviations.
    """
    normal, scale = _normal(now, unknowns)
    inverse = np.linalg.inv(normal) / np.outer(scale, scale)
    scores = [s.T @ e / now.excess for s, e in zip(now.slopes, now.errors, strict=True)]
    count, free = len(scores), int(np.sum(~unknowns.once))
    own = np.array(scores).T @ np.array(scores) * count / max(count - free, 1)
    parts = [inverse @ meat @ inverse for meat in (own, unknowns.information)]
    total = parts[0] + parts[1]
    most = sum(np.sqrt(np.maximum(np.diag(part), 0.0)) for part in parts)
    grown = most / np.sqrt(np.maximum(np.diag(total), 1e-300))
    return np.asarray(total * np.outer(grown, grown))
