"""Intervals between stamps, counted by their length: their median and mean, in flat memory.

Both are exact. A clock of nanoseconds gives no two intervals alike: where there are more lengths
than are kept, only those stay apart that may still decide, around the median and around the
bounds of what is taken for one period. The others are counted and summed between these.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hydro_ident.errors import IdentError
from hydro_model.arrays import IntArray

#: Intervals further from the usual one than this share of it are not taken for one period.
NEAR = 0.5
_MOST_LENGTHS = 1 << 15
_LEAST, _LARGEST = np.iinfo(np.int64).min, np.iinfo(np.int64).max


class UndecidedError(IdentError):
    """What was counted and summed only would have to be known apart."""


@dataclass(slots=True)
class Counts:
    """How often whole numbers came.

    Attributes
    ----------
    values : (K,) int64 array
        Increasing.
    counts : (K,) int64 array
    """

    values: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    counts: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def add(self, numbers: IntArray) -> None:
        """Take in numbers, (N,)."""
        if not numbers.size:
            return
        both = np.concatenate([self.values, numbers])
        weights = np.concatenate([self.counts, np.ones(numbers.size, dtype=np.int64)])
        self.values, where = np.unique(both, return_inverse=True)
        self.counts = np.zeros(self.values.size, dtype=np.int64)
        np.add.at(self.counts, where, weights)

    @property
    def size(self) -> int:
        """Of all numbers."""
        return int(self.counts.sum())

    @property
    def total(self) -> int:
        """Sum of all numbers."""
        return int((self.values * self.counts).sum())

    def median(self) -> float:
        """Median of all numbers; there must be one."""
        ends, size = np.cumsum(self.counts), self.size
        places = np.searchsorted(ends, [(size - 1) // 2, size // 2], side="right")
        return float(self.values[places].mean())


@dataclass(slots=True)
class Intervals:
    """Intervals between stamps.

    Attributes
    ----------
    most : int
        So many lengths are kept apart.
    """

    most: int = _MOST_LENGTHS
    _kept: Counts = field(default_factory=Counts)
    #: First and last length of each zone that is kept apart, and how many intervals lie before,
    #: between and behind the zones, and their sums.
    _zones: IntArray = field(default_factory=lambda: np.array([[_LEAST, _LARGEST]]))
    _many: list[int] = field(default_factory=lambda: [0, 0])
    _sums: list[int] = field(default_factory=lambda: [0, 0])

    def add(self, steps: IntArray) -> None:
        """Take in intervals.

        Parameters
        ----------
        steps : (N,) int64 array
            ns.

        Raises
        ------
        UndecidedError
            The lengths that came first do not tell about where the median lies.
        """
        if not steps.size:
            return
        self._put(steps, np.ones(steps.size, dtype=np.int64))
        while self._kept.values.size > self.most:
            self._narrow()

    def _put(self, steps: IntArray, counts: IntArray) -> None:
        """Sort intervals into zones and the stretches between; counts are of the latter only."""
        before = np.searchsorted(self._zones[:, 1], steps)  # zones that end before a length
        inside = before < len(self._zones)
        inside[inside] = self._zones[before[inside], 0] <= steps[inside]
        self._kept.add(steps[inside])
        for at in np.unique(before[~inside]):
            here = ~inside & (before == at)
            self._many[at] += int(counts[here].sum())
            self._sums[at] += int((steps[here] * counts[here]).sum())

    def _narrow(self) -> None:
        """Keep apart what lies around the median and around the bounds of one period."""
        middle, values, few = self.median_ns, self._kept.values, self.most // 8
        zones: list[list[int]] = []
        for length in ((1.0 - NEAR) * middle, middle, (1.0 + NEAR) * middle):
            low, high = self._zone_of(length)
            at = int(np.searchsorted(values, length))
            low = max(low, int(values[at - few])) if at >= few else low
            high = min(high, int(values[at + few])) if at + few < values.size else high
            if zones and low <= zones[-1][1]:
                zones[-1][1] = max(zones[-1][1], high)
            else:
                zones.append([low, high])
        self._keep(np.array(zones, dtype=np.int64))

    def _keep(self, zones: IntArray) -> None:
        """Change to narrower zones."""
        old, counted, summed = self._zones, self._many, self._sums
        kept = self._kept
        self._kept, self._zones = Counts(), zones
        self._many, self._sums = [0] * (len(zones) + 1), [0] * (len(zones) + 1)
        for at, (many, total) in enumerate(zip(counted, summed, strict=True)):
            ended = 0 if at == 0 else int(np.searchsorted(zones[:, 1], old[at - 1, 1], "right"))
            self._many[ended] += many
            self._sums[ended] += total
        before = np.searchsorted(zones[:, 1], kept.values)
        inside = before < len(zones)
        inside[inside] = zones[before[inside], 0] <= kept.values[inside]
        self._put(kept.values[~inside], kept.counts[~inside])
        self._kept = Counts(kept.values[inside], kept.counts[inside])

    def _zone_of(self, length: float) -> tuple[int, int]:
        for low, high in self._zones.tolist():
            if low <= length <= high:
                return low, high
        raise self._undecided(length)

    def _undecided(self, length: float) -> UndecidedError:
        return UndecidedError(
            f"expected intervals kept apart around {length:g} ns, found them summed"
        )

    @property
    def size(self) -> int:
        """Number of intervals."""
        return self._kept.size + sum(self._many)

    @property
    def median_ns(self) -> float:
        """Median interval; there must be one.

        Raises
        ------
        UndecidedError
        """
        ranks = [(self.size - 1) // 2, self.size // 2]
        return float(np.mean([float(self._ranked(rank)) for rank in ranks]))

    def _ranked(self, rank: int) -> int:
        zone_of = np.searchsorted(self._zones[:, 1], self._kept.values)
        for at in range(len(self._many)):
            rank -= self._many[at]
            if rank < 0:
                break
            here = zone_of == at
            ends = np.cumsum(self._kept.counts[here])
            size = int(ends[-1]) if ends.size else 0
            if rank < size:
                found = self._kept.values[here][np.searchsorted(ends, rank, side="right")]
                return int(found)
            rank -= size
        raise self._undecided(float("nan"))

    def usual_ns(self, about_ns: float) -> float:
        """Mean of the intervals that are about one period; `about_ns` itself without any.

        Parameters
        ----------
        about_ns : float

        Raises
        ------
        UndecidedError
        """
        values, counts = self._kept.values, self._kept.counts
        near = np.abs(values / about_ns - 1.0) <= NEAR
        many = int(counts[near].sum())
        total = int((values[near] * counts[near]).sum())
        for at, count in enumerate(self._many):
            if not count:
                continue
            # A stretch that is summed is near throughout or nowhere.
            low = int(self._zones[at - 1, 1]) + 1 if at else _LEAST
            high = int(self._zones[at, 0]) - 1 if at < len(self._zones) else _LARGEST
            within = [abs(end / about_ns - 1.0) <= NEAR for end in (low, high)]
            if all(within):
                many, total = many + count, total + self._sums[at]
            elif any(within) or low < about_ns < high:
                raise self._undecided(about_ns)
        return total / many if many else about_ns

    @property
    def period_s(self) -> float:
        """The period of stamps that come at one rate, missing ones and the clock's ticks apart.

        Raises
        ------
        UndecidedError
        """
        median_ns = self.median_ns
        return median_ns * 1e-9 * (self.usual_ns(median_ns) / median_ns)
