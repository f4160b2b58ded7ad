"""The bus as the way of valve frames: sends them, and knows what is wrong with it."""

from __future__ import annotations

import can

from hydro_hw_bridge.bus.bus import Bus

UNSENT = "unsent"
BUS_OFF = "bus_off"


class CommandLink:
    """Sends valve frames.

    Parameters
    ----------
    bus : Bus
    most_unsent : int
        So many frames in a row may be refused by the bus before that is a fault, which ends with
        a valve frame that it takes, or with more than so many others in a row.

    Attributes
    ----------
    tried : bool
        Frames were sent, or could not be, since `conditions` were looked at.
    """

    def __init__(self, bus: Bus, most_unsent: int) -> None:
        self._bus = bus
        self._most_unsent = most_unsent
        self._unsent = self._sent_by_then = 0
        self.tried = False

    def send(self, frame: can.Message) -> bool:
        """Send a frame now or not at all; False where the bus did not take it."""
        sent = self._bus.send(frame)
        self._unsent = 0 if sent else self._unsent + 1
        self._sent_by_then = self._bus.counters.sent
        self.tried = True
        return sent

    def conditions(self) -> tuple[tuple[str, str], ...]:
        """Names of the faults that a bus can have, each with its reason or empty."""
        self.tried = False
        # Where no valves are driven none of their frames is tried: that the bus takes frames
        # again is told by others, the claims, and by as many as it takes to be without.
        if self._bus.counters.sent - self._sent_by_then > self._most_unsent:
            self._unsent = 0
        return (
            (BUS_OFF, "bus-off: the CAN controller left the bus" if self._bus.off else ""),
            (
                UNSENT,
                "valve frames cannot be sent" if self._unsent > self._most_unsent else "",
            ),
        )
