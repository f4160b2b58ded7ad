"""Autoregressive noise of each channel, and what a fit says about it.

The steps that `hydro_ident.estimate.statistics.regression` iterates.
"""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.statistics.blocks import Blocks
from hydro_model.robot import FloatArray

#: Roots of the noise model are kept inside this circle: noise is stationary, if barely.
_LARGEST_ROOT = 0.998
#: Residuals below this share of the data (some newtons of a crane's forces, less than any
#: transducer resolves) are the equations' own, in which no noise model is to be found.
_EXACT = 1.0e-4
_RIDGE = 1.0e-7
#: Singular values below this share of the largest are none.
RANK = 1.0e-11


def lag_products(unit: Blocks, theta: FloatArray) -> FloatArray:
    """Sums of products of the residuals and their lags, (G, L, L)."""
    residual = unit.y - unit.x @ theta
    return np.asarray(residual.transpose(0, 2, 1) @ residual)


def spread_products(unit: Blocks, spread: FloatArray) -> FloatArray:
    """Expected products of ``x (theta - truth)`` and its lags, (G, L, L).

    `spread` (p, p) is the covariance of the parameters.
    """
    # Rows of x times a root of the covariance: trace(V x_i' x_j) without forming products of x.
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    taken = unit.x @ root
    flat = taken.transpose(0, 2, 1, 3).reshape(*taken.shape[::2], -1)
    return np.asarray(flat @ flat.transpose(0, 2, 1))


def noise_model(
    unit: Blocks, products: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Autoregression of each channel over all recordings, and variance of each group.

    `products` (G, L, L) as of `lag_products`.
    """
    lags = products.shape[1] - 1
    phi = np.zeros((unit.channels, lags))
    level = np.sum(unit.y[:, :, 0] ** 2, axis=1)
    for k in range(unit.channels):
        chosen = unit.channel == k
        pooled = np.einsum("gij,g->ij", products[chosen], 1.0 / variance[chosen])
        if lags and pooled[0, 0] > _EXACT**2 * level[chosen] @ (1.0 / variance[chosen]):
            # Rows are smoother than their products' digits: white noise of no size is added.
            past = pooled[1:, 1:] + _RIDGE * pooled[0, 0] * np.eye(lags)
            phi[k] = _stable(np.linalg.solve(past, pooled[1:, 0]))
    return phi, group_variance(unit, products, phi)


def group_variance(unit: Blocks, products: FloatArray, phi: FloatArray) -> FloatArray:
    """Variance of the white noise behind each group, (G,).

    `products` (G, L, L) as of `lag_products`, `phi` (k, lags) the autoregressions.
    """
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
