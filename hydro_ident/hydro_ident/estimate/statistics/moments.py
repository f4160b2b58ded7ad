"""Everything a regression needs of a recording, gathered row by row in flat memory.

Rows ``v_t = (z_t, x_t, y_t)`` are gathered together with those `lags` rows before them, as a
factor R of ``[v_t, v_(t-1) ..., v_(t-lags)]`` (`hydro_ident.estimate.statistics.lagged_rows`):
R'R are the sums of all their products, and R keeps the digits that the products would lose. Any
parameters, any weights and any filter of up to `lags` coefficients can be applied to R as to the
rows, so that one pass over a recording of any length serves every estimate that follows.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.statistics.lag_sums import LagSums
from hydro_ident.estimate.statistics.lagged_rows import LaggedRows
from hydro_ident.estimate.statistics.robust import Weights
from hydro_ident.estimate.statistics.rows import Rows, nonzero_columns
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

#: Order of the noise model: rows before a row that predict its noise.
LAGS = 3
#: Rows worked on at once: they fit a processor's cache.
_BATCH = 2048


@dataclass(slots=True)
class Moments:
    """Lagged square-root moments of one recording.

    Attributes
    ----------
    label : str
        Of the recording.
    channels : int
        Number k.
    width : int
        Entries of a row: instruments (where there are any), regressors, 1 for y.
    instruments : bool
    lags : int
        Order of the noise model; 0 takes the noise for white, whose intervals need no products
        with other rows.
    stride : int
        Rows from one lag to the next (`Rows.stride`).
    sample_s : float
        Sampling interval of the recording; 0 where it is of no matter.
    rows : (k,) int array
        Measured rows.
    lagged : (k,) array
        Rows with all their predecessors; none of them rejected by robust weights.
    own : (k, width, width) array or None
        With robust weights: triangular factor of the weighted rows alone, from which the
        parameters come; the noise is found in `factor`, whose rows are never weighted.
    effective : (k,) array
        Rows with all their predecessors, or the sum of their robust weights.
    far : LagSums
        Products of the regressors with those further back.
    far_z : LagSums or None
        The same of the instruments.
    """

    label: str
    channels: int
    width: int
    instruments: bool = False
    lags: int = LAGS
    stride: int = 1
    sample_s: float = 0.0
    rows: NDArray[np.intp] = field(init=False)
    lagged: FloatArray = field(init=False)
    own: FloatArray | None = field(init=False, default=None)
    effective: FloatArray = field(init=False)
    far: LagSums = field(init=False)
    far_z: LagSums | None = field(init=False, default=None)
    _lagged: tuple[LaggedRows, ...] = field(init=False)
    _tail: FloatArray = field(init=False)
    _tail_run: NDArray[np.intp] = field(init=False)
    _tail_s: float = field(init=False, default=-np.inf)

    def __post_init__(self) -> None:
        self._lagged = tuple(
            LaggedRows(self.width, self.lags, self.stride) for _ in range(self.channels)
        )
        self.rows = np.zeros(self.channels, dtype=np.intp)
        self.lagged, self.effective = np.zeros(self.channels), np.zeros(self.channels)
        size = (self.width - 1) // (2 if self.instruments else 1)
        self.far = LagSums(self.channels, size, self.stride, white=not self.lags)
        if self.instruments:
            self.far_z = LagSums(self.channels, size, self.stride, white=not self.lags)
        self._tail = np.zeros((self.lags * self.stride, self.channels, self.width))
        self._tail_run = np.zeros(self.channels, dtype=np.intp)

    @staticmethod
    def like(rows: Rows, label: str, lags: int = LAGS, sample_s: float = 0.0) -> Moments:
        """Empty moments for rows of this shape."""
        _, channels, size = rows.x.shape
        width = size * (1 if rows.z is None else 2) + 1
        return Moments(label, channels, width, rows.z is not None, lags, rows.stride, sample_s)

    @property
    def factor(self) -> FloatArray:
        """Of every channel: (k, m, m), m = (lags + 1) width; blocks of columns by lag."""
        return np.array([one.factor for one in self._lagged])

    def add(self, rows: Rows, weights: Weights | None = None) -> None:
        """Take in the next rows, in order of time.

        Parameters
        ----------
        rows : Rows
        weights : Weights, optional
            Robust weights by the residuals of an earlier fit.
        """
        if not rows.time_s.size:
            return
        joined, before = self._joined(rows), self.lags * self.stride
        values = joined[before:]
        known = _known(values)
        nonzero = nonzero_columns(values)
        run = _run_lengths(known, rows.follows(self._tail_s), self._tail_run)
        self.rows += known.sum(axis=0)
        weight = (run > before).astype(float)
        for k in range(self.channels):
            self._lagged[k].widen(nonzero[k])
            for begin in range(0, len(values), _BATCH):
                batch = slice(begin, begin + _BATCH)
                self._take(
                    joined[begin : begin + before + _BATCH, k], weight[batch, k], k, weights
                )
        weighted = values if weights is None else values * weight[..., None]
        self._take_far(weighted, weight, rows, nonzero)
        self._tail = joined[len(values) :].copy()
        self._tail_run = run[-1].copy()
        self._tail_s = float(rows.time_s[-1]) if rows.step_s else -np.inf

    def _joined(self, rows: Rows) -> FloatArray:
        """Instruments, regressors and y of new rows behind the last ones: (T', k, width)."""
        before = len(self._tail)
        joined = np.empty((before + rows.time_s.size, self.channels, self.width))
        joined[:before], joined[before:, :, -1] = self._tail, rows.y
        size = rows.x.shape[2]
        joined[before:, :, -1 - size : -1] = rows.x
        if rows.z is not None:
            joined[before:, :, :size] = rows.z
        return joined

    def _take(
        self, joined: FloatArray, weight: FloatArray, channel: int, weights: Weights | None
    ) -> None:
        """Take in rows of a channel where `weight` is 1; it becomes their robust weight."""
        chosen = weight > 0.0
        # Weights know no scale of a channel that gave the fit before not one row.
        if weights is not None and chosen.any():
            at = np.flatnonzero(chosen) + self.lags * self.stride  # `joined` begins with the tail
            block = np.stack([joined[at - n * self.stride] for n in range(self.lags + 1)], axis=1)
            weight[chosen], kept = weights.of(channel, self.label, block)
            if self.own is None:
                self.own = np.zeros((self.channels, self.width, self.width))
            weighted = block[:, 0] * np.sqrt(weight[chosen])[:, None]
            self.own[channel] = _stacked(self.own[channel], weighted)
            chosen[chosen] = kept
        self._lagged[channel].add(joined[self.lags * self.stride :], chosen)
        self.lagged[channel] += float(chosen.sum())
        self.effective[channel] += float(weight.sum())

    def _take_far(
        self, values: FloatArray, weight: FloatArray, rows: Rows, nonzero: BoolArray
    ) -> None:
        """The same rows, weighted alike, for the sums by lag; gaps keep their length."""
        size = rows.x.shape[2]
        own = slice(-1 - size, -1)
        before = np.concatenate([[self._tail_s], rows.time_s[:-1]])
        missing = np.zeros(rows.time_s.size)
        if rows.step_s:
            missing = np.round((rows.time_s - before) / rows.step_s) - 1.0
            missing = np.where(np.isfinite(missing), np.maximum(missing, 0.0), 0.0)
        starts = [0, *(np.flatnonzero(missing[1:] > 0.0) + 1).tolist()]
        for begin, end in zip(starts, [*starts[1:], rows.time_s.size], strict=True):
            part, skipped = values[begin:end], int(min(missing[begin], 1e9))
            known = weight[begin:end] > 0.0
            self.far.add(part[..., own], skipped, known, nonzero[:, own])
            if self.far_z is not None:
                self.far_z.add(part[..., :size], skipped, known, nonzero[:, :size])


def _known(values: FloatArray) -> BoolArray:
    """Which rows (T, k) of (T, k, width) are measured; the others are set to zero."""
    # Sums are quicker had than a look at every entry, and not finite where any entry is not.
    if np.isfinite(values.sum(axis=0)).all():
        return np.ones(values.shape[:2], dtype=np.bool_)
    known = np.asarray(np.isfinite(values).all(axis=2))
    values[~known] = 0.0
    return known


def _stacked(factor: FloatArray, rows: FloatArray) -> FloatArray:
    """The triangular factor of what was factorised and of more rows."""
    # Columns of zeros, of bodies nearer to the base and of others' friction, stay so.
    used = np.flatnonzero(rows.any(axis=0) | factor.any(axis=0))
    both = np.concatenate([factor[used[:, None], used], rows[:, used]])
    own = np.linalg.qr(both, mode="r")
    result = np.zeros_like(factor)
    result[used[: len(own), None], used] = own
    return result


def _run_lengths(
    known: BoolArray, linked: BoolArray, before: NDArray[np.intp]
) -> NDArray[np.intp]:
    """How many known rows in a row end at each row, per channel."""
    index = np.arange(1, known.shape[0] + 1)[:, None]
    # Row number after which the run of each row starts; `-before` continues the last piece's.
    start = np.full(known.shape, -np.inf)
    start[0] = -before if linked[0] else 0.0
    start = np.where(~linked[:, None], index - 1.0, start)
    start = np.where(~known, index.astype(float), start)
    return np.asarray(index - np.maximum.accumulate(start, axis=0), dtype=np.intp)
