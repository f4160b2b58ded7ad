"""Weighted least squares over several channels, with errors that respect autocorrelation.

Residuals of a crane are strongly autocorrelated: with the iid formula, nominal 95 % intervals
cover 15-52 % of the true values. The covariance here is the sandwich
``H^-1 (sum of lagged products of scores) H^-1`` with the Bartlett kernel (Newey and West,
Econometrica 55, 1987), whose bandwidth follows from the residuals' own correlation time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro_ident.errors import IdentError
from hydro_model.robot import FloatArray

BoolArray = NDArray[np.bool_]
#: y, x with gaps set to zero, and what was measured.
_Clean = tuple[FloatArray, FloatArray, BoolArray]

#: Reweighting passes: the weights settle to 1e-9 well before.
_PASSES = 10


@dataclass(frozen=True, slots=True)
class Rows:
    """Regression rows of one contiguous piece of recording.

    Attributes
    ----------
    y : (T, k) array
        One column per channel; NaN where a channel was not measured.
    x : (T, k, p) array
        Regressors of each channel.
    time_s : (T,) array
        Within the recording.
    label : str
        Where the rows come from.
    """

    y: FloatArray
    x: FloatArray
    time_s: FloatArray
    label: str = ""

    def take(self, index: BoolArray) -> Rows:
        """The rows of a mask."""
        return Rows(self.y[index], self.x[index], self.time_s[index], self.label)


@dataclass(frozen=True, slots=True)
class Fit:
    """Outcome of `weighted_least_squares`.

    Attributes
    ----------
    theta : (p,) array
    covariance : (p, p) array
        Autocorrelation-consistent.
    channel_std : (k,) array
        Residual standard deviation per channel, whose inverse is the channel's weight.
    collinearity : (p,) array
        Factor by which a parameter's error grows because its column resembles the others
        (square root of the variance inflation); infinite for a column of zeros.
    bandwidth : int
        Rows over which residuals were taken to be correlated.
    rows : int
        Measured rows used, all channels together.
    """

    theta: FloatArray
    covariance: FloatArray
    channel_std: FloatArray
    collinearity: FloatArray
    bandwidth: int
    rows: int

    @property
    def std(self) -> FloatArray:
        """Standard deviations, shape (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def weighted_least_squares(pieces: Sequence[Rows]) -> Fit:
    """Least squares stacked over pieces and channels, each channel weighted by its residual.

    Parameters
    ----------
    pieces : sequence of Rows
        Correlation is counted within a piece, never across two.

    Returns
    -------
    Fit

    Raises
    ------
    IdentError
        There are fewer measured rows than parameters.
    """
    clean = [_without_gaps(piece) for piece in pieces]
    channels, size = clean[0][1].shape[1:]
    count = np.sum([measured.sum(axis=0) for _, _, measured in clean], axis=0)
    if count.sum() <= size:
        raise IdentError(f"{int(count.sum())} rows cannot determine {size} parameters")
    std = np.ones(channels)
    theta = np.zeros(size)
    for _ in range(_PASSES):
        theta = _solve(clean, std)
        std = _channel_std(clean, theta, count, size)
    stacked = np.concatenate([(x / std[:, None]).reshape(-1, size) for _, x, _ in clean])
    covariance, bandwidth = _covariance(clean, theta, std, stacked)
    return Fit(theta, covariance, std, collinearity(stacked), bandwidth, int(count.sum()))


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


def integrated_correlation(residual: FloatArray) -> float:
    """Integrated autocorrelation time in samples, cut at the first lag that turns negative.

    Parameters
    ----------
    residual : (T,) array

    Returns
    -------
    float
        ``1 + 2 sum rho_k``; 1 for white noise.
    """
    count = residual.size
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if count < 4 or power == 0.0:
        return 1.0
    spectrum = np.abs(np.fft.rfft(centred, 2 * count)) ** 2
    rho = np.fft.irfft(spectrum)[:count] / power
    negative = np.flatnonzero(rho < 0.0)
    stop = int(negative[0]) if negative.size else count
    return float(1.0 + 2.0 * rho[1:stop].sum())


def _without_gaps(piece: Rows) -> _Clean:
    measured: BoolArray = np.isfinite(piece.y) & np.isfinite(piece.x).all(axis=2)
    y = np.where(measured, piece.y, 0.0)
    x = np.where(measured[..., None], piece.x, 0.0)
    return y, x, measured


def _solve(clean: Sequence[_Clean], std: FloatArray) -> FloatArray:
    size = clean[0][1].shape[2]
    x = np.concatenate([(x / std[:, None]).reshape(-1, size) for _, x, _ in clean])
    y = np.concatenate([(y / std).ravel() for y, _, _ in clean])
    # Unit columns: the parameters span ten orders of magnitude, the conditioning must not.
    norms = np.linalg.norm(x, axis=0)
    norms[norms == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(x / norms, y, rcond=1e-12)[0] / norms)


def _channel_std(
    clean: Sequence[_Clean],
    theta: FloatArray,
    count: FloatArray,
    size: int,
) -> FloatArray:
    squares = np.sum([((y - x @ theta) ** 2).sum(axis=0) for y, x, _ in clean], axis=0)
    level = np.sum([(y**2).sum(axis=0) for y, _, _ in clean], axis=0)
    freedom = np.maximum(count - size / count.size, 1.0)
    # A floor keeps exact data (algebraic tests, a channel not measured) from an infinite weight.
    floor = np.where(level > 0.0, 1e-18 * level / np.maximum(count, 1.0), 1.0)
    return np.asarray(np.sqrt(np.maximum(squares / freedom, floor)))


def _covariance(
    clean: Sequence[_Clean],
    theta: FloatArray,
    std: FloatArray,
    stacked: FloatArray,
) -> tuple[FloatArray, int]:
    size = theta.size
    norms = np.linalg.norm(stacked, axis=0)
    norms[norms == 0.0] = 1.0
    scores: list[FloatArray] = []
    taus: list[float] = []
    for y, x, _ in clean:
        residual = (y - x @ theta) / std
        scores.append(np.einsum("tk,tkp->tp", residual, x / std[:, None]) / norms)
        taus.extend(integrated_correlation(r) for r in residual.T)
    bandwidth = max(2, int(np.ceil(2.0 * max(taus))))
    middle = np.zeros((size, size))
    for score in scores:
        # Sums over a sliding window, squared, are the Bartlett-weighted lagged products.
        window = min(bandwidth, score.shape[0])
        total = np.cumsum(np.pad(score, ((window, window), (0, 0))), axis=0)
        sums = total[window:] - total[:-window]
        middle += sums.T @ sums / window
    unit = stacked / norms
    bread = np.linalg.pinv(unit.T @ unit, rcond=1e-14, hermitian=True)
    scale = np.outer(norms, norms)
    return bread @ middle @ bread / scale, bandwidth
