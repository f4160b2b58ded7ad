"""Joining topics by stamp: duplicates, gaps, contiguous stretches, latched spans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.series import Series
from hydro_msgs_docs.cdr import FloatArray, IntArray

BoolArray = NDArray[np.bool_]

#: Behind a gap stamps are late, and stay late, by more than this many periods; those that follow
#: a late stamp make up for it. No shorter interval can hold a gap, even if both its ends jitter.
_LATE, _WIDE = 0.5, 1.25
#: Stamps to either side whose median says how late they are. With jitter of a fifth of a period
#: the two medians differ by half a period once in a million times.
_AROUND = 25
#: A command this far from 0 V asks for motion; the applied voltage may follow it this many
#: cycles later. A shorter disagreement is delay, not a latch.
_COMMANDED_V = 1e-3
_FOLLOW_CYCLES = 3


@dataclass(frozen=True, slots=True)
class Gap:
    """Cycles that are missing between two stamps.

    Attributes
    ----------
    after_ns, before_ns : int
        Stamps of the last cycle before and of the first behind the gap.
    missing : int
        Number of cycles that should lie between them.
    """

    after_ns: int
    before_ns: int
    missing: int


@dataclass(frozen=True, slots=True)
class LongestGap:
    """The longest of some gaps, as it is told.

    Attributes
    ----------
    after_s : float
        From the first stamp to the last one before the gap.
    length_s : float
        From there to the first one behind it.
    missing : int
        Number of cycles that should lie between them.
    """

    after_s: float
    length_s: float
    missing: int

    @property
    def text(self) -> str:
        """How long and when, for a table."""
        return f"{self.length_s:.3f} s at {self.after_s:.3f} s"


def longest_gap(gaps: Sequence[Gap], first_ns: int) -> LongestGap | None:
    """The longest gap; None where there is none.

    Parameters
    ----------
    gaps : sequence of Gap
    first_ns : int
        The first stamp.
    """
    if not gaps:
        return None
    gap = max(gaps, key=lambda one: one.before_ns - one.after_ns)
    after_s, length_s = (gap.after_ns - first_ns) * 1e-9, (gap.before_ns - gap.after_ns) * 1e-9
    return LongestGap(after_s, length_s, gap.missing)


@dataclass(frozen=True, slots=True)
class Topic:
    """A series in order of its stamps, each stamp once.

    Attributes
    ----------
    series : Series
    stamp_ns : (U,) int64 array
        Strictly increasing.
    row : (U,) int array
        Row of `series` per stamp: the first message that carried it.
    duplicates : int
        Messages whose stamp had been there before.
    disordered : int
        Messages with a stamp older than that of a message before.
    """

    series: Series
    stamp_ns: IntArray
    row: IntArray
    duplicates: int
    disordered: int

    @staticmethod
    def of(series: Series) -> Topic:
        """Sort and thin out a series."""
        stamp_ns, row = np.unique(series.stamp_ns, return_index=True)
        first = np.sort(row)
        ordered = series.stamp_ns[first]
        disordered = int(np.sum(ordered < np.maximum.accumulate(ordered)))
        duplicates = len(series) - len(stamp_ns)
        return Topic(series, stamp_ns, row.astype(np.int64), duplicates, disordered)

    def values(self, field: str) -> FloatArray:
        """A field in order of the stamps, (U, k)."""
        return self.series.fields[field][self.row]


def join(
    grid: IntArray, topic: Topic | None, names: Sequence[str] | None, field: str
) -> FloatArray | None:
    """One field of a topic on the grid.

    Parameters
    ----------
    grid : (N,) int64 array
    topic : Topic or None
    names : sequence of str, or None
        Entries wanted, in order; None for types without names: every column.
    field : str

    Returns
    -------
    (N, k) array or None
        NaN where an entry or a stamp is missing; None where there is no value at all.
    """
    if topic is None or field not in topic.series.fields:
        return None
    values = topic.series.fields[field]
    at = np.minimum(np.searchsorted(topic.stamp_ns, grid), len(topic.stamp_ns) - 1)
    there = topic.stamp_ns[at] == grid
    rows = topic.row[at[there]]
    if names is None:
        columns, wanted = list(range(values.shape[1])), list(range(values.shape[1]))
    else:
        known = topic.series.names
        wanted = [i for i, name in enumerate(names) if name in known]
        columns = [known.index(names[i]) for i in wanted]
    joined = np.full((len(grid), len(names) if names is not None else len(columns)), np.nan)
    joined[np.ix_(there, wanted)] = values[np.ix_(rows, columns)]
    return None if bool(np.isnan(joined).all()) else joined


def usual_period_s(stamp_ns: IntArray) -> float:
    """The period of stamps that come at one rate, missing ones and the clock's ticks apart.

    The median interval is a whole number of ticks, the mean of the intervals like it is not: a
    clock of 1 ms turns 300 Hz into intervals of 3, 3 and 4 ms.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Strictly increasing, at least two.

    Returns
    -------
    float
    """
    steps = np.diff(stamp_ns)
    median_ns = float(np.median(steps))
    return median_ns * 1e-9 * _usual(steps / median_ns)


def _usual(step: FloatArray) -> float:
    """Mean of intervals that are one period or about one, in such periods; 1 without any."""
    near = step[np.abs(step - 1.0) <= _LATE]
    return float(near.mean()) if near.size else 1.0


def find_gaps(stamp_ns: IntArray, period_s: float) -> tuple[Gap, ...]:
    """Where cycles are missing.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Strictly increasing.
    period_s : float

    Returns
    -------
    tuple of Gap
    """
    return tuple(
        Gap(int(stamp_ns[i]), int(stamp_ns[i + 1]), max(1, round(late)))
        for i, late in _late_from(stamp_ns, period_s)
    )


def _late_from(stamp_ns: IntArray, period_s: float) -> list[tuple[int, float]]:
    """Last stamps before gaps, and by how many periods all behind each is late."""
    step = np.diff(stamp_ns) / (period_s * 1e9)
    wide = np.flatnonzero(step > _WIDE)
    if not wide.size:
        return []
    # A period that is a little off would add up over the stamps that are looked at.
    late = (stamp_ns - stamp_ns[0]) / (period_s * 1e9) - _usual(step) * np.arange(len(stamp_ns))
    ahead = np.arange(1, _AROUND + 1)
    before = _medians(late, wide[:, None] + 1 - ahead)
    shift = _medians(late, wide[:, None] + ahead) - before
    wide = wide[shift > _LATE]
    gaps = []
    for i, following in pairwise([*wide.tolist(), len(late)]):
        first = max(0, i + 1 - _AROUND)
        before_it = float(np.median(late[first : i + 1]))
        # The next gap makes what is behind it later still, jitter a few stamps before it.
        behind = late[i + 1 : i + 1 + _AROUND]
        near = float(np.median(behind[: following - i]))
        by = min(near, float(np.median(behind))) - before_it
        if by > _LATE:
            late[first : i + 1] += by
            gaps.append((i, by))
    return gaps


def _medians(values: FloatArray, at: IntArray) -> FloatArray:
    """Medians of the values at each row of places, as far as these are within the array."""
    inside = (at >= 0) & (at < len(values))
    there = np.where(inside, values[np.clip(at, 0, len(values) - 1)], np.nan)
    return np.asarray(np.nanmedian(there, axis=1))


def contiguous(stamp_ns: IntArray, period_s: float) -> tuple[slice, ...]:
    """Stretches of cycles with none missing in between.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
    period_s : float

    Returns
    -------
    tuple of slice
    """
    edges = [0, *(i + 1 for i, _ in _late_from(stamp_ns, period_s)), len(stamp_ns)]
    return tuple(slice(a, b) for a, b in pairwise(edges) if b > a)


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of every run of True in a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def latched_cycles(
    count: int, applied_v: FloatArray | None, command_v: FloatArray | None
) -> NDArray[np.bool_]:
    """Cycles in which the gate held every valve at 0 V although motion was commanded.

    Parameters
    ----------
    count : int
        Number of cycles N.
    applied_v, command_v : (N, m) array or None
        From `/valve_state` and `/valve_command`; both are needed to tell.

    Returns
    -------
    (N,) bool array
        True in stretches of exact zeros that last longer than the delay from a command to its
        application, and in which a command was other than zero.
    """
    latched = np.zeros(count, dtype=np.bool_)
    if applied_v is None or command_v is None:
        return latched
    still = np.asarray((np.nan_to_num(applied_v, nan=1.0) == 0.0).all(axis=1), dtype=np.bool_)
    asked = np.asarray(np.any(np.abs(np.nan_to_num(command_v)) > _COMMANDED_V, axis=1))
    for begin, end in runs(still):
        # The last commands of a zero stretch are those that end it.
        denied = np.flatnonzero(asked[begin : max(begin, end - _FOLLOW_CYCLES)])
        if len(denied) >= _FOLLOW_CYCLES:
            latched[begin + int(denied[0]) : end] = True
    return latched
