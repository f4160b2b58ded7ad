"""Whether the device's cycles come as fast as the robot file says: stamps count them.

Stamps are counters times the period of the file. Of a device that is faster than that, time would
run slow for everybody: its arm would move at twice what controller and limits take it to.
"""

from __future__ import annotations

#: By so much, and by so much of the time since, cycles may be ahead of the clock: those of a
#: device that was late once come sooner afterwards, and quartzes differ.
GRACE_S, SHARE = 1.0, 0.1
#: How fast cycles came between which this much and more is missing nobody knows: the device's
#: counter leapt, or this computer slept.
GAP_S = 0.1


class PeriodWatch:
    """Holds the device's sample counter against this computer's clock.

    A device that is slower shows by its late cycles, and moves slower than all take it to: that
    is no fault.

    Parameters
    ----------
    period_s : float
        Of a cycle, by the robot file.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.forget()

    def forget(self) -> None:
        """The device counts anew."""
        self._last: tuple[int, float] | None = None
        self._begin()

    def _begin(self) -> None:
        self._ahead_s = self._elapsed_s = 0.0
        self._cycles = 0

    def look(self, counter: int, at_s: float) -> str:
        """Look at a cycle.

        Parameters
        ----------
        counter : int
            Sample counter without wrap.
        at_s : float
            When it came, on a clock that never steps, s.

        Returns
        -------
        str
            How the device is faster; empty where it is not.
        """
        last, self._last = self._last, (counter, at_s)
        if last is not None and (counter - last[0] - 1) * self._period_s < GAP_S:
            # Where waiting is told by a clock that was set, a cycle seems to come before the last.
            self._count(counter - last[0], max(at_s - last[1], 0.0))
        if self._ahead_s <= GRACE_S:
            return ""
        found_ms = 1e3 * self._elapsed_s / self._cycles
        return (
            f"the device's cycles are {found_ms:.3g} ms apart, expected"
            f" {1e3 * self._period_s:.3g} ms (rate_hz of the robot file): correct one of both"
        )

    def _count(self, cycles: int, elapsed_s: float) -> None:
        """Cycles that came one after another (a cumulative sum, as in Page, 1954)."""
        ahead_s = self._ahead_s + cycles * self._period_s - (1.0 + SHARE) * elapsed_s
        if ahead_s <= 0.0:
            # The cycle before was early: the latest is what others are ahead of.
            self._begin()
            return
        # What was much too fast is unsaid as soon as what was a little: after 1 s at its rate.
        self._ahead_s = min(ahead_s, GRACE_S + SHARE)
        self._cycles += cycles
        self._elapsed_s += elapsed_s
