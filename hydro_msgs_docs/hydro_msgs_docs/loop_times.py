"""How late a 500 Hz loop is and how long it works, in constant memory."""

from __future__ import annotations

from array import array
from itertools import accumulate

#: Bins per octave: a percentile is at most 1/32 too high.
_FINE = 32
_FINE_BITS = 5
#: Longer times count as this one: 18 minutes.
_LONGEST_NS = (1 << 40) - 1
_BINS = (41 - _FINE_BITS) * _FINE
#: Values after which `RecentTimes` drops the older half: 5 s at 500 Hz.
_HALF = 2500
#: Samples after which `LoopTimes` drops the older half of what is usual: 0.5 s at 500 Hz.
_USUAL = 250


class LatencyHistogram:
    """Counts of times in fixed bins: exact below 64 ns, 32 bins per factor of two above.

    Memory is constant (9 kB) and adding costs no allocation that stays. One thread adds; others
    may read meanwhile.

    Attributes
    ----------
    max_ns : int
        The longest time, exactly.
    """

    def __init__(self) -> None:
        self._counts = array("Q", bytes(8 * _BINS))
        self.max_ns = 0

    def add(self, time_ns: int) -> None:
        """Count a time; one below 0 counts as 0.

        Parameters
        ----------
        time_ns : int
        """
        time_ns = min(max(time_ns, 0), _LONGEST_NS)
        # Above two bins' worth of octaves, the six leading bits say which bin.
        octave = max(time_ns.bit_length() - _FINE_BITS - 1, 0)
        self._counts[(octave << _FINE_BITS) + (time_ns >> octave)] += 1
        if time_ns > self.max_ns:
            self.max_ns = time_ns

    def merged(self, other: LatencyHistogram) -> LatencyHistogram:
        """A new histogram of the values of both.

        Parameters
        ----------
        other : LatencyHistogram

        Returns
        -------
        LatencyHistogram
        """
        both = LatencyHistogram()
        both._counts = array("Q", map(int.__add__, self._counts, other._counts))
        both.max_ns = max(self.max_ns, other.max_ns)
        return both

    def percentile_ns(self, percent: float) -> int:
        """The time that `percent` % of the values do not exceed (nearest rank), ns.

        Parameters
        ----------
        percent : float
            0 to 100.

        Returns
        -------
        int
            The upper end of that value's bin: at most 1/32 too high, never too low. 0 without
            values.
        """
        sums = list(accumulate(self._counts))
        if not sums[-1]:
            return 0
        rank = max(percent / 100.0 * sums[-1], 1.0)
        index = next(i for i, total in enumerate(sums) if total >= rank)
        octave = max((index >> _FINE_BITS) - 1, 0)
        upper = ((index - (octave << _FINE_BITS) + 1) << octave) - 1
        return min(upper, self.max_ns)


class RecentTimes:
    """Percentiles of the last 2500 to 5000 times, 5 to 10 s at 500 Hz, and the longest ever.

    Attributes
    ----------
    worst_ns : int
        The longest since the start.
    """

    def __init__(self) -> None:
        # Replaced as one object, so that a reader in another thread sees two that belong together.
        self._halves = (LatencyHistogram(), LatencyHistogram())
        self._left = _HALF
        self.worst_ns = 0

    def add(self, time_ns: int) -> None:
        """Count a time.

        Parameters
        ----------
        time_ns : int
        """
        if self._left == 0:
            self._halves = (self._halves[1], LatencyHistogram())
            self._left = _HALF
        self._left -= 1
        self._halves[1].add(time_ns)
        if time_ns > self.worst_ns:
            self.worst_ns = time_ns

    def values(self, name: str) -> dict[str, object]:
        """Keys and values for `/diagnostics`.

        Parameters
        ----------
        name : str
            Keys are `<name>_p50_us`, `_p99_us`, `_max_us` and `_worst_us`.

        Returns
        -------
        dict
        """
        older, newer = self._halves
        both = older.merged(newer)
        times_ns = {
            "p50": both.percentile_ns(50.0),
            "p99": both.percentile_ns(99.0),
            "max": both.max_ns,
            "worst": self.worst_ns,
        }
        return {f"{name}_{key}_us": f"{1e-3 * t:.0f}" for key, t in times_ns.items()}


class LoopTimes:
    """Lateness and work of a loop that handles one stamped sample per period.

    The lateness of a sample is by how much longer than usual it took from its stamp into the
    loop: the difference of the two clocks, less the smallest of the last 250 to 500 samples. In
    such a short while clocks drift by 0.1 ms at most; a delay that stays is usual from then on,
    also that of a machine whose own clock stood still. A sample more than a period late is a late
    cycle. In lockstep lateness means nothing: machine time stands still while the machine waits.

    Parameters
    ----------
    period_s : float
        Of the samples.

    Attributes
    ----------
    late_cycles : int
        Samples that came into the loop more than a period late, since the start.
    lateness, work : RecentTimes
    """

    def __init__(self, period_s: float) -> None:
        self._period_ns = round(1e9 * period_s)
        self.late_cycles = 0
        self.lateness, self.work = RecentTimes(), RecentTimes()
        self._last_stamp_ns: int | None = None
        #: Smallest delays of the older and the newer half.
        self._older_ns = self._newer_ns = 0
        self._left = 0

    def took(self, stamp_ns: int, now_ns: int) -> None:
        """A sample came into the loop; one that is repeated or older than the last is not counted.

        Parameters
        ----------
        stamp_ns : int
            Of the sample.
        now_ns : int
            Monotonic clock.
        """
        last_ns, delay_ns = self._last_stamp_ns, now_ns - stamp_ns
        if last_ns is not None and stamp_ns <= last_ns:
            return
        self._last_stamp_ns = stamp_ns
        if self._left == 0:
            self._older_ns = delay_ns if last_ns is None else self._newer_ns
            self._newer_ns = delay_ns
            self._left = _USUAL
        self._left -= 1
        self._newer_ns = min(self._newer_ns, delay_ns)
        late_ns = delay_ns - min(self._older_ns, self._newer_ns)
        self.lateness.add(late_ns)
        self.late_cycles += late_ns > self._period_ns

    def values(self) -> dict[str, object]:
        """Keys and values for `/diagnostics`: `late_cycles`, `lateness_...` and `loop_...`."""
        return {
            "late_cycles": self.late_cycles,
            **self.lateness.values("lateness"),
            **self.work.values("loop"),
        }
