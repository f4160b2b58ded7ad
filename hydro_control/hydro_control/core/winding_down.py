"""How the last commands go to 0 V, sample by sample: when to wait, for how long, when it ends."""

from __future__ import annotations

#: How long the ramp to 0 V waits for another sample, and the whole of it may last.
LAST_SAMPLE_S = 0.05
RAMP_S = 0.5


class WindingDown:
    """The way to 0 V, on the samples that still come; without them it is over soon.

    The bridge takes one command per stamp, so every step waits for a stamp of its own.

    Parameters
    ----------
    stamp_ns : int
        That was answered last.
    now_s : float
        On a clock that never steps, as everywhere here.

    Attributes
    ----------
    stamp_ns : int
        That was answered last by now.
    """

    def __init__(self, stamp_ns: int, now_s: float) -> None:
        self.stamp_ns = stamp_ns
        self._end_s = now_s + RAMP_S
        self._silent_s = now_s + LAST_SAMPLE_S
        self._at_zero = False

    def left_s(self, now_s: float) -> float:
        """How long to wait for a sample.

        Parameters
        ----------
        now_s : float

        Returns
        -------
        float
            s; 0 where it is over: arrived, too long, or no sample came.
        """
        if self._at_zero:
            return 0.0
        return max(min(self._end_s, self._silent_s) - now_s, 0.0)

    def takes(self, stamp_ns: int, now_s: float) -> bool:
        """Whether a sample is to be answered: once, and in the order of stamps.

        Parameters
        ----------
        stamp_ns : int
        now_s : float
        """
        if stamp_ns <= self.stamp_ns:
            return False
        self.stamp_ns = stamp_ns
        self._silent_s = now_s + LAST_SAMPLE_S
        return True

    def answered(self, *, zero: bool) -> None:
        """A command was published.

        Parameters
        ----------
        zero : bool
            It was 0 V on every valve.
        """
        self._at_zero = zero
