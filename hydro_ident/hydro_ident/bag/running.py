"""Figures of columns that come stretch by stretch, the same however they are cut."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hydro_model.arrays import BoolArray, FloatArray, IntArray


def _none(width: int) -> FloatArray:
    return np.full(width, np.nan)


@dataclass(slots=True)
class Sums:
    """Sums of columns to twice the digits of a float, so that no cut shows in them.

    Parameters
    ----------
    width : int
        Number of columns.
    """

    width: int
    _high: FloatArray = field(init=False)
    _low: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self._high, self._low = np.zeros(self.width), np.zeros(self.width)

    def add(self, values: FloatArray) -> None:
        """Take in rows, (N, width); NaN counts as 0."""
        rest = np.where(np.isnan(values), 0.0, values)
        low = self._low.copy()
        # What overflows has no lower half.
        with np.errstate(invalid="ignore", over="ignore"):
            while len(rest) > 1:
                half = len(rest) // 2
                total, lost = _sum(rest[:half], rest[half : 2 * half])
                low += lost.sum(axis=0)
                rest = np.concatenate([total, rest[2 * half :]])
            if len(rest):
                self._high, lost = _sum(self._high, rest[0])
                self._low = low + lost

    @property
    def total(self) -> FloatArray:
        """The sums, (width,)."""
        with np.errstate(invalid="ignore"):
            both = self._high + self._low
        return np.where(np.isfinite(both), both, self._high)


def _sum(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sum of two, and what rounding took of it."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


@dataclass(slots=True)
class Spans:
    """What columns go through.

    Parameters
    ----------
    width : int
        Number of columns.

    Attributes
    ----------
    finite : (width,) int array
        Finite samples.
    low, high : (width,) array
        Of the finite samples; NaN without any.
    least, most : (width,) array
        Of all that are a number, infinite ones among them; NaN without any.
    """

    width: int
    finite: IntArray = field(init=False)
    low: FloatArray = field(init=False)
    high: FloatArray = field(init=False)
    least: FloatArray = field(init=False)
    most: FloatArray = field(init=False)
    _sums: Sums = field(init=False)

    def __post_init__(self) -> None:
        self.finite = np.zeros(self.width, dtype=np.int64)
        self.low, self.high = _none(self.width), _none(self.width)
        self.least, self.most = _none(self.width), _none(self.width)
        self._sums = Sums(self.width)

    def add(self, values: FloatArray) -> None:
        """Take in rows, (N, width)."""
        if not len(values):
            return
        there = np.isfinite(values)
        whole = bool(there.all())
        known = values if whole else np.where(there, values, np.nan)
        self.finite += there.sum(axis=0)
        low, high = _ends(known)
        least, most = (low, high) if whole else _ends(values)
        self.low, self.high = np.fmin(self.low, low), np.fmax(self.high, high)
        self.least, self.most = np.fmin(self.least, least), np.fmax(self.most, most)
        self._sums.add(known)

    @property
    def there(self) -> BoolArray:
        """Columns in which some sample is a number."""
        return np.asarray(~np.isnan(self.least))

    @property
    def mean(self) -> FloatArray:
        """Of the finite samples; NaN without any."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self._sums.total / np.where(self.finite > 0, self.finite, np.nan))


def _ends(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    # Along rows that lie side by side it takes a fraction of the time.
    columns = np.ascontiguousarray(values.T)
    return np.fmin.reduce(columns, axis=1), np.fmax.reduce(columns, axis=1)


@dataclass(slots=True)
class Held:
    """The longest stretch of one signal in which all readings are alike.

    Attributes
    ----------
    longest : int
        Readings that repeat the one before; 0 without any.
    since_ns : int
        Stamp of the first of these.
    """

    longest: int = 0
    since_ns: int = 0
    _last: float = np.nan
    #: Of the stretch that goes on: repetitions, those that were driven, the first one's stamp.
    _open: tuple[int, int, int] = (0, 0, 0)

    def add(self, values: FloatArray, stamp_ns: IntArray, driven: BoolArray | None = None) -> None:
        """Take in the next readings.

        Parameters
        ----------
        values : (N,) array
        stamp_ns : (N,) int64 array
        driven : (N,) bool array, optional
            A stretch counts only if most of it was driven.
        """
        if not values.size:
            return
        # No number repeats nothing, an infinite one neither.
        with np.errstate(invalid="ignore"):
            same = np.diff(values, prepend=self._last) == 0.0
        self._last = float(values[-1])
        edges = np.flatnonzero(np.diff(np.concatenate(([0], same.astype(np.int8), [0]))))
        begins, ends = edges[::2], edges[1::2]
        count = np.zeros(len(same) + 1, dtype=np.int64)
        count[1:] = np.cumsum(same if driven is None else driven)
        length, times = ends - begins, count[ends] - count[begins]
        since = stamp_ns[begins]
        if begins.size and begins[0] == 0 and self._open[0]:
            length[0], times[0] = length[0] + self._open[0], times[0] + self._open[1]
            since[0] = self._open[2]
        else:
            self._close(*self._open)
        self._open = (0, 0, 0)
        if begins.size and ends[-1] == len(same):
            self._open = int(length[-1]), int(times[-1]), int(since[-1])
            length, times, since = length[:-1], times[:-1], since[:-1]
        most = np.flatnonzero(times > 0.5 * length)
        if most.size:
            at = most[np.argmax(length[most])]
            self._close(int(length[at]), int(times[at]), int(since[at]))

    def finish(self) -> None:
        """No more readings come."""
        self._close(*self._open)

    def _close(self, length: int, times: int, since_ns: int) -> None:
        if times > 0.5 * length and length > self.longest:
            self.longest, self.since_ns = length, since_ns
