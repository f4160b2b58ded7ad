"""Generalised least squares on lagged moments, with intervals that hold.

Each channel's noise is an autoregression whose coefficients are fitted together with the
parameters by restricted maximum likelihood (REML). Its expectation-maximisation step adds to the
residuals' products what the fitted parameters have taken out of them, so that a short recording
with long correlations does not look whiter than it is:

    U_ij = u_(t-i) u_(t-j) + tr(V x_(t-i) x_(t-j)'),    phi = U_11^-1 U_10

with residuals u, regressors x and covariance V of the parameters. Quantiles are Student's, with
Satterthwaite's degrees of freedom for the uncertainty of phi and of the noise's size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.errors import IdentError
from hydro_ident.estimate.blocks import Blocks, unit_columns
from hydro_ident.estimate.noise_model import (
    RANK,
    degrees_of_freedom,
    group_variance,
    lag_products,
    noise_model,
    whitened,
)
from hydro_model.robot import FloatArray

_PASSES, _SETTLED = 100, 1.0e-10
#: Passes with white noise before that, which find the size of each channel's noise.
_WHITE_PASSES = 3
#: A share of the data in the residuals that a noise model is suspected to have taken.
_SWALLOWED = 0.05


@dataclass(frozen=True, slots=True)
class Solution:
    """Parameters and the noise they were fitted under.

    Attributes
    ----------
    theta : (p,) array
    covariance : (p, p) array
    dof : (p,) array
        Degrees of freedom of the standard deviations.
    phi : (k, lags) array
        Noise model: noise is phi times its past plus white noise.
    variance : (G,) array
        Of that white noise.
    residual_std : (k,) array
        Standard deviation of the residuals, before whitening.
    swallowed : bool
        The noise model explained what the regressors explain, too: plain weights were used.
    """

    theta: FloatArray
    covariance: FloatArray
    dof: FloatArray
    phi: FloatArray
    variance: FloatArray
    residual_std: FloatArray
    swallowed: bool = False


#: Parameters and covariance under a noise model: coefficients by channel, variance by group.
_Step = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def solve_gls(
    blocks: Blocks, variance_factor: float = 1.0, start: Solution | None = None
) -> Solution:
    """Parameters, covariance and noise model by iterated REML.

    Parameters
    ----------
    blocks : Blocks
    variance_factor : float
        Of robust weights.
    start : Solution, optional
        Of nearly the same blocks: its noise model is near.

    Returns
    -------
    Solution
    """
    unit, norms = unit_columns(blocks)

    def step(phi: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        scale = 1.0 / np.sqrt(variance)
        x = (whitened(unit.x, phi[unit.channel]) * scale[:, None, None]).reshape(-1, norms.size)
        y = (whitened(unit.y, phi[unit.channel]) * scale[:, None]).ravel()
        left, singular, right = np.linalg.svd(x, full_matrices=False)
        kept = singular > RANK * singular[0]
        inverse = np.where(kept, 1.0 / np.where(kept, singular, 1.0), 0.0)
        root = right.T * inverse
        return root @ (left.T @ y), root @ root.T

    found = _iterated(unit, step, variance_factor, start)
    phi, ones = np.zeros_like(found.phi), np.ones(len(unit.labels))
    theta, spread = step(phi, ones)
    for _ in range(_WHITE_PASSES):
        ones = group_variance(unit, lag_products(unit, theta, np.zeros_like(spread)), phi)
        theta, spread = step(phi, ones * variance_factor)
    if start is None and _swallowed(unit, found, theta):
        found = _bounded(unit, theta, spread, ones)
    return _scaled(found, norms)


def _swallowed(unit: Blocks, found: Solution, theta: FloatArray) -> bool:
    """Whether noise explains much of what the regressors alone explain far better.

    Noise in the regressors (poor encoders, outliers) shows most where motions are quick; a noise
    model smooth enough then takes the slow forces for itself and leaves the parameters at nothing.
    """
    count = np.bincount(unit.channel, unit.count, unit.channels)
    level = np.bincount(unit.channel, np.sum(unit.y[:, :, 0] ** 2, axis=1), unit.channels)
    errors = np.sum((unit.y[:, :, 0] - unit.x[:, :, 0] @ theta) ** 2, axis=1)
    plain = np.bincount(unit.channel, errors, unit.channels)
    left = found.residual_std**2 * count
    return bool(np.any((left > _SWALLOWED * level) & (left > 4.0 * plain)))


def _bounded(
    unit: Blocks, theta: FloatArray, spread: FloatArray, variance: FloatArray
) -> Solution:
    """Plain weights, with the widest errors that the residuals' autoregression allows.

    X'e varies at most as under white noise of the residuals' largest spectral density.
    """
    products = lag_products(unit, theta, np.zeros_like(spread))
    phi, white = noise_model(unit, products, variance)
    angles = np.exp(-1j * np.outer(np.linspace(0.0, np.pi, 513), np.arange(1, phi.shape[1] + 1)))
    peak = np.max(1.0 / np.abs(1.0 - angles @ phi.T) ** 2, axis=0)
    factor = float(np.max(peak[unit.channel] * white / variance)) * unit.stride
    count = np.bincount(unit.channel, unit.count, unit.channels)
    level = np.bincount(unit.channel, products[:, 0, 0], unit.channels)
    dof = np.full(theta.size, max(float(unit.count.sum()) / factor - theta.size, 1.0))
    residual = np.sqrt(level / np.maximum(count, 1.0))
    return Solution(theta, spread * factor, dof, phi, white, residual, swallowed=True)


def solve_iv(blocks: Blocks) -> Solution:
    """Parameters by instruments: ``sum Z'(y - X theta) = 0`` with everything whitened.

    What the regressors' own noise adds to X'X, and so pulls the parameters towards zero, is not
    in Z'X. Degrees of freedom are those of the same rows' least squares.
    """
    unit, norms = unit_columns(blocks)
    instruments = unit.z
    if instruments is None:
        raise IdentError("no instruments: expected recorded joint references")

    def step(phi: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        by_group = phi[unit.channel]
        x, y = whitened(unit.x, by_group), whitened(unit.y, by_group)
        z = whitened(instruments, by_group)
        weight = 1.0 / variance
        cross = np.einsum("g,gmp,gmq->pq", weight, z, x, optimize=True)
        inverse = np.linalg.pinv(cross, rcond=RANK)
        theta = inverse @ np.einsum("g,gmp,gm->p", weight, z, y, optimize=True)
        power = np.einsum("g,gmp,gmq->pq", weight, z, z, optimize=True)
        return theta, inverse @ power @ inverse.T

    return _scaled(_iterated(unit, step, 1.0), norms)


def solve_ols(blocks: Blocks) -> tuple[FloatArray, FloatArray]:
    """Parameters by least squares of the rows as they are, and ``(X'X)^-1``."""
    unit, norms = unit_columns(blocks)
    x = unit.x[:, :, 0].reshape(-1, norms.size)
    inverse = np.linalg.pinv(x, rcond=RANK)
    theta = inverse @ unit.y[:, :, 0].ravel()
    return theta / norms, (inverse @ inverse.T) / np.outer(norms, norms)


def whitened_squares(blocks: Blocks, phi: FloatArray, variance: FloatArray) -> tuple[float, float]:
    """Least sum of squares under a noise model, and that of y alone."""
    unit, norms = unit_columns(blocks)
    scale = 1.0 / np.sqrt(variance)
    x = (whitened(unit.x, phi[unit.channel]) * scale[:, None, None]).reshape(-1, norms.size)
    y = (whitened(unit.y, phi[unit.channel]) * scale[:, None]).ravel()
    theta = np.linalg.lstsq(x, y, rcond=RANK)[0]
    return float(np.sum((y - x @ theta) ** 2)), float(y @ y)


def stacked_columns(blocks: Blocks, residual_std: FloatArray) -> FloatArray:
    """The design of all rows, each channel in units of its residual: (G m, p), as collinear."""
    std = np.where(residual_std > 0.0, residual_std, 1.0)[blocks.channel]
    return np.asarray(blocks.x[:, :, 0] / std[:, None, None]).reshape(-1, blocks.x.shape[3])


def _scaled(solution: Solution, norms: FloatArray) -> Solution:
    covariance = solution.covariance / np.outer(norms, norms)
    return replace(solution, theta=solution.theta / norms, covariance=covariance)


def _iterated(
    unit: Blocks, step: _Step, variance_factor: float, start: Solution | None = None
) -> Solution:
    lags = unit.y.shape[2] - 1
    phi, variance = np.zeros((unit.channels, lags)), np.ones(len(unit.labels))
    factor = variance_factor * unit.stride
    if start is not None:
        phi, variance = start.phi, start.variance
    theta, spread = step(phi, variance * factor)
    for _ in range(_WHITE_PASSES if start is None else 0):
        seen = lag_products(unit, theta, np.zeros_like(spread))
        variance = group_variance(unit, seen, phi)
        theta, spread = step(phi, variance * factor)
    for _ in range(_PASSES):
        before = phi
        phi, variance = noise_model(unit, lag_products(unit, theta, spread), variance)
        theta, spread = step(phi, variance * factor)
        if np.max(np.abs(phi - before), initial=0.0) < _SETTLED:
            break
    products = lag_products(unit, theta, spread)
    level = np.bincount(unit.channel, products[:, 0, 0], unit.channels)
    count = np.bincount(unit.channel, unit.count, unit.channels)
    residual = np.sqrt(level / np.maximum(count, 1.0))
    dof = degrees_of_freedom(unit, phi, variance * factor, products)
    return Solution(theta, spread, dof, phi, variance, residual)
