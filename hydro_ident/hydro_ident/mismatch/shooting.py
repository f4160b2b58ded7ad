"""Multiple shooting: parameters fitted to roll-outs over many short windows, by Gauss and Newton.

Every window starts from its own measured state, so that an error does not add up over a recording
and a roll-out that runs away harms its own window alone. Within bounds, with what is known of some
unknowns beforehand; intervals are robust against dependence within windows: the scores of whole
windows are what is taken as independent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear
from scipy.stats import t as student

from hydro_ident.estimate.rows import BoolArray
from hydro_model.robot import FloatArray

#: Weighted errors (measured less predicted) by window for a point; None where one has none.
Errors = Callable[[FloatArray], Sequence[FloatArray] | None]

#: Share of improvement below which a fit has settled, and halvings of a step that harms.
_SETTLED, _HALVINGS = 1.0e-4, 4
#: Share of the trace of the normal matrix that keeps it regular.
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
    known : (p,) bool array
        Those that are known beforehand, to 0 +- 1: their slopes are taken once, at the start.
    """

    start: FloatArray
    lower: FloatArray
    upper: FloatArray
    step: FloatArray
    known: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Outcome of a fit.

    Attributes
    ----------
    x : (p,) array
    covariance : (p, p) array
        Robust against dependence within windows, never below what the errors' weights say.
    quantile : float
        Deviations on either side of a 95 % interval: Student's, for so many windows.
    cost : tuple of float
        Sum of squares at the start and at the end, with what is known beforehand.
    passes : int
    """

    x: FloatArray
    covariance: FloatArray
    quantile: float
    cost: tuple[float, float]
    passes: int


def shoot(errors: Errors, unknowns: Unknowns, passes: int = 4) -> Solution | None:
    """Fit unknowns to the errors of windows.

    Minimises ``sum_w |e_w(x)|^2 + sum_known x^2`` within bounds; a step is the bounded
    least-squares solution of the linearised errors, halved where it does harm.

    Parameters
    ----------
    errors : callable
        Weighted errors by window: about unit variance per independent value.
    unknowns : Unknowns
    passes : int
        At most so many steps.

    Returns
    -------
    Solution or None
        None where the start or its surroundings cannot be rolled out.
    """
    x, taken = unknowns.start.copy(), 0
    now = errors(x)
    slopes = None if now is None else _slopes(errors, unknowns, x, now, None)
    if now is None or slopes is None:
        return None
    first = cost = _cost(now, x, unknowns)
    for taken in range(1, passes + 1):  # noqa: B007 - the number of passes is a result
        move = _step(slopes, now, x, unknowns)
        fresh = _improved(errors, unknowns, x, move, cost)
        if fresh is None:
            break
        x, now, gained, cost = fresh[0], fresh[1], cost - fresh[2], fresh[2]
        again = _slopes(errors, unknowns, x, now, slopes)
        if again is None:
            break
        slopes = again
        if gained < _SETTLED * max(cost, 1e-300):
            break
    covariance = _covariance(slopes, now, unknowns)
    freedom = max(len(now) - int(np.sum(~unknowns.known)), 1)
    quantile = float(student.ppf(0.5 + 0.5 * _LEVEL, freedom))
    return Solution(x, covariance, quantile, (first, cost), taken)


def _cost(errors: Sequence[FloatArray], x: FloatArray, unknowns: Unknowns) -> float:
    return sum(float(e @ e) for e in errors) + float(np.sum(x[unknowns.known] ** 2))


def _slopes(
    errors: Errors,
    unknowns: Unknowns,
    x: FloatArray,
    now: Sequence[FloatArray],
    kept: Sequence[FloatArray] | None,
) -> list[FloatArray] | None:
    """Slopes of the prediction by window, (T, p); of what is known beforehand those kept."""
    slopes = [np.zeros((e.size, x.size)) if kept is None else kept[w] for w, e in enumerate(now)]
    for i in range(x.size):
        if kept is not None and unknowns.known[i]:
            continue
        step = unknowns.step[i] if x[i] + unknowns.step[i] <= unknowns.upper[i] else -1.0
        step = step if step > 0.0 else -unknowns.step[i]
        there = x.copy()
        there[i] += step
        moved = errors(there)
        if moved is None:
            return None
        for own, before, after in zip(slopes, now, moved, strict=True):
            own[:, i] = (before - after) / step
    return slopes


def _normal(slopes: Sequence[FloatArray], unknowns: Unknowns) -> tuple[FloatArray, FloatArray]:
    """Normal matrix with what is known beforehand, in units of the columns' sizes, and these."""
    total = np.diag(unknowns.known.astype(float))
    for own in slopes:
        total = total + own.T @ own
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    scaled = total / np.outer(scale, scale)
    return scaled + _RIDGE * np.trace(scaled) * np.eye(scale.size), scale


def _step(
    slopes: Sequence[FloatArray], now: Sequence[FloatArray], x: FloatArray, unknowns: Unknowns
) -> FloatArray:
    normal, scale = _normal(slopes, unknowns)
    right = np.where(unknowns.known, -x, 0.0)
    for own, e in zip(slopes, now, strict=True):
        right = right + own.T @ e
    root = cholesky(normal)
    target = solve_triangular(root, right / scale, trans="T")
    low, high = (unknowns.lower - x) * scale, (unknowns.upper - x) * scale
    return np.asarray(lsq_linear(root, target, (low, high)).x / scale)


def _improved(
    errors: Errors, unknowns: Unknowns, x: FloatArray, move: FloatArray, cost: float
) -> tuple[FloatArray, Sequence[FloatArray], float] | None:
    """The first of ever shorter steps that does no harm, its errors and cost."""
    for k in range(_HALVINGS):
        there = np.clip(x + 0.5**k * move, unknowns.lower, unknowns.upper)
        fresh = errors(there)
        if fresh is not None and (after := _cost(fresh, there, unknowns)) < cost:
            return there, fresh, after
    return None


def _covariance(
    slopes: Sequence[FloatArray], now: Sequence[FloatArray], unknowns: Unknowns
) -> FloatArray:
    """``H^-1 (sum_w s_w s_w^T + P) H^-1`` with ``s_w = J_w^T e_w``, at least ``H^-1``."""
    normal, scale = _normal(slopes, unknowns)
    inverse = np.linalg.inv(normal)
    scores = np.array([own.T @ e for own, e in zip(slopes, now, strict=True)]) / scale
    count, free = len(now), int(np.sum(~unknowns.known))
    meat = scores.T @ scores * count / max(count - free, 1)
    meat += np.diag(unknowns.known / scale**2)
    robust = inverse @ meat @ inverse
    least = np.diag(inverse) / np.maximum(np.diag(robust), 1e-300)
    grown = np.sqrt(np.maximum(least, 1.0)) / scale
    return np.asarray(robust * np.outer(grown, grown))
