"""The bridge's end of the fault line, as a bus."""

from __future__ import annotations

import can

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_name import BusName
from hydro_hw_bridge.faults.line import FaultLine


class LineBus(Bus):
    """The bridge's end of a fault line."""

    def __init__(self, line: FaultLine) -> None:
        super().__init__(BusName("fault", "line"), _NoBus())
        self._line = line
        self.out: list[can.Message] = []

    def send(self, message: can.Message) -> bool:
        """Put a frame on the line, where it takes it."""
        state = self._line.link
        if state == "ok":
            self.out.append(message)
            self.counters.sent += 1
        elif state == "queue_full":
            self.counters.dropped += 1
        else:
            self.counters.send_errors += 1
        return state == "ok"

    def look(self) -> None:
        """Take over the state of the line."""
        off = self._line.link == "bus_off"
        if off and not self.off:
            self.counters.error_frames += 1
        self.health.off = off


class _NoBus:
    """Nothing behind the line: no interface, no socket."""
