"""Sums of the products of a channel's rows with those before them, by lag, in flat memory.

What autocorrelated noise e does to a least squares estimate is the covariance of X'e,

    cov(X'e) = sum over t, s of gamma(t - s) x_t' x_s = sum over lags j of gamma_j C_j,
    C_j = sum over t of x_t' x_(t-j) + x_(t-j)' x_t   (half of it at lag 0)

with the noise's autocovariance gamma. The C_j know nothing of the noise: gathered once, they serve
any noise model. Between a few nodes gamma is taken as straight, so that a C per node is enough.

The further back, the coarser the nodes may lie: rows are added up over blocks, twice as long from
one octave of lags to the next, and blocks are multiplied in the place of rows. A pair of rows
whose lag is not a whole number of blocks falls to either of the two nodes beside it, as it lies in
its blocks: of many pairs, to each in the share that a straight line between them gives.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from hydro_ident.estimate.rows import BoolArray
from hydro_model.robot import FloatArray

#: Lags kept one by one, in strides (`Rows.stride`); an octave of blocks has half as many.
_SINGLE = 16
#: Octaves behind them.
_OCTAVES = 7
#: Longest lag, in strides: noise that remembers further is drift.
LONGEST = _SINGLE << _OCTAVES
#: Rows that are worked on at once, in strides: whole blocks of every octave.
_BATCH = 1024


def _lags(octave: int) -> range:
    """Lags in blocks of an octave that are nodes: what is nearer lies in the octave before.

    The last lag of all octaves but the last is no node: half of its pairs are the next octave's,
    and a straight line from the node before it to the next octave's first gives that the others.
    """
    return range(_SINGLE // 2 if octave else 0, _SINGLE - (octave < _OCTAVES))


#: Lags at which sums are kept, in strides.
NODES = np.array([k << n for n in range(_OCTAVES + 1) for k in _lags(n)], dtype=float)


@lru_cache(maxsize=1)
def _hats() -> FloatArray:
    """How lags (columns) are shared out to nodes (rows), as means over each node's lags."""
    lags = np.arange(float(LONGEST))
    ends = np.append(NODES, LONGEST)
    hats = np.array([np.interp(lags, ends, row) for row in np.eye(NODES.size, ends.size)])
    means: FloatArray = hats / hats.sum(axis=1, keepdims=True)
    means.flags.writeable = False
    return means


def autocovariance(phi: FloatArray, shift: int = 0) -> FloatArray:
    """Autocovariance at the nodes of an autoregression of white noise of unit variance.

    Of the lags that a node stands for, the mean: noise that swings quicker than nodes lie apart
    has none there.

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
    series, at = _series(tuple(phi.tolist())), np.arange(LONGEST)
    return np.asarray(0.5 * _hats() @ (series[at + shift] + series[np.abs(at - shift)]))


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
    _before: list[FloatArray] = field(init=False)
    _used: BoolArray = field(init=False)
    _waiting: list[FloatArray] = field(init=False, default_factory=list)
    _held: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self._sums = np.zeros((self.channels, NODES.size, self.width, self.width))
        none = np.zeros((_SINGLE, self.channels, self.width))
        self._before = [none] * (_OCTAVES + 1)
        self._used = np.zeros((self.channels, self.width), dtype=np.bool_)

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
        if gap and (self._held or self._used.any()):
            self._waiting.append(np.zeros((gap, self.channels, self.width)))
            self._held += gap
        self._waiting.append(values)
        self._held += values.shape[0]
        batch = _BATCH * self.stride
        if self._held < batch:
            return
        # Whole batches, whatever the calls were: blocks and the sums' rounding are the same, too.
        waiting = np.concatenate(self._waiting)
        while waiting.shape[0] >= batch:
            self._before = self._take(self._sums, waiting[:batch])
            waiting = waiting[batch:]
        self._waiting, self._held = [waiting.copy()], waiting.shape[0]

    @property
    def total(self) -> FloatArray:
        """Symmetric sums by channel and node, (k, nodes, p, p)."""
        sums = self._sums.copy()
        if self._held:
            rest = np.concatenate(self._waiting)
            missing = -rest.shape[0] % (self.stride << _OCTAVES)
            self._take(sums, np.concatenate([rest, np.zeros((missing, *rest.shape[1:]))]))
        return sums + sums.swapaxes(2, 3)

    def _take(self, sums: FloatArray, rows: FloatArray) -> list[FloatArray]:
        """Add the products of new rows to some sums; the last blocks of every octave."""
        last = [np.zeros_like(before) for before in self._before]
        self._used |= rows.any(axis=0)
        for k in range(self.channels):
            # A joint's row is zero for what lies nearer to the base, and for others' friction.
            used = np.flatnonzero(self._used[k])
            if not used.size:
                continue
            before = [blocks[:, k][:, used] for blocks in self._before]
            products = _node_products(rows[:, k][:, used], before, self.stride)
            sums[k][:, used[:, None], used] += products
            for blocks, own in zip(last, before, strict=True):
                blocks[:, k, used] = own
        return last


def _node_products(rows: FloatArray, before: list[FloatArray], stride: int) -> FloatArray:
    """Products of new rows with all before them, (nodes, p, p); lag 0 by half.

    Parameters
    ----------
    rows : (T, p) array
        Whole blocks of every octave.
    before : list of (_SINGLE, p) array
        The last blocks of every octave; those of the new rows take their place.
    """
    width = rows.shape[1]
    result, node = np.zeros((NODES.size, width, width)), 0
    for octave, old in enumerate(before):
        count = 2 if octave else stride
        rows = rows.reshape(-1, count, width).sum(axis=1)
        blocks = np.concatenate([old, rows])
        for lag in _lags(octave):
            result[node] += rows.T @ blocks[_SINGLE - lag : len(blocks) - lag]
            node += 1
        if octave < _OCTAVES:
            # Of the last lag every other pair is eight blocks of the next octave apart: these
            # are the others, shared out to the node before.
            result[node - 1] += rows[1::2].T @ blocks[1 : len(blocks) - _SINGLE + 1][1::2]
        before[octave] = blocks[-_SINGLE:]
    result[0] *= 0.5
    return result
