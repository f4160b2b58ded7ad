"""Sums of products of a channel's rows with themselves and their predecessors, kept accurate.

Rows ``v_t`` and those just before them are almost copies of each other, and their columns almost
combinations of each other: plain sums of their products would lose the digits that tell them
apart. So products are of the rows ``q_t`` of the orthonormal factor of all rows so far, V = Q B,
where double precision is right to some 1e-15 of what every direction itself carries. Every batch
of rows V' turns it,

    [B; V'] = [K; Q'] B',   q -> q K,   M -> K' M K + products of Q' with its predecessors

with K, part of an orthonormal matrix, enlarging nothing. Factors of the rows with their
predecessors in place of sums are as accurate, at four times as many columns. Without predecessors
(noise taken for white) B alone is the answer.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray


@dataclass(slots=True)
class LaggedRows:
    """Products of one channel's rows v_t, v_(t-1) ... v_(t-lags), in flat memory.

    Attributes
    ----------
    width, lags : int
    stride : int
        Rows from one lag to the next (`Rows.stride`).
    """

    width: int
    lags: int
    stride: int
    _used: NDArray[np.intp] = field(init=False)
    _basis: FloatArray = field(init=False)
    _sums: FloatArray = field(init=False)
    _last: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self._used = np.zeros(0, dtype=np.intp)
        self._basis = np.zeros((0, 0))
        self._sums = np.zeros((self.lags + 1, 0, self.lags + 1, 0))
        self._last = np.zeros((self.lags * self.stride, 0))

    def widen(self, nonzero: BoolArray) -> None:
        """Make room for columns that the next rows have and those so far had not.

        Columns that were always zero, of bodies nearer to the base and of others' friction, take
        no time.

        Parameters
        ----------
        nonzero : (width,) bool array
        """
        wider = nonzero.copy()
        wider[self._used] = True
        used = np.flatnonzero(wider)
        if used.size == self._used.size:
            return
        at = np.searchsorted(used, self._used)
        basis = np.zeros((used.size, used.size))
        basis[at[:, None], at] = self._basis
        sums = np.zeros((self.lags + 1, used.size, self.lags + 1, used.size))
        sums[:, at[:, None], :, at] = self._sums.transpose(1, 3, 0, 2)
        last = np.zeros((len(self._last), used.size))
        last[:, at] = self._last
        self._used, self._basis, self._sums, self._last = used, basis, sums, last

    def add(self, rows: FloatArray, chosen: BoolArray) -> None:
        """Take in the next rows.

        Parameters
        ----------
        rows : (T, width) array
            Zero where none was measured.
        chosen : (T,) bool array
            Which of them count, with their predecessors.
        """
        width = self._used.size
        if not width:
            return
        if not self.lags:
            taken = rows[:, self._used] if chosen.all() else rows[chosen][:, self._used]
            factor = np.linalg.qr(np.concatenate([self._basis, taken]), mode="r")
            self._basis = np.asarray(factor)
            return
        q, self._basis = np.linalg.qr(np.concatenate([self._basis, rows[:, self._used]]))
        turn = q[:width]
        half = (self._sums @ turn).reshape(self.lags + 1, width, -1)
        self._sums = (turn.T @ half).reshape(self._sums.shape)
        joined = np.concatenate([self._last @ turn, q[width:]])
        self._sums += lag_products(joined, chosen, self.lags, self.stride)
        self._last = joined[len(rows) :].copy()

    @property
    def factor(self) -> FloatArray:
        """Rows with the same products, blocks of columns by lag: (m, m), m = (lags + 1) width."""
        lags = self.lags + 1
        size = lags * self._used.size
        if not self.lags:
            alone = np.zeros((self.width, self.width))
            alone[:size, self._used] = self._basis
            return alone
        root = _root(self._sums.reshape(size, size))
        result = np.zeros((lags * self.width, lags, self.width))
        by_lag = root.reshape(size, lags, self._used.size)
        result[:size, :, self._used] = by_lag @ self._basis
        return result.reshape(lags * self.width, lags * self.width)


def lag_products(rows: FloatArray, chosen: BoolArray, lags: int, stride: int) -> FloatArray:
    """Sums over the chosen rows t of ``rows_(t - a stride)' rows_(t - b stride)``.

    Those of lags a and a + d are those of lags 0 and d a few rows earlier: they are added up
    once, but for rows at the ends of what is chosen.

    Parameters
    ----------
    rows : (lags stride + T, p) array
    chosen : (T,) bool array
        Of all but the first rows.
    lags, stride : int

    Returns
    -------
    (lags + 1, p, lags + 1, p) array
    """
    first, width = lags * stride, rows.shape[1]
    result = np.empty((lags + 1, width, lags + 1, width))
    now = rows[first:] if chosen.all() else rows[first:] * chosen[:, None]
    # By row of `rows`, with as many behind the last as any lag reaches.
    counts = np.concatenate([np.zeros(first), chosen, np.zeros(first)])
    shifts = [counts[lag * stride :][: len(rows)] - counts[: len(rows)] for lag in range(lags + 1)]
    ends = [np.flatnonzero(shift) for shift in shifts]
    edges = [rows[at] * shift[at, None] for at, shift in zip(ends, shifts, strict=True)]
    for apart in range(lags + 1):
        products = now.T @ rows[first - apart * stride : len(rows) - apart * stride]
        for lag in range(lags + 1 - apart):
            both = products + edges[lag].T @ rows[ends[lag] - apart * stride]
            result[lag, :, lag + apart], result[lag + apart, :, lag] = both, both.T
    return result


def _root(products: FloatArray) -> FloatArray:
    """A matrix r with ``r'r = products`` (p, p), which need not have full rank."""
    size = np.sqrt(np.diagonal(products))
    size = np.where(size > 0.0, size, 1.0)
    factor, order, rank, _ = lapack.dpstrf(products / np.outer(size, size))
    result = np.zeros_like(products)
    result[:rank, order - 1] = np.triu(factor)[:rank]
    return result * size
