"""A bus that notes how long every cycle's valve frame was in coming."""

from __future__ import annotations

import time
from array import array
from collections import OrderedDict, deque

import can
import numpy as np

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_name import BusName
from hydro_hw_bridge.protocol.codec import Codec
from hydro_model.robot import FloatArray

#: Cycles that may still be answered.
_OPEN = 500
#: The newest cycles, whose answers may be on the way.
IN_FLIGHT = 2


def lateness(times: FloatArray, unanswered: int, percent: float) -> float:
    """A percentile of the times of cycles, those that nobody answered infinitely late.

    It is a time that was measured (the smallest that at least this share does not exceed): between
    a time and none there is nothing to interpolate.

    Parameters
    ----------
    times : (answered,) array
    unanswered : int
    percent : float

    Returns
    -------
    float
        In the unit of the times; infinite where that share was not answered.
    """
    every = np.concatenate([times, np.full(unanswered, np.inf)])
    return float(np.percentile(every, percent, method="inverted_cdf"))


class TimedBus(Bus):
    """The device's end of a bus; frames pass as they are.

    A cycle's latency is from just before its last sensor frame is sent until the first valve frame
    that answers it with the valves enabled has been received; its reaction time until the first
    that answers it or a newer one.

    Parameters
    ----------
    name : BusName
    bus : can.BusABC
    codec : Codec

    Attributes
    ----------
    cycles : int
        Sent since the last `begin`.
    """

    def __init__(self, name: BusName, bus: can.BusABC, codec: Codec) -> None:
        super().__init__(name, bus)
        self._codec = codec
        self._last = codec.device_ids[-1]
        self._counter = 0
        self.begin()

    def begin(self) -> None:
        """Forget what was noted."""
        self.cycles = self._cycles_at_answer = 0
        self._latencies_s = array("d")
        self._reactions_s = array("d")
        self._open: OrderedDict[int, float] = OrderedDict()
        self._unmet: deque[tuple[int, float]] = deque()

    def send(self, message: can.Message) -> bool:
        """As `Bus.send`; notes the cycle.

        `message` is a sensor frame.
        """
        frame = self._codec.receive(message)
        if frame is not None and frame.role == "sync":
            self._counter = self._codec.sample_counter(frame)
        if message.arbitration_id == self._last:
            self.cycles += 1
            self._open[self._counter] = now = time.perf_counter()
            self._unmet.append((self._counter, now))
            if len(self._open) > _OPEN:
                self._open.popitem(last=False)
        return super().send(message)

    def receive(self, timeout_s: float) -> can.Message | None:
        """As `Bus.receive`; notes the answer.

        `timeout_s` is how long to wait.
        """
        message = super().receive(timeout_s)
        now = time.perf_counter()
        frame = None if message is None else self._codec.receive(message)
        if frame is not None and frame.role == "command" and frame.intact:
            command = self._codec.decode_command(frame)
            if command.enable:
                newest = next((c for c in reversed(self._open) if command.answers(c)), None)
                if newest is not None:
                    self._latencies_s.append(now - self._open.pop(newest))
                    self._cycles_at_answer = self.cycles
                    self._react(newest, now)
        return message

    def _react(self, counter: int, now_s: float) -> None:
        """Note all cycles up to that of a counter, unless a newer one was answered before."""
        if all(known != counter for known, _ in self._unmet):
            return
        known = -1
        while known != counter:
            known, sent_s = self._unmet.popleft()
            self._reactions_s.append(now_s - sent_s)

    @property
    def answered(self) -> int:
        """Cycles that were answered."""
        return len(self._latencies_s)

    @property
    def silence(self) -> int:
        """Cycles that were sent since the newest answer."""
        return self.cycles - self._cycles_at_answer

    def latencies_s(self) -> FloatArray:
        """A copy of the times of the cycles that were answered, s; (answered,).

        Other threads may go on noting meanwhile: no view of the array may keep it from growing.
        """
        return np.frombuffer(self._latencies_s.tobytes(), dtype=np.float64)

    def reactions_s(self) -> FloatArray:
        """A copy of the reaction times, s; (cycles that were answered or passed over,)."""
        return np.frombuffer(self._reactions_s.tobytes(), dtype=np.float64)

    @property
    def lost(self) -> int:
        """Cycles that nobody has answered, the newest left out: theirs may be on the way."""
        return max(self.cycles - self.answered - IN_FLIGHT, 0)
