"""The device's sample counter as ROS time."""

from __future__ import annotations

from hydro_hw_bridge.errors import BridgeError

_WRAP = 1 << 32
_HALF = _WRAP >> 1
_SECOND_NS = 1_000_000_000


class SampleClock:
    """Maps sample counters to stamps, once: no clock that steps later changes an interval.

    Parameters
    ----------
    period_ns : int
        Of the device's cycle.
    whole_seconds : bool
        Put counter 0 on a whole second (lockstep, where stamps stand for device time): then
        seconds in floating point are rounded alike in every run.

    Attributes
    ----------
    zero_stamp_ns : int or None
        ROS time of device counter 0; None before `start`.
    """

    def __init__(self, period_ns: int, *, whole_seconds: bool = False) -> None:
        if period_ns <= 0:
            raise BridgeError(f"expected a cycle period above 0 ns, found {period_ns}")
        self.period_ns = period_ns
        self.zero_stamp_ns: int | None = None
        self._whole_seconds = whole_seconds
        self._last = 0
        self._last_stamp_ns: int | None = None

    def carry_over(self, other: SampleClock) -> None:
        """Stamps go on upwards from those of another clock, as after a restart of the device.

        Parameters
        ----------
        other : SampleClock
            The one before this.
        """
        self._last_stamp_ns = other._last_stamp_ns

    def start(self, counter: int, now_ns: int) -> None:
        """Map a counter to the present, at the start or after the device restarted.

        Stamps never go back: after a restart the first one is at least a period later than
        the last one before.

        Parameters
        ----------
        counter : int
            Sample counter, 32 bits.
        now_ns : int
            ROS time.
        """
        zero = now_ns - counter * self.period_ns
        if self._last_stamp_ns is not None:
            zero = max(zero, self._last_stamp_ns + self.period_ns - counter * self.period_ns)
        if self._whole_seconds:
            zero -= zero % _SECOND_NS
            if self._last_stamp_ns is not None:
                while zero + counter * self.period_ns <= self._last_stamp_ns:
                    zero += _SECOND_NS
        self.zero_stamp_ns = zero
        self._last = counter

    def extend(self, counter: int) -> int:
        """The counter without its 32-bit wrap, near the one before.

        Parameters
        ----------
        counter : int
            32 bits, of a cycle at most half a wrap from the one before.

        Returns
        -------
        int
        """
        self._last += (counter - self._last + _HALF) % _WRAP - _HALF
        return self._last

    def stamp_ns(self, extended: int) -> int:
        """The stamp of an extended counter.

        Parameters
        ----------
        extended : int

        Returns
        -------
        int

        Raises
        ------
        BridgeError
            Before `start`.
        """
        if self.zero_stamp_ns is None:
            raise BridgeError("the sample clock was not started: expected a first sync frame")
        stamp = self.zero_stamp_ns + extended * self.period_ns
        self._last_stamp_ns = max(stamp, self._last_stamp_ns or stamp)
        return stamp

    def counter_of(self, stamp_ns: int) -> int | None:
        """The extended counter of a stamp, or None where it is not one of a cycle.

        Parameters
        ----------
        stamp_ns : int

        Returns
        -------
        int or None
        """
        if self.zero_stamp_ns is None:
            return None
        cycles, rest = divmod(stamp_ns - self.zero_stamp_ns, self.period_ns)
        return None if rest else cycles
