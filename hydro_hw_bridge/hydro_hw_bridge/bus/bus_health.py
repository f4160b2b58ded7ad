"""How a bus is, by what was read of it and what it took: all that `Bus` decides. Pure."""

from __future__ import annotations

import errno
from dataclasses import dataclass

import can

from hydro_hw_bridge.bus.error_frames import BUS_OFF, RESTARTED, name_of

#: A send queue that is full: the frame is dropped, as an old valve command must never be queued.
_FULL = (errno.ENOBUFS, errno.EAGAIN)
#: Interfaces on which anybody may send what is no frame.
_DATAGRAMS = ("udp_multicast", "simulated_faults")
#: Interfaces whose frames carry the time of this computer at which they came.
_STAMPED = (*_DATAGRAMS, "socketcan", "virtual")
#: Interfaces that never give a sender its own frames, as they are opened here.
_DEAF_TO_THEMSELVES = ("socketcan", "virtual")


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


class BusHealth:
    """What is counted of a bus, and whether its controller has left it.

    Parameters
    ----------
    interface : str
        Its name in python-can.

    Attributes
    ----------
    counters : BusCounters
    off : bool
        Bus-off: the controller took itself off the bus, until it is restarted.
    last_error : str
        The newest error frame in words; empty before the first.
    """

    def __init__(self, interface: str) -> None:
        self._interface = interface
        self.counters = BusCounters()
        self.off = False
        self.last_error = ""

    # -- reading

    def read(self, message: can.Message | None) -> can.Message | None:
        """What was read: a data frame, or None.

        Parameters
        ----------
        message : can.Message or None
            As the interface gives it.
        """
        if message is None:
            return None
        if message.is_error_frame:
            self._error(message)
            return None
        self.off = False  # a controller in bus-off receives nothing
        self.counters.received += 1
        return message

    def _error(self, message: can.Message) -> None:
        self.counters.error_frames += 1
        self.last_error = name_of(message)
        if message.arbitration_id & BUS_OFF:
            self.off = True
        elif message.arbitration_id & RESTARTED:
            self.off = False

    def passes_over(self, error: BaseException) -> bool:
        """Whether reading failed for what is no frame, which is counted; else the bus is gone.

        Parameters
        ----------
        error : BaseException
        """
        no_frame = self._interface in _DATAGRAMS and _is_unpacking(error)
        self.counters.malformed += no_frame
        return no_frame

    @property
    def passed(self) -> int:
        """Times that something was read which is no data frame: more may wait behind it."""
        return self.counters.error_frames + self.counters.malformed

    @property
    def hears_itself(self) -> bool:
        """Whether a sender may hear its own frames: of a vendor's interface nobody knows."""
        return self._interface not in _DEAF_TO_THEMSELVES

    @property
    def tells_waiting(self) -> bool:
        """Whether the interface tells when a frame came."""
        return self._interface in _STAMPED

    def waited_s(self, stamp_s: float, now_s: float) -> float:
        """How long a frame has waited since this computer got it.

        Parameters
        ----------
        stamp_s, now_s : float
            The frame's, and the time, both of the system's clock: its steps are seen by the
            frames alone that wait meanwhile.

        Returns
        -------
        float
            s; 0 where the interface does not tell.
        """
        return max(now_s - stamp_s, 0.0) if self.tells_waiting else 0.0

    # -- sending

    def took(self) -> None:
        """A frame was sent."""
        self.counters.sent += 1

    def refused(self, error: BaseException, state: can.BusState) -> None:
        """A frame was not.

        Parameters
        ----------
        error : BaseException
        state : can.BusState
            What the interface says of its controller then.
        """
        if _errno(error) in _FULL:
            self.counters.dropped += 1
        else:
            self.counters.send_errors += 1
        self.off = self.off or state is can.BusState.ERROR


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
