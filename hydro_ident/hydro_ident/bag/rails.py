"""Supply and tank between their readings: followed over short pauses, unknown in long ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_model.arrays import BoolArray, FloatArray, IntArray

#: A rail goes with pump and accumulator, over tenths of a second: between readings further apart
#: than this a straight line may miss what it did.
LONGEST_S = 0.3


def between_readings(values: FloatArray, stamp_ns: IntArray) -> FloatArray:
    """A rail in every cycle.

    Parameters
    ----------
    values : (N,) array
        NaN where there is no reading; at least one is needed.
    stamp_ns : (N,) int64 array

    Returns
    -------
    (N,) array
        Straight from reading to reading, held before the first and behind the last.
    """
    at, known = stamp_ns - stamp_ns[0], np.isfinite(values)
    return np.asarray(np.interp(at, at[known], values[known]))


def silence_s(values: FloatArray, period_s: float) -> FloatArray:
    """How long a rail was not read for around every cycle.

    Parameters
    ----------
    values : (N,) array
        NaN where there is no reading.
    period_s : float

    Returns
    -------
    (N,) array
        Recorded time from the reading before to the one behind, to the cycle itself where there
        is none; 0 in cycles with a reading, infinite where there is no reading at all. A pause of
        the whole recording is no silence of a rail.
    """
    cycle, read = np.arange(values.size), np.flatnonzero(np.isfinite(values))
    if not read.size:
        return np.full(values.size, np.inf)
    behind = read[np.minimum(np.searchsorted(read, cycle), read.size - 1)]
    before = read[np.maximum(np.searchsorted(read, cycle, side="right") - 1, 0)]
    return np.asarray((np.maximum(behind, cycle) - np.minimum(before, cycle)) * period_s)


@dataclass(slots=True)
class Silence:
    """The longest time without a reading of a rail whose cycles come stretch by stretch.

    Attributes
    ----------
    met : int
        Cycles so far; to begin with, those that were over before the rail was there.
    """

    met: int = 0
    _last: int | None = None
    _longest: int = 0

    def add(self, values: FloatArray) -> None:
        """Take in the next cycles, (N,); NaN where there is no reading."""
        read = self.met + np.flatnonzero(np.isfinite(values))
        self.met += values.size
        if read.size:
            before = read[0] if self._last is None else self._last
            # Up to the first reading all cycles are silent.
            first = int(read[0]) if self._last is None else 0
            apart = np.diff(np.concatenate([[before], read]))
            silent = int(apart[apart > 1].max(initial=0))
            self._longest, self._last = max(self._longest, silent, first), int(read[-1])

    def longest_s(self, period_s: float) -> float:
        """As the largest of `silence_s` over all cycles, s; `period_s` is theirs."""
        if self._last is None:
            return float(np.inf) if self.met else 0.0
        return max(self._longest, self.met - 1 - self._last) * period_s


def followed(values: FloatArray | None, count: int, period_s: float) -> BoolArray:
    """In which cycles a rail is known, where it was recorded: pauses are short.

    Parameters
    ----------
    values : (count,) array or None
        As read, NaN between readings; None: never.
    count : int
        Of cycles.
    period_s : float

    Returns
    -------
    (count,) bool array
    """
    if values is None:
        return np.ones(count, dtype=np.bool_)
    return np.asarray(silence_s(values, period_s) <= LONGEST_S)
