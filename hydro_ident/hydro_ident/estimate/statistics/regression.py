"""Least squares with plain weights: ordinary, weighted by residuals, or with instruments.

The noise model (`hydro_ident.estimate.statistics.solution`) never weighs the rows: as soon as
physics is left out of the model, weights by the residuals' autocorrelation let the noise model
take the slow forces for itself. It enters the covariance alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.statistics.blocks import Blocks, unit_columns
from hydro_ident.estimate.statistics.noise_model import RANK
from hydro_ident.estimate.statistics.solution import (
    Estimator,
    Solution,
    levels,
    pooled_levels,
    with_noise,
)
from hydro_model.robot import FloatArray

__all__ = [
    "Solution",
    "instrumental_parameters",
    "misfit",
    "plain_parameters",
    "solve_iv",
    "solve_ols",
    "solve_wls",
    "stacked_columns",
]

_Solve = Callable[[Blocks, FloatArray], Estimator]

#: Passes that find the size of each channel's residual.
_WEIGHT_PASSES = 6
#: Directions with singular values below this share are lost in sums of products: their errors
#: are the textbook's, as much wider as those of the other directions are at most.
_WEAK = 1.0e-5


def solve_wls(blocks: Blocks, excess: float = 0.0) -> Solution:
    """Every channel of every recording weighted by its residual (`_recording_weights`).

    Parameters
    ----------
    blocks : Blocks
    excess : float
        Of robust weights (`hydro_ident.estimate.statistics.robust`).

    Returns
    -------
    Solution
    """
    unit, norms = unit_columns(blocks)
    estimator = _least_squares(unit, _recording_weights(unit, _least_squares))
    return _scaled(with_noise(unit, replace(estimator, excess=excess), unit.far), norms)


def solve_ols(blocks: Blocks) -> Solution:
    """Every row alike."""
    unit, norms = unit_columns(blocks)
    estimator = _least_squares(unit, np.ones(len(unit.labels)))
    return _scaled(with_noise(unit, estimator, unit.far), norms)


def solve_iv(blocks: Blocks, excess: float = 0.0) -> Solution:
    """Instruments instead of regressors in the normal equations, weights by the residuals.

    What the regressors' own noise adds to X'X, and so pulls the parameters towards zero, is not
    in Z'X.

    Parameters
    ----------
    blocks : Blocks
    excess : float
        Of robust weights (`hydro_ident.estimate.statistics.robust`).

    Raises
    ------
    IdentError
        The blocks carry no instruments.
    """
    unit, norms = unit_columns(blocks)
    if unit.z is None or unit.far_z is None:
        raise IdentError("no instruments: expected recorded joint references")
    estimator = _instrumental(unit, _recording_weights(unit, _instrumental))
    return _scaled(with_noise(unit, replace(estimator, excess=excess), unit.far_z), norms)


def _recording_weights(unit: Blocks, solve: _Solve) -> FloatArray:
    """Weights by residuals, (G,): of channels as they settle, of recordings once.

    Weights by each recording's own residual feed on themselves as soon as physics is left out: the
    recording that is fitted a little better gains weight, until the others count for nothing (two
    loads at the tip), and one at rest, which shows hardly any of it, takes all. So a recording is
    weighed by what is left of it where all of its channel and rate count alike: a noisier one
    counts less, and none decides alone.
    """
    theta = _least_squares(unit, np.ones(len(unit.labels))).theta
    for _ in range(_WEIGHT_PASSES - 1):
        theta = solve(unit, 1.0 / pooled_levels(unit, theta) ** 2).theta
    return np.asarray(1.0 / levels(unit, theta) ** 2)


def plain_parameters(blocks: Blocks, weight: FloatArray) -> FloatArray:
    """Least squares parameters under given weights of the groups."""
    unit, norms = unit_columns(blocks)
    return _least_squares(unit, weight).theta / norms


def instrumental_parameters(blocks: Blocks, weight: FloatArray) -> FloatArray:
    """Those by instruments, under given weights of the groups.

    Raises
    ------
    IdentError
        The blocks carry no instruments.
    """
    unit, norms = unit_columns(blocks)
    return _instrumental(unit, weight).theta / norms


def misfit(blocks: Blocks, weight: FloatArray) -> tuple[float, float]:
    """Least sum of weighted squares, and that of y alone.

    `weight` is that of each row.
    """
    unit, _ = unit_columns(blocks)
    x, y = _stacked(unit, weight)
    theta = np.linalg.lstsq(x, y, rcond=RANK)[0]
    return float(np.sum((y - x @ theta) ** 2)), float(y @ y)


def stacked_columns(blocks: Blocks, residual_std: FloatArray) -> FloatArray:
    """The design of all rows, each channel in units of its residual: (G m, p), as collinear."""
    std = np.where(residual_std > 0.0, residual_std, 1.0)[blocks.channel]
    return np.asarray(blocks.x[:, :, 0] / std[:, None, None]).reshape(-1, blocks.x.shape[3])


def _stacked(unit: Blocks, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    root = np.sqrt(weight)
    own_x, own_y = unit.rows
    x = (own_x * root[:, None, None]).reshape(-1, own_x.shape[2])
    return x, (own_y * root[:, None]).ravel()


def _least_squares(unit: Blocks, weight: FloatArray) -> Estimator:
    x, y = _stacked(unit, weight)
    left, singular, right = np.linalg.svd(x, full_matrices=False)
    kept = singular > RANK * singular[0]
    inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
    root = right.T * inverse
    weak = singular < _WEAK * singular[0]
    return Estimator(root @ (left.T @ y), root, root, weak, weight, root[:, ~weak])


def _instrumental(unit: Blocks, weight: FloatArray) -> Estimator:
    z = unit.instruments
    if z is None:
        raise IdentError("no instruments: expected columns that stand for the regressors")
    x, y = unit.rows
    cross = np.einsum("g,gmp,gmq->pq", weight, z, x, optimize=True)
    level = np.einsum("g,gmp,gm->p", weight, z, y, optimize=True)
    inward, singular, outward = np.linalg.svd(cross)
    weak = singular <= _WEAK**2 * singular[0]
    inverse = np.where(weak, 0.0, 1.0 / np.where(weak, 1.0, singular))
    theta = outward.T @ (inverse * (inward.T @ level))
    stacked = (z * np.sqrt(weight)[:, None, None]).reshape(-1, cross.shape[0])
    _, own, directions = np.linalg.svd(stacked, full_matrices=False)
    strong = own > _WEAK * own[0]
    hat = directions[strong].T / own[strong]
    return Estimator(theta, outward.T * inverse, inward, weak, weight, hat)


def _scaled(solution: Solution, norms: FloatArray) -> Solution:
    covariance = solution.covariance / np.outer(norms, norms)
    return replace(solution, theta=solution.theta / norms, covariance=covariance)
