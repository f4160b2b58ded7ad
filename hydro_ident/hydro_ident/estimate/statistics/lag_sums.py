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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.statistics.rows import nonzero_columns
from hydro_model.arrays import BoolArray
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
def _hats() -> Any:
    """How lags (columns) are shared out to nodes (rows), as means over each node's lags.

    Sparse: a lag falls to no more than two nodes.
    """
    from scipy.sparse import csr_array

    lags = np.arange(float(LONGEST))
    ends = np.append(NODES, LONGEST)
    hats = np.array([np.interp(lags, ends, row) for row in np.eye(NODES.size, ends.size)])
    return csr_array(hats / hats.sum(axis=1, keepdims=True))


def autocovariance(phi: FloatArray) -> FloatArray:
    """Autocovariance at the nodes of an autoregression of white noise of unit variance.

    Of the lags that a node stands for, the mean: noise that swings quicker than nodes lie apart
    has none there.

    Parameters
    ----------
    phi : (lags,) array
        Stationary: ``e_t = phi_1 e_(t-1) + ... + w_t``.

    Returns
    -------
    (nodes,) array
        The Yule-Walker equations give the first, the recursion itself the others.
    """
    return np.asarray(shifted_autocovariances(phi, 1)[0])


def shifted_autocovariances(phi: FloatArray, shifts: int) -> FloatArray:
    """As `autocovariance`, at lags 0, 1, ... further on one side and nearer on the other.

    Parameters
    ----------
    phi : (lags,) array
    shifts : int
        How many, at most `lags` + 1.

    Returns
    -------
    (shifts, nodes) array
        Means of both sides.
    """
    series = _series(tuple(phi.tolist()))
    further, nearer = _both_sides(shifts)
    return np.asarray((_hats() @ (0.5 * (series[further] + series[nearer]))).T)


@lru_cache(maxsize=8)
def _both_sides(shifts: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Lags further and nearer by each shift, (LONGEST, shifts)."""
    lags, by = np.arange(LONGEST)[:, None], np.arange(shifts)
    return lags + by, np.abs(lags - by)


@lru_cache(maxsize=64)
def _series(phi: tuple[float, ...]) -> FloatArray:
    """Autocovariance at every lag, and at as many beyond the longest as there are coefficients."""
    from scipy.signal import lfilter

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
        # What `scipy.signal.lfiltic` makes of the past, which takes as long as all else here.
        past = first[::-1][:order]
        memory = np.array([-filter_[m + 1 :] @ past[: order - m] for m in range(order)])
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
    white : bool
        Noise is taken for white: products with rows further back are not gathered.
    """

    channels: int
    width: int
    stride: int = 1
    white: bool = False
    _by_channel: tuple[_ChannelSums, ...] = field(init=False)

    def __post_init__(self) -> None:
        self._by_channel = tuple(
            _ChannelSums(self.stride, self.white) for _ in range(self.channels)
        )

    def add(
        self, x: FloatArray, skipped: int, known: BoolArray, nonzero: BoolArray | None = None
    ) -> None:
        """Take in rows that follow each other.

        Parameters
        ----------
        x : (T, k, p) array
        skipped : int
            Rows that are missing between the last call's and these.
        known : (T, k) bool array
            Which rows take part.
        nonzero : (k, p) bool array, optional
            Columns that may be other than zero, where the caller has looked already.
        """
        values = x if known.all() else np.where(known[..., None], x, 0.0)
        if nonzero is None:
            nonzero = nonzero_columns(values)
        gap = min(skipped, LONGEST * self.stride)
        for k, one in enumerate(self._by_channel):
            one.widen(nonzero[k])
            one.add(values[:, k, one.used], gap)

    @property
    def total(self) -> FloatArray:
        """Symmetric sums by channel and node, (k, nodes, p, p)."""
        sums = np.zeros((self.channels, NODES.size, self.width, self.width))
        for own, one in zip(sums, self._by_channel, strict=True):
            own[:, one.used[:, None], one.used] = one.total
        return sums + sums.swapaxes(2, 3)


@dataclass(slots=True)
class _ChannelSums:
    """Sums by lag of a channel, of the columns that are not zero all along.

    A joint's row is zero for what lies nearer to the base, and for others' friction.
    """

    stride: int
    white: bool
    used: NDArray[np.intp] = field(init=False)
    _sums: FloatArray = field(init=False)
    _before: list[FloatArray] = field(init=False)
    _waiting: list[FloatArray] = field(init=False, default_factory=list)
    _held: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.used = np.zeros(0, dtype=np.intp)
        self._sums = np.zeros((NODES.size, 0, 0))
        self._before = [np.zeros((_SINGLE, 0))] * (_OCTAVES + 1)

    def widen(self, nonzero: BoolArray) -> None:
        """Make room for columns (p,) that were zero so far."""
        wider = nonzero.copy()
        wider[self.used] = True
        used = np.flatnonzero(wider)
        if used.size == self.used.size:
            return
        at = np.searchsorted(used, self.used)
        sums = np.zeros((NODES.size, used.size, used.size))
        sums[:, at[:, None], at] = self._sums
        self.used, self._sums = used, sums
        self._before, self._waiting = (
            [_spread(part, at, used.size) for part in parts]
            for parts in (self._before, self._waiting)
        )

    def add(self, rows: FloatArray, gap: int) -> None:
        """Take in rows (T, p) of the used columns, so many behind those before."""
        if self.white:
            self._sums[0] += 0.5 * (rows.T @ rows)
            return
        if gap and (self._held or self.used.size):
            self._waiting.append(np.zeros((gap, self.used.size)))
            self._held += gap
        self._waiting.append(rows)
        self._held += len(rows)
        batch = _BATCH * self.stride
        if self._held < batch:
            return
        # Whole batches, whatever the calls were: blocks and the sums' rounding are the same, too.
        waiting = np.concatenate(self._waiting)
        while len(waiting) >= batch:
            if self.used.size:
                self._sums += _node_products(waiting[:batch], self._before, self.stride)
            waiting = waiting[batch:]
        self._waiting, self._held = [waiting.copy()], len(waiting)

    @property
    def total(self) -> FloatArray:
        """Sums by node, (nodes, p, p); their halves where symmetric."""
        if not self._held or not self.used.size:
            return self._sums
        rest = np.concatenate(self._waiting)
        missing = -len(rest) % (self.stride << _OCTAVES)
        rest = np.concatenate([rest, np.zeros((missing, rest.shape[1]))])
        return self._sums + _node_products(rest, list(self._before), self.stride)


def _spread(rows: FloatArray, at: NDArray[np.intp], width: int) -> FloatArray:
    """Rows with their columns put at these places of more."""
    result = np.zeros((len(rows), width))
    result[:, at] = rows
    return result


def _added_up(rows: FloatArray, count: int) -> FloatArray:
    """Sums of so many rows at a time; added by slices, numpy's sum over few rows is slow."""
    result = rows[::count]
    for at in range(1, count):
        result = result + rows[at::count]
    return result


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
        rows = _added_up(rows, 2 if octave else stride)
        blocks = np.concatenate([old, rows])
        for lag in _lags(octave):
            result[node] = rows.T @ blocks[_SINGLE - lag : len(blocks) - lag]
            node += 1
        if octave < _OCTAVES:
            # Of the last lag every other pair is eight blocks of the next octave apart: these
            # are the others, shared out to the node before.
            result[node - 1] += rows[1::2].T @ blocks[1 : len(blocks) - _SINGLE + 1][1::2]
        before[octave] = blocks[-_SINGLE:].copy()
    result[0] *= 0.5
    return result
