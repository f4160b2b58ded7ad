"""How late the bridge's loops are, how long they work, and how soon a sample is answered."""

from __future__ import annotations

import time

from hydro_hw_bridge.protocol.bridge_step import Sample, Step
from hydro_msgs_docs.loop_times import LoopTimes, RecentTimes


class BridgeTimes:
    """What `/diagnostics` of the bridge says about time.

    Parameters
    ----------
    period_s : float
        Of the device's cycle.
    lockstep : bool
        Without lateness then: machine time stands still while the machine waits.

    Attributes
    ----------
    answer : RecentTimes
        From the last frame of a sample to the valve frame that answers it: bridge, DDS and
        controller.
    """

    def __init__(self, period_s: float, *, lockstep: bool) -> None:
        self._lockstep = lockstep
        self._loop = LoopTimes(period_s)
        self.answer = RecentTimes()
        #: Stamp and arrival of the newest sample, as one: two threads meet here.
        self._newest = (0, 0)

    def arrived(self, sample: Sample | None, begin_ns: int) -> None:
        """A frame was taken in, before anything is published.

        Parameters
        ----------
        sample : Sample or None
            That the frame completed.
        begin_ns : int
            Monotonic clock when the frame came.
        """
        if sample is None or sample.repeated:
            return
        self._newest = (sample.stamp_ns, begin_ns)
        if not self._lockstep:
            self._loop.took(sample.stamp_ns, begin_ns)

    def published(self, sample: Sample | None, begin_ns: int) -> None:
        """What followed from a frame is published.

        Parameters
        ----------
        sample : Sample or None
        begin_ns : int
            As for `arrived`.
        """
        if sample is not None:
            self._loop.work.add(time.monotonic_ns() - begin_ns)

    def commanded(self, step: Step, stamp_ns: int) -> None:
        """A command was judged; its valve frame, if any, has been sent.

        Parameters
        ----------
        step : Step
        stamp_ns : int
            Of the command.
        """
        stamp, begin_ns = self._newest
        if step.answer is not None and stamp == stamp_ns:
            self.answer.add(time.monotonic_ns() - begin_ns)

    def values(self) -> dict[str, object]:
        """Keys and values for `/diagnostics`."""
        loop = self._loop
        return (loop.work.values("loop") if self._lockstep else loop.values()) | (
            self.answer.values("answer")
        )
