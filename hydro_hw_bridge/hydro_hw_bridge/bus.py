"""An open CAN bus, with the habits that the interfaces need.

Frames are received by a blocking `Bus.receive` in the caller's own loop: a python-can Notifier
dies silently when a listener raises.
"""

from __future__ import annotations

import errno
import threading
import time
from dataclasses import dataclass
from types import TracebackType

import can

from hydro_hw_bridge.bus_name import BusName
from hydro_hw_bridge.error_frames import BUS_OFF, RESTARTED, name_of
from hydro_hw_bridge.errors import BridgeError

#: A send queue that is full: the frame is dropped, as an old valve command must never be queued.
_FULL = (errno.ENOBUFS, errno.EAGAIN)
#: Interfaces on which anybody may send what is no frame.
_DATAGRAMS = ("udp_multicast", "simulated_faults")
#: Interfaces whose frames carry the time of this computer at which they came.
_STAMPED = (*_DATAGRAMS, "socketcan", "virtual")
#: Nothing more waits where nothing comes for so long. No pause of nothing: python-can tells what
#: it filters out like one.
_PAUSE_S = 0.001
#: A queue of some thousand frames is read in this; a bridge claims its bus more often than others
#: listen for it.
_DRAIN_S = 0.3


@dataclass(slots=True)
class BusCounters:
    """What happened on a bus since it was opened.

    Attributes
    ----------
    sent, received : int
        Frames.
    dropped : int
        Frames not sent because the send queue was full.
    send_errors : int
        Frames that the interface refused otherwise.
    error_frames : int
        Error frames reported by the controller.
    malformed : int
        Datagrams that were no CAN frame (`udp_multicast`).
    """

    sent: int = 0
    received: int = 0
    dropped: int = 0
    send_errors: int = 0
    error_frames: int = 0
    malformed: int = 0


class Bus:
    """An open bus.

    Parameters
    ----------
    name : BusName
    bus : can.BusABC

    Attributes
    ----------
    name : BusName
    counters : BusCounters
    off : bool
        Bus-off: the controller took itself off the bus, until it is restarted.
    last_error : str
        The newest error frame in words; empty before the first.
    """

    def __init__(self, name: BusName, bus: can.BusABC) -> None:
        self.name = name
        self.counters = BusCounters()
        self.off = False
        self.last_error = ""
        self._bus = bus
        self._sending = threading.Lock()

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
            if self.name.interface in _DATAGRAMS and _is_unpacking(error):
                self.counters.malformed += 1
                return None
            raise BridgeError(f"{self.name}: receiving failed: {told(error)}") from error
        if message is None:
            return None
        if message.is_error_frame:
            self._take_error(message)
            return None
        self.off = False  # a controller in bus-off receives nothing
        self.counters.received += 1
        return message

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
            before = self.counters.error_frames + self.counters.malformed
            message = self.receive(_PAUSE_S)
            # Neither is a data frame, and more may wait behind one.
            passed = self.counters.error_frames + self.counters.malformed != before
            if message is None and not passed:
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
        if self.name.interface not in _STAMPED:
            return 0.0
        # Both of one clock: its steps are seen by the frames alone that wait meanwhile.
        return max(time.time() - float(message.timestamp), 0.0)

    def _take_error(self, message: can.Message) -> None:
        self.counters.error_frames += 1
        self.last_error = name_of(message)
        if message.arbitration_id & BUS_OFF:
            self.off = True
        elif message.arbitration_id & RESTARTED:
            self.off = False

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
                if _errno(error) in _FULL:
                    self.counters.dropped += 1
                else:
                    self.counters.send_errors += 1
                self.off = self.off or self._bus.state is can.BusState.ERROR
                return False
            self.counters.sent += 1
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


def _errno(error: BaseException) -> int | None:
    """The system's error number behind an exception of python-can."""
    while True:
        if isinstance(error, OSError) and error.errno is not None:
            return error.errno
        code = getattr(error, "error_code", None)
        if isinstance(code, int):
            return code
        if error.__cause__ is None:
            return None
        error = error.__cause__


def _is_unpacking(error: BaseException) -> bool:
    return isinstance(error, can.CanOperationError) and "unpack" in str(error)


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
