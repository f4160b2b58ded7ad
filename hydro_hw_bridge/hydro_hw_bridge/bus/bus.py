"""An open CAN bus, with the habits that the interfaces need.

Frames are received by a blocking `Bus.receive` in the caller's own loop: a python-can Notifier
dies silently when a listener raises.
"""

from __future__ import annotations

import threading
import time
from types import TracebackType

import can

from hydro_hw_bridge.bus.bus_health import BusCounters, BusHealth
from hydro_hw_bridge.bus.bus_name import BusName
from hydro_hw_bridge.errors import BridgeError

#: Nothing more waits where nothing comes for so long. No pause of nothing: python-can tells what
#: it filters out like one.
_PAUSE_S = 0.001
#: A queue of some thousand frames is read in this; a bridge claims its bus more often than others
#: listen for it.
_DRAIN_S = 0.3


class Bus:
    """An open bus.

    Parameters
    ----------
    name : BusName
    bus : can.BusABC

    Attributes
    ----------
    name : BusName
    health : BusHealth
    """

    def __init__(self, name: BusName, bus: can.BusABC) -> None:
        self.name = name
        self.health = BusHealth(name.interface)
        self._bus = bus
        self._sending = threading.Lock()

    @property
    def counters(self) -> BusCounters:
        """As of `BusHealth`."""
        return self.health.counters

    @property
    def off(self) -> bool:
        """As of `BusHealth`."""
        return self.health.off

    @property
    def hears_itself(self) -> bool:
        """As of `BusHealth`."""
        return self.health.hears_itself

    @property
    def tells_waiting(self) -> bool:
        """As of `BusHealth`."""
        return self.health.tells_waiting

    @property
    def last_error(self) -> str:
        """As of `BusHealth`."""
        return self.health.last_error

    def receive(self, timeout_s: float) -> can.Message | None:
        """The next frame, or None after the timeout or where it was no data frame.

        Parameters
        ----------
        timeout_s : float

        Returns
        -------
        can.Message or None

        Raises
        ------
        BridgeError
            The interface went away.
        """
        try:
            message = self._bus.recv(timeout_s)
        except (can.CanError, OSError, ValueError) as error:
            if self.health.passes_over(error):
                return None
            raise BridgeError(f"{self.name}: receiving failed: {told(error)}") from error
        return self.health.read(message)

    def drain(self) -> None:
        """Take what waits, of the past as it is; but for what it says of the interface, unseen.

        Ends with the first pause of a live bus, and in any case after a while.

        Raises
        ------
        BridgeError
            The interface went away.
        """
        end = time.monotonic() + _DRAIN_S
        while time.monotonic() < end:
            before = self.health.passed
            if self.receive(_PAUSE_S) is None and self.health.passed == before:
                return

    def waited_s(self, message: can.Message) -> float:
        """How long a frame has waited since this computer got it.

        Parameters
        ----------
        message : can.Message
            Received here.

        Returns
        -------
        float
            s; 0 where the interface does not tell.
        """
        return self.health.waited_s(float(message.timestamp), time.time())

    def send(self, message: can.Message) -> bool:
        """Send a frame now or not at all.

        Parameters
        ----------
        message : can.Message

        Returns
        -------
        bool
            False where it was not sent; the counters say why.
        """
        with self._sending:
            try:
                self._bus.send(message)
            except (can.CanError, OSError) as error:
                self.health.refused(error, self._bus.state)
                return False
            self.health.took()
            return True

    def close(self) -> None:
        """Close the interface; a second call does nothing."""
        self._bus.shutdown()

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def told(error: BaseException) -> str:
    """An exception of python-can in one line.

    Parameters
    ----------
    error : BaseException

    Returns
    -------
    str
        With its cause.
    """
    cause = error.__cause__
    text = f"{error} ({cause})" if cause is not None else str(error)
    return " ".join(text.split()) or type(error).__name__
