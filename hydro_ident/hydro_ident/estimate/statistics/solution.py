"""Covariance of a linear estimate under autocorrelated noise.

    theta = A sum_g w_g Z_g' y_g,    A = (sum_g w_g Z_g' X_g)^-1,
    cov theta = A (sum_g w_g^2 Z_g' Omega_g Z_g) A'

(Z = X without instruments) where the noise of each channel is an autoregression, found from the
residuals u = e - X d, d = theta - truth. What the fitted parameters took out of the residuals is
given back to their products, so that their mean is the noise's own:

    U_ij = u_(t-i) u_(t-j) + 2 E[e_(t-i) x_(t-j) d] - tr(V x_(t-i)' x_(t-j)),  phi = U_11^-1 U_10

with V = cov theta, iterated; without it a short recording with long correlations looks whiter than
it is. Quantiles are Student's, with Satterthwaite's degrees of freedom for the uncertainty of phi
and of the noise's size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro_ident.errors import NotEnoughDataError
from hydro_ident.estimate.statistics.blocks import Blocks
from hydro_ident.estimate.statistics.lag_sums import autocovariance, shifted_autocovariances
from hydro_ident.estimate.statistics.noise_model import lag_products, noise_model, spread_products
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

_PASSES, _SETTLED = 200, 1.0e-12
#: Step of the differences by phi, as a share of the distance from the unit circle.
_SLOPE_STEP = 0.02
#: Sampling intervals that differ by less than this factor are of one rate.
_SAME_RATE = 1.1
#: More degrees of freedom are as good as a deviation that is known.
MOST_DOF = 1.0e6


@dataclass(frozen=True, slots=True)
class Solution:
    """Parameters and the noise that their covariance is for.

    Attributes
    ----------
    theta : (p,) array
    covariance : (p, p) array
    dof : (p,) array
        Degrees of freedom of the standard deviations.
    phi : (k, lags) array
        Noise model: noise is phi times its past plus white noise.
    variance : (G,) array
        Of that white noise, by group (recording and channel).
    level : (G,) array
        Standard deviation of the noise itself.
    weight : (G,) array
        Of the rows.
    residual_std : (k,) array
        Standard deviation of the noise of each channel over all recordings.
    """

    theta: FloatArray
    covariance: FloatArray
    dof: FloatArray
    phi: FloatArray
    variance: FloatArray
    level: FloatArray
    weight: FloatArray
    residual_std: FloatArray


@dataclass(frozen=True, slots=True)
class Estimator:
    """A linear estimator: ``theta - truth = left right' sum_g weight_g Z_g' e_g``.

    Columns of `left` and `right` are directions of the parameters, those of `weak` known so
    badly that sums of products have lost them. ``hat hat' = (sum_g weight_g Z_g' Z_g)^-1``,
    without these directions. `excess` is that of robust weights: noise of autocorrelation rho
    acts as one of rho + excess rho^3 (`hydro_ident.estimate.statistics.robust`).
    """

    theta: FloatArray
    left: FloatArray
    right: FloatArray
    weak: BoolArray
    weight: FloatArray
    hat: FloatArray
    excess: float = 0.0


def levels(unit: Blocks, theta: FloatArray) -> FloatArray:
    """Standard deviation of the residuals of each group, never quite zero."""
    squares = np.sum((unit.y[:, :, 0] - unit.x[:, :, 0] @ theta) ** 2, axis=1)
    level = np.sum(unit.y[:, :, 0] ** 2, axis=1)
    # A floor keeps exact data (algebraic tests, a constant channel) from an infinite weight.
    floor = np.where(level > 0.0, 1e-22 * level, unit.count)
    return np.asarray(np.sqrt(np.maximum(squares, floor) / np.maximum(unit.count, 1.0)))


def pooled_levels(unit: Blocks, theta: FloatArray) -> FloatArray:
    """Those of each group's channel over all recordings of one rate, (G,).

    A slow log, whose windows have errors of their own, is one of another rate.

    Parameters
    ----------
    unit : Blocks
    theta : (p,) array
    """
    own, pool = levels(unit, theta), _pools(unit)
    squares, count = (np.bincount(pool, v) for v in (own**2 * unit.count, unit.count))
    return np.asarray(np.sqrt(squares / np.maximum(count, 1.0))[pool])


def _pools(unit: Blocks) -> NDArray[np.intp]:
    """Numbers of the groups' pools: channel and rate, as far as rates are clearly apart."""
    if unit.sample_s is None:
        return unit.channel
    rates, place = np.unique(unit.sample_s, return_inverse=True)
    apart = rates[1:] > _SAME_RATE * rates[:-1]
    return np.asarray(unit.channel + unit.channels * np.append(0, np.cumsum(apart))[place])


def with_noise(unit: Blocks, estimator: Estimator, far: FloatArray) -> Solution:
    """Noise model and covariance of an estimate, each from the other until they stay.

    Parameters
    ----------
    unit : Blocks
    estimator : Estimator
    far : (G, nodes, p, p) array
        Sums by lag of the regressors, or of the instruments.

    Returns
    -------
    Solution

    Raises
    ------
    NotEnoughDataError
        Numbers are so far apart that there is no covariance.
    """
    variance = levels(unit, estimator.theta) ** 2
    seen = lag_products(unit, estimator.theta)
    shares = _shares(unit, estimator, far)
    turned = _turned(estimator, far)
    phi, variance = noise_model(unit, seen, variance)
    products, lags = seen, seen.shape[1]
    for _ in range(_PASSES):
        before = phi
        rho = np.array([shifted_autocovariances(row, lags) for row in phi])[unit.channel]
        covariance = _covariance(estimator, turned, rho[:, 0], variance)
        products = seen + _taken(unit, covariance, shares, rho, variance)
        phi, variance = noise_model(unit, products, variance)
        if np.max(np.abs(phi - before), initial=0.0) < _SETTLED:
            break
    covariance = _covariance(estimator, turned, _correlation(unit, phi), variance)
    dof = _degrees_of_freedom(unit, estimator, turned, (phi, variance), products)
    squares, count = np.maximum(products, seen)[:, 0, 0], np.maximum(unit.count, 1.0)
    by_channel = [np.bincount(unit.channel, v, unit.channels) for v in (squares, count)]
    residual = np.sqrt(by_channel[0] / np.maximum(by_channel[1], 1.0))
    level = np.sqrt(squares / count)
    return Solution(
        estimator.theta, covariance, dof, phi, variance, level, estimator.weight, residual
    )


def _shares(unit: Blocks, estimator: Estimator, far: FloatArray) -> FloatArray:
    """Sums by lag of ``w x_t A z_s'``, (G, nodes): what a row's noise does to the fit of others.

    With instruments of the regressors' projection on these, ``x_t = z_t (Z'Z)^-1 Z'X``; what is
    left of them, their own noise, has no part in the mean.
    """
    hat = estimator.hat
    inner = np.einsum("pi,gbpq,qi->gb", hat, far, hat, optimize=True)
    # Robust weights, which `far` has on both sides, are taken off the one that are residuals.
    full = estimator.weight * unit.count / unit.effective
    return np.asarray(inner * full[:, None])


def _turned(estimator: Estimator, far: FloatArray) -> FloatArray:
    """Sums by lag in the estimator's directions, each a row: (G, nodes, p p)."""
    turned = estimator.right.T @ far @ estimator.right
    return np.asarray(turned.reshape(*turned.shape[:2], -1))


def _taken(
    unit: Blocks,
    covariance: FloatArray,
    shares: FloatArray,
    rho: FloatArray,
    variance: FloatArray,
) -> FloatArray:
    """What the fit took out of the residuals' products, in the mean, (G, L, L).

    `rho` (G, L, nodes) are the noise's autocovariances at shifted lags.
    """
    spread = spread_products(unit, covariance)
    cross = variance[:, None] * (rho @ shares[:, :, None])[..., 0]
    distance = np.abs(np.subtract.outer(np.arange(rho.shape[1]), np.arange(rho.shape[1])))
    return np.asarray(2.0 * cross[:, distance] - spread)


def _correlation(unit: Blocks, phi: FloatArray) -> FloatArray:
    """Autocovariance of the noise of each group, of unit white noise: (G, nodes)."""
    return np.array([autocovariance(row) for row in phi])[unit.channel]


def _covariance_by_group(
    estimator: Estimator, turned: FloatArray, correlation: FloatArray, variance: FloatArray
) -> FloatArray:
    """What the noise of each group adds to cov theta, (G, p, p)."""
    correlation = correlation + estimator.excess * correlation**3 / correlation[:, :1] ** 2
    scale = estimator.weight**2 * variance
    flat = (scale[:, None] * correlation)[:, None] @ turned
    middle = flat.reshape(len(flat), *estimator.right.shape)
    if estimator.weak.any():
        middle[:, estimator.weak] = 0.0
        middle[:, :, estimator.weak] = 0.0
        most = np.max(np.diagonal(middle, axis1=1, axis2=2), axis=1)
        middle[:, estimator.weak, estimator.weak] = most[:, None]
    return np.asarray(estimator.left @ middle @ estimator.left.T)


def _covariance(
    estimator: Estimator, turned: FloatArray, correlation: FloatArray, variance: FloatArray
) -> FloatArray:
    total = _covariance_by_group(estimator, turned, correlation, variance).sum(axis=0)
    total = 0.5 * (total + total.T)
    if not np.isfinite(total).all():
        raise NotEnoughDataError(
            "least squares: expected a finite covariance of the parameters, found one that is not:"
            " some reading is too far beyond the others"
        )
    # Lags beyond the longest are cut off, which leaves a little less than a covariance.
    values, vectors = np.linalg.eigh(total)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _degrees_of_freedom(
    unit: Blocks,
    estimator: Estimator,
    turned: FloatArray,
    noise: tuple[FloatArray, FloatArray],
    products: FloatArray,
) -> FloatArray:
    """Satterthwaite: twice the squared variance over the variance of the variance, (p,)."""
    phi, variance = noise
    by_group = _covariance_by_group(estimator, turned, _correlation(unit, phi), variance)
    own = np.diagonal(by_group, axis1=1, axis2=2)
    freedom = np.maximum(unit.count / unit.stride, 1.0)
    uncertain = np.einsum("gi,g->i", own**2, 2.0 / freedom)
    for k in range(unit.channels):
        chosen = unit.channel == k
        pooled = np.einsum("gij,g->ij", products[chosen], 1.0 / (variance[chosen] * unit.stride))
        precision = np.linalg.pinv(pooled[1:, 1:], rcond=1e-13, hermitian=True)
        roots = np.abs(np.roots(np.concatenate([[1.0], -phi[k]])))
        step = _SLOPE_STEP * max(1.0 - float(np.max(roots, initial=0.0)), 1e-6)
        slopes = []
        for lag in range(phi.shape[1]):
            sides = []
            for sign in (1.0, -1.0):
                moved = phi.copy()
                moved[k, lag] += sign * step
                rho = _correlation(unit, moved)
                shifted = _covariance_by_group(estimator, turned, rho, variance)
                sides.append(np.diagonal(shifted.sum(axis=0)))
            slopes.append((sides[0] - sides[1]) / (2.0 * step))
        slope = np.array(slopes).reshape(phi.shape[1], own.shape[1])
        uncertain += np.einsum("li,lj,ji->i", slope, precision, slope)
    size = np.sum(own, axis=0) ** 2
    share = uncertain / np.where(size > 0.0, size, 1.0)
    return np.asarray(np.clip(2.0 / np.maximum(share, 1e-9), 1.0, MOST_DOF))
