"""Sums of the products of a channel's rows with those before them, by lag, in flat memory.

What autocorrelated noise e does to a least squares estimate is the covariance of X'e,

    cov(X'e) = sum over t, s of gamma(t - s) x_t' x_s = sum over lags j of gamma_j C_j,
    C_j = sum over t of x_t' x_(t-j) + x_(t-j)' x_t   (half of it at lag 0)

with the noise's autocovariance gamma. The C_j know nothing of the noise: gathered once, they serve
any noise model. Between a few nodes gamma is taken as straight, so that a C per node is enough.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_model.robot import FloatArray

#: Longest lag, in strides (`Rows.stride`): noise that remembers further is drift.
LONGEST = 2048
#: Lags kept one by one, and growth from one node to the next behind them.
_SINGLE, _GROWTH = 16, 1.2
#: Rows that are worked on at once, in strides.
_BATCH = 1024


def _nodes() -> FloatArray:
    nodes = list(range(_SINGLE))
    while nodes[-1] < LONGEST - 1:
        nodes.append(min(LONGEST - 1, max(nodes[-1] + 1, round(nodes[-1] * _GROWTH))))
    return np.array(nodes, dtype=float)


#: Lags at which sums are kept, in strides.
NODES = _nodes()


def autocovariance(phi: FloatArray, shift: int = 0) -> FloatArray:
    """Autocovariance at the nodes of an autoregression of white noise of unit variance.

    Parameters
    ----------
    phi : (lags,) array
        Stationary: ``e_t = phi_1 e_(t-1) + ... + w_t``.
    shift : int
        At lags this much further on one side and nearer on the other, averaged; at most `lags`.

    Returns
    -------
    (nodes,) array
        The Yule-Walker equations give the first, the recursion itself the others.
    """
    series, at = _series(tuple(phi.tolist())), NODES.astype(int)
    return np.asarray(0.5 * (series[at + shift] + series[np.abs(at - shift)]))


@lru_cache(maxsize=64)
def _series(phi: tuple[float, ...]) -> FloatArray:
    """Autocovariance at every lag, and at as many beyond the longest as there are coefficients."""
    from scipy.signal import lfilter, lfiltic

    order = len(phi)
    matrix = np.zeros((order + 1, order + 1))
    for i in range(order + 1):
        matrix[i, i] += 1.0
        for j in range(1, order + 1):
            matrix[i, abs(i - j)] -= phi[j - 1]
    right = np.zeros(order + 1)
    right[0] = 1.0
    first = np.linalg.solve(matrix, right)
    rest = np.zeros(LONGEST - 1)
    if order:
        filter_ = np.array([1.0, *(-one for one in phi)])
        memory = lfiltic([1.0], filter_, first[::-1][:order])
        rest, _ = lfilter([1.0], filter_, rest, zi=memory)
    series = np.concatenate([first, rest])
    series.flags.writeable = False
    return series


@dataclass(slots=True)
class LagSums:
    """Sums by lag of one recording.

    Attributes
    ----------
    channels, width : int
        Shape of a row of regressors.
    stride : int
        Rows from one node of the noise model to the next (`Rows.stride`).
    """

    channels: int
    width: int
    stride: int = 1
    _sums: FloatArray = field(init=False)
    _tail: FloatArray = field(init=False)
    _waiting: list[FloatArray] = field(init=False, default_factory=list)
    _held: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._sums = np.zeros((self.channels, NODES.size, self.width, self.width))
        self._tail = np.zeros((0, self.channels, self.width))

    def add(self, x: FloatArray, skipped: int, known: BoolArray) -> None:
        """Take in rows that follow each other.

        Parameters
        ----------
        x : (T, k, p) array
        skipped : int
            Rows that are missing between the last call's and these.
        known : (T, k) bool array
            Which rows take part.
        """
        values = np.where(known[..., None], x, 0.0)
        gap = min(skipped, LONGEST * self.stride)
        if gap and (self._held or self._tail.shape[0]):
            self._waiting.append(np.zeros((gap, self.channels, self.width)))
            self._held += gap
        self._waiting.append(values)
        self._held += values.shape[0]
        batch = _BATCH * self.stride
        if self._held < batch:
            return
        # Whole batches, whatever the calls were: the sums' rounding is then the same, too.
        waiting = np.concatenate(self._waiting)
        while waiting.shape[0] >= batch:
            self._take(waiting[:batch])
            waiting = waiting[batch:]
        self._waiting, self._held = [waiting.copy()], waiting.shape[0]

    @property
    def total(self) -> FloatArray:
        """Symmetric sums by channel and node, (k, nodes, p, p)."""
        if self._held:
            self._take(np.concatenate(self._waiting))
        self._waiting, self._held = [], 0
        return self._sums

    def _take(self, fresh: FloatArray) -> None:
        past = np.concatenate([self._tail, fresh])
        before = self._tail.shape[0]
        now = past.copy()
        now[:before] = 0.0
        for k in range(self.channels):
            # A joint's row is zero for what lies nearer to the base, and for others' friction.
            used = np.flatnonzero(past[:, k].any(axis=0))
            if np.any(now[:, k]):
                own = _node_sums(now[:, k][:, used], past[:, k][:, used], self.stride)
                self._sums[k][:, used[:, None], used] += own
        keep = (LONGEST - 1) * self.stride
        self._tail = past[max(past.shape[0] - keep, 0) :]


def _node_sums(now: FloatArray, past: FloatArray, stride: int) -> FloatArray:
    """Symmetric sums of ``now_t' past_(t - j)`` over all lags, shared among the nodes."""
    from scipy.fft import irfft, next_fast_len, rfft

    rows, width = now.shape
    lags = min(rows, LONGEST * stride)
    size = next_fast_len(rows + lags, real=True)
    spectra = rfft(now, n=size, axis=0), rfft(past, n=size, axis=0)
    hats = _hats(lags, stride)
    result = np.zeros((NODES.size, width, width))
    for column in range(width):
        cross = spectra[0] * np.conj(spectra[1][:, column : column + 1])
        products = irfft(cross, n=size, axis=0)[:lags]
        # Lag 0 is its own mirror image.
        products[0] *= 0.5
        result[:, :, column] = hats @ products
    return result + result.transpose(0, 2, 1)


def _hats(lags: int, stride: int) -> FloatArray:
    """Weights (nodes, lags) by which values at lags in rows are shared among the nodes."""
    at = np.arange(float(lags)) / stride
    upper = np.minimum(np.searchsorted(NODES, at, side="right"), NODES.size - 1)
    share = (at - NODES[upper - 1]) / (NODES[upper] - NODES[upper - 1])
    weights = np.zeros((NODES.size, lags))
    index = np.arange(lags)
    weights[upper, index] = np.minimum(share, 1.0)
    weights[upper - 1, index] = np.maximum(1.0 - share, 0.0)
    return weights
