"""Whether the device's cycles come as fast as the robot file says: stamps count them.

Stamps are counters times the period of the file. Of a device that is faster than that, time would
run slow for everybody: its arm would move at twice what controller and limits take it to.
"""

from __future__ import annotations

#: By so much, and by so much of the time since, cycles may be ahead of the clock: those of a
#: device that was late once come sooner afterwards, and quartzes differ.
GRACE_S, SHARE = 1.0, 0.1


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
        self._from: tuple[int, float] | None = None

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
        if self._from is None:
            self._from = counter, at_s
        cycles, elapsed_s = counter - self._from[0], at_s - self._from[1]
        ahead_s = cycles * self._period_s - elapsed_s
        if ahead_s < 0.0:
            # The cycle before was early: the latest is what others are ahead of.
            self._from = counter, at_s
        if ahead_s <= GRACE_S + SHARE * elapsed_s:
            return ""
        return (
            f"the device's cycles are {1e3 * elapsed_s / cycles:.3g} ms apart, expected"
            f" {1e3 * self._period_s:.3g} ms (rate_hz of the robot file): correct one of both"
        )
