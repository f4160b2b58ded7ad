"""Autoregressive noise of each channel, and what a fit says about it.

The steps of restricted maximum likelihood that `hydro_ident.estimate.regression` iterates.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.blocks import Blocks
from hydro_model.robot import FloatArray

#: Roots of the noise model are kept inside this circle: noise is stationary, if barely.
_LARGEST_ROOT = 0.9999
#: Residuals below this share of the data (some newtons of a crane's forces, less than any
#: transducer resolves) are the equations' own, in which no noise model is to be found.
_EXACT = 1.0e-4
#: Singular values below this share of the largest are none.
RANK = 1.0e-11


def whitened(values: FloatArray, phi: FloatArray) -> FloatArray:
    """Groups' values (G, m, L, ...) less what their past predicts, (G, m, ...)."""
    filters = np.concatenate([np.ones((phi.shape[0], 1)), -phi], axis=1)
    return np.asarray(np.einsum("gml...,gl->gm...", values, filters))


def lag_products(unit: Blocks, theta: FloatArray, spread: FloatArray) -> FloatArray:
    """Expected sums of products of the noise and its lags, (G, L, L)."""
    residual = unit.y - unit.x @ theta
    seen = residual.transpose(0, 2, 1) @ residual
    # Rows of x times a root of the covariance: trace(V x_i' x_j) without forming products of x.
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    taken = unit.x @ root
    flat = taken.transpose(0, 2, 1, 3).reshape(*taken.shape[::2], -1)
    return np.asarray(seen + flat @ flat.transpose(0, 2, 1))


def noise_model(
    unit: Blocks, products: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Autoregression of each channel over all recordings, and variance of each group."""
    lags = products.shape[1] - 1
    phi = np.zeros((unit.channels, lags))
    level = np.sum(unit.y[:, :, 0] ** 2, axis=1)
    for k in range(unit.channels):
        chosen = unit.channel == k
        pooled = np.einsum("gij,g->ij", products[chosen], 1.0 / variance[chosen])
        if lags and pooled[0, 0] > _EXACT**2 * level[chosen] @ (1.0 / variance[chosen]):
            phi[k] = _stable(np.linalg.lstsq(pooled[1:, 1:], pooled[1:, 0], rcond=1e-13)[0])
    return phi, group_variance(unit, products, phi)


def group_variance(unit: Blocks, products: FloatArray, phi: FloatArray) -> FloatArray:
    """Variance of the white noise behind each group, (G,)."""
    filters = np.concatenate([np.ones((unit.channels, 1)), -phi], axis=1)[unit.channel]
    power = np.einsum("gij,gi,gj->g", products, filters, filters)
    # A floor keeps exact data (algebraic tests, a constant channel) from an infinite weight.
    level = np.sum(unit.y[:, :, 0] ** 2, axis=1)
    floor = np.where(level > 0.0, 1e-22 * level, unit.count)
    freedom = np.maximum(unit.count - phi.shape[1], 1.0)
    return np.asarray(np.maximum(power, floor) / freedom)


def _stable(phi: FloatArray) -> FloatArray:
    """The same noise model with its roots inside the unit circle."""
    roots = np.roots(np.concatenate([[1.0], -phi]))
    largest = float(np.max(np.abs(roots), initial=0.0))
    if largest <= _LARGEST_ROOT:
        return phi
    return np.asarray(phi * (_LARGEST_ROOT / largest) ** np.arange(1, phi.size + 1))


def degrees_of_freedom(
    unit: Blocks, phi: FloatArray, variance: FloatArray, products: FloatArray
) -> FloatArray:
    """Satterthwaite: twice the squared variance over the variance of the variance, (p,)."""
    by_group = phi[unit.channel]
    x = whitened(unit.x, by_group)
    information = np.einsum("gmp,gmq,g->gpq", x, x, 1.0 / variance, optimize=True)
    spread = np.linalg.pinv(information.sum(axis=0), rcond=RANK**2, hermitian=True)
    own = np.einsum("ip,gpq,qi->gi", spread, information, spread, optimize=True)
    uncertain = np.einsum("gi,g->i", own**2, 2.0 * unit.stride / np.maximum(unit.count, 1.0))
    for k in range(unit.channels):
        chosen = np.flatnonzero(unit.channel == k)
        pooled = np.einsum("gij,g->ij", products[chosen], 1.0 / variance[chosen])
        precision = np.linalg.pinv(pooled[1:, 1:], rcond=1e-13, hermitian=True)
        past = np.einsum(
            "gmlp,gmq,g->lpq",
            unit.x[chosen][:, :, 1:],
            x[chosen],
            1.0 / variance[chosen],
            optimize=True,
        )
        slope = 2.0 * np.einsum("ip,lpq,qi->li", spread, past, spread, optimize=True)
        uncertain += np.einsum("li,lj,ji->i", slope, precision, slope)
    size = np.diag(spread) ** 2
    dof = 2.0 * size / np.maximum(uncertain, 1e-300)
    return np.asarray(np.clip(dof, 1.0, 1.0e6))
