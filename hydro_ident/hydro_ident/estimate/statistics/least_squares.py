"""Weighted least squares over several channels, with errors that respect autocorrelation.

Residuals of a crane are strongly autocorrelated: with the iid formula, nominal 95 % intervals
cover 15-52 % of the true values. Here every channel is weighted by its residual, and the
residuals' autocorrelation enters the covariance (`hydro_ident.estimate.statistics.regression`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.statistics.blocks import Blocks, blocks_of
from hydro_ident.estimate.statistics.moments import Moments
from hydro_ident.estimate.statistics.regression import (
    Solution,
    solve_iv,
    solve_ols,
    solve_wls,
    stacked_columns,
)
from hydro_ident.estimate.statistics.robust import EXCESS, Weights, robust_scale
from hydro_ident.estimate.statistics.rows import Rows
from hydro_ident.estimate.statistics.solution import levels
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

__all__ = [
    "MAX_COLLINEARITY",
    "BoolArray",
    "Estimator",
    "Fit",
    "Rows",
    "collinearity",
    "fit_of_solution",
    "weighted_least_squares",
]

#: Ordinary; weighted per channel; weighted and robust; weighted with instruments.
Estimator = Literal["ols", "wls", "robust", "iv"]
#: A parameter whose column resembles the others this much is not told apart from them.
MAX_COLLINEARITY = 1.0e3
#: Robust passes: Huber's weights first, then the biweight.
HUBER_PASSES, ROBUST_PASSES = 3, 10
#: A robust fit has settled when no parameter moves by more than this share of its deviation.
ROBUST_SETTLED = 0.02


@dataclass(frozen=True, slots=True)
class Fit:
    """Outcome of a regression.

    Attributes
    ----------
    theta : (p,) array
    covariance : (p, p) array
        Autocorrelation-consistent.
    channel_std : (k,) array
        Residual standard deviation per channel.
    collinearity : (p,) array
        Factor by which a parameter's error grows because its column resembles the others
        (square root of the variance inflation); infinite for a column of zeros.
    rows : int
        Measured rows used, all channels together.
    dof : (p,) array
        Degrees of freedom of the standard deviations.
    noise : (k, lags) array
        Autoregression of each channel's noise.
    gram : (p, p) array
        Mean product of the columns per row, each channel in units of its residual.
    """

    theta: FloatArray
    covariance: FloatArray
    channel_std: FloatArray
    collinearity: FloatArray
    rows: int
    dof: FloatArray = field(default_factory=lambda: np.zeros(0))
    noise: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    gram: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def std(self) -> FloatArray:
        """Standard deviations, shape (p,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def weighted_least_squares(pieces: Sequence[Rows], estimator: Estimator = "wls") -> Fit:
    """Regression over pieces and channels held in memory.

    Parameters
    ----------
    pieces : sequence of Rows
        Correlation is counted within a piece, never across two.
    estimator : {"wls", "ols", "robust", "iv"}

    Returns
    -------
    Fit

    Raises
    ------
    IdentError
        There are fewer measured rows than parameters, or no instruments for `iv`.
    """
    moments = [_moments(piece, f"{i}") for i, piece in enumerate(pieces)]
    count = int(sum(one.rows.sum() for one in moments))
    size = pieces[0].x.shape[2]
    if count <= size or not any(one.lagged.sum() for one in moments):
        raise IdentError(f"{count} rows cannot determine {size} parameters")
    blocks = blocks_of(moments)
    if estimator in ("iv", "ols"):
        solve = solve_iv if estimator == "iv" else solve_ols
        return fit_of_solution(solve(blocks), blocks, count)
    solution = solve_wls(blocks)
    if estimator == "robust":
        weights = None
        for number in range(ROBUST_PASSES):
            weights = weights_of(solution, blocks, weights, number)
            blocks = blocks_of([_moments(p, f"{i}", weights) for i, p in enumerate(pieces)])
            before, solution = solution, solve_wls(blocks, EXCESS)
            if robust_settled(before, solution, number):
                break
    return fit_of_solution(solution, blocks, count)


def fit_of_solution(solution: Solution, blocks: Blocks, rows: int) -> Fit:
    """A solution with what is said about it."""
    columns = stacked_columns(blocks, solution.residual_std)
    return Fit(
        solution.theta,
        solution.covariance,
        solution.residual_std,
        collinearity(columns),
        rows,
        solution.dof,
        solution.phi,
        columns.T @ columns / max(float(blocks.count.sum()), 1.0),
    )


def weights_of(
    solution: Solution,
    blocks: Blocks,
    before: Weights | None = None,
    number: int = 0,
) -> Weights:
    """Weights of the next robust pass.

    Parameters
    ----------
    solution : Solution
        Of the pass before.
    blocks : Blocks
        That it was found from.
    before : Weights, optional
        Of the pass before: its residuals give the scale.
    number : int
        Of the next pass, from 0.
    """
    keys = list(zip(blocks.channel.tolist(), blocks.labels, strict=True))
    scale = dict(zip(keys, solution.level.tolist(), strict=True))
    if before is not None:
        # The fit follows slow noise: its residuals are smaller than the noise by this much.
        taken = solution.level / levels(blocks, solution.theta)
        grown = dict(zip(keys, np.maximum(taken, 1.0).tolist(), strict=True))
        # Where half of the residuals vanish (exact data) the last scale stays.
        met = before.residuals.items()
        scale |= {k: grown.get(k, 1.0) * robust_scale(h) or scale[k] for k, h in met}
    return Weights(np.append(-solution.theta, 1.0), scale, number >= HUBER_PASSES)


def robust_settled(before: Solution, after: Solution, number: int) -> bool:
    """Whether another robust pass would change nothing.

    `before` and `after` the pass of that number, from 1 on.
    """
    if number <= HUBER_PASSES:
        return False
    std = np.sqrt(np.maximum(np.diag(after.covariance), 0.0))
    return bool(np.all(np.abs(after.theta - before.theta) <= ROBUST_SETTLED * std))


def _moments(piece: Rows, label: str, weights: Weights | None = None) -> Moments:
    moments = Moments.like(piece, label)
    moments.add(piece, weights)
    return moments


def collinearity(x: FloatArray) -> FloatArray:
    """Square root of each column's variance inflation factor.

    Parameters
    ----------
    x : (N, p) array

    Returns
    -------
    (p,) array
        1 where a column is orthogonal to all others, infinite where it is zero or lies in
        their span.
    """
    norms = np.linalg.norm(x, axis=0)
    result = np.full(x.shape[1], np.inf)
    used = norms > 0.0
    if not used.any():
        return result
    _, singular, rows = np.linalg.svd(x[:, used] / norms[used], full_matrices=False)
    inverse = 1.0 / np.maximum(singular, 1e-12 * singular[0])
    result[used] = np.linalg.norm(rows.T * inverse, axis=1)
    result[result > 1e9] = np.inf
    return result
