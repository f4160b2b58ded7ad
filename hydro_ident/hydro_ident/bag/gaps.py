"""Where cycles are missing, and the period of those that are there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from hydro_ident.bag.intervals import NEAR
from hydro_model.arrays import FloatArray, IntArray

#: Behind a gap stamps are late, and stay late, by more than this many periods; those that follow
#: a late stamp make up for it. No shorter interval can hold a gap, even if both its ends jitter.
_LATE, _WIDE = 0.5, 1.25
#: Stamps to either side whose median says how late they are. With jitter of a fifth of a period
#: the two medians differ by half a period once in a million times.
_AROUND = 25


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

    @property
    def length_ns(self) -> int:
        """From one stamp to the other."""
        return self.before_ns - self.after_ns


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
    return median_ns * 1e-9 * (_usual_ns(steps, median_ns) / median_ns)


def _usual_ns(steps: IntArray, about_ns: float) -> float:
    """As of `Intervals`, to the last digit, of intervals that are all in memory."""
    near = steps[np.abs(steps / about_ns - 1.0) <= NEAR]
    return int(near.sum()) / near.size if near.size else about_ns


@dataclass(slots=True)
class GapFinder:
    """Finds gaps among stamps that come stretch by stretch.

    Parameters
    ----------
    period_s : float
    usual_ns : float
        Mean of the intervals that are about one period: one that is a little off would add up
        over the stamps that are looked at.
    """

    period_s: float
    usual_ns: float
    _first_ns: int = 0
    _stamps: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    #: By how many periods each stamp is late, as it came and with the gaps before made up for.
    _late: FloatArray = field(default_factory=lambda: np.zeros(0))
    _made_up: FloatArray = field(default_factory=lambda: np.zeros(0))
    #: Of the first stamp that is held, and of the first interval that was not judged.
    _held: int = 0
    _next: int = 0

    def add(self, stamp_ns: IntArray) -> list[tuple[int, Gap]]:
        """Take in the next stamps.

        Parameters
        ----------
        stamp_ns : (N,) int64 array
            Strictly increasing, behind those that came before.

        Returns
        -------
        list of (int, Gap)
            The gaps that are certain by now, each behind the stamp of which number.
        """
        if not stamp_ns.size:
            return []
        met = self._held + len(self._stamps)
        if not met:
            self._first_ns = int(stamp_ns[0])
        period_ns = self.period_s * 1e9
        counted = np.arange(met, met + len(stamp_ns))
        late = (stamp_ns - self._first_ns) / period_ns - self.usual_ns / period_ns * counted
        self._stamps = np.concatenate([self._stamps, stamp_ns])
        self._late = np.concatenate([self._late, late])
        self._made_up = np.concatenate([self._made_up, late])
        # The last gap before and the first behind must be known, and how late stamps are there.
        found = self._judged(met + len(stamp_ns) - 2 * _AROUND - 2)
        self._forget()
        return found

    def finish(self) -> list[tuple[int, Gap]]:
        """The gaps among the last stamps."""
        return self._judged(self._held + len(self._stamps) - 1)

    def _judged(self, end: int) -> list[tuple[int, Gap]]:
        """The gaps in intervals up to one."""
        begin, end = self._next - self._held, end - self._held
        if end <= begin:
            return []
        self._next = self._held + end
        late, count = self._late, len(self._late)
        steps = np.diff(self._stamps[begin:]) / (self.period_s * 1e9)
        wide = begin + np.flatnonzero(steps > _WIDE)
        if not wide.size or wide[0] >= end:
            return []
        ahead = np.arange(1, _AROUND + 1)
        shift = _medians(late, wide[:, None] + ahead)
        shift -= _medians(late, wide[:, None] + 1 - ahead)
        wide = wide[shift > _LATE]
        gaps = []
        for i, following in pairwise([*wide.tolist(), count]):
            if i >= end:
                break
            first = max(0, i + 1 - _AROUND)
            before_it = float(np.median(self._made_up[first : i + 1]))
            # The next gap makes what is behind it later still, jitter a few stamps before it.
            behind = late[i + 1 : i + 1 + _AROUND]
            near = float(np.median(behind[: following - i]))
            by = min(near, float(np.median(behind))) - before_it
            if by > _LATE:
                self._made_up[first : i + 1] += by
                ends = int(self._stamps[i]), int(self._stamps[i + 1])
                gaps.append((self._held + i, Gap(*ends, max(1, round(by)))))
        return gaps

    def _forget(self) -> None:
        past = max(0, self._next - self._held - _AROUND)
        self._held += past
        self._stamps = self._stamps[past:].copy()
        self._late = self._late[past:].copy()
        self._made_up = self._made_up[past:].copy()


def _medians(values: FloatArray, at: IntArray) -> FloatArray:
    """Medians of the values at each row of places, as far as these are within the array."""
    inside = (at >= 0) & (at < len(values))
    there = np.where(inside, values[np.clip(at, 0, len(values) - 1)], np.nan)
    return np.asarray(np.nanmedian(there, axis=1))


@dataclass(slots=True)
class GapCount:
    """Some gaps in figures.

    Attributes
    ----------
    count, missing : int
        Gaps, and cycles missing in them.
    longest : Gap or None
        The first of the longest ones.
    """

    count: int = 0
    missing: int = 0
    longest: Gap | None = None

    def add(self, gaps: Iterable[Gap]) -> None:
        """Count gaps."""
        for gap in gaps:
            self.count += 1
            self.missing += gap.missing
            if self.longest is None or gap.length_ns > self.longest.length_ns:
                self.longest = gap

    def told(self, first_ns: int) -> LongestGap | None:
        """The longest gap; None where there is none.

        Parameters
        ----------
        first_ns : int
            The first stamp.
        """
        gap = self.longest
        if gap is None:
            return None
        return LongestGap((gap.after_ns - first_ns) * 1e-9, gap.length_ns * 1e-9, gap.missing)


def longest_gap(gaps: Sequence[Gap], first_ns: int) -> LongestGap | None:
    """The longest gap; None where there is none.

    Parameters
    ----------
    gaps : sequence of Gap
    first_ns : int
        The first stamp.
    """
    counted = GapCount()
    counted.add(gaps)
    return counted.told(first_ns)


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
    return tuple(gap for _, gap in _found(stamp_ns, period_s))


def _found(stamp_ns: IntArray, period_s: float) -> list[tuple[int, Gap]]:
    steps = np.diff(stamp_ns)
    if not (steps / (period_s * 1e9) > _WIDE).any():
        return []
    finder = GapFinder(period_s, _usual_ns(steps, period_s * 1e9))
    return [*finder.add(stamp_ns), *finder.finish()]


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
    edges = [0, *(i + 1 for i, _ in _found(stamp_ns, period_s)), len(stamp_ns)]
    return tuple(slice(a, b) for a, b in pairwise(edges) if b > a)
