"""A CAN bus by python-can name, with the habits that the interfaces need.

- `socketcan:can0` (or just `can0`) in the lab.
- `udp_multicast:239.74.163.2:43113` where the kernel has no CAN: kept on the loopback device with
  hop limit 0, and IPv4 (python-can's own defaults leave the machine, by IPv6).
- `simulated_faults:239.74.163.2:43113:FILE`: the same with bus-off and error frames on command.

Frames are received by a blocking `Bus.receive` in the caller's own loop: a python-can Notifier
dies silently when a listener raises.
"""

from __future__ import annotations

import errno
import ipaddress
import logging
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import can

from hydro_hw_bridge.error_frames import BUS_OFF, RESTARTED, name_of
from hydro_hw_bridge.errors import BridgeError

DEFAULT_BUS = "udp_multicast:239.74.163.2:43113"
LOOPBACK = "127.0.0.1"
RECEIVE_BUFFER_BYTES = 1 << 20
#: A send queue that is full: the frame is dropped, as an old valve command must never be queued.
_FULL = (errno.ENOBUFS, errno.EAGAIN)
#: Interfaces on which anybody may send what is no frame.
_DATAGRAMS = ("udp_multicast", "simulated_faults")
#: Interfaces whose frames carry the time of this computer at which they came.
_STAMPED = (*_DATAGRAMS, "socketcan", "virtual")


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


@dataclass(frozen=True, slots=True)
class BusName:
    """Interface, channel and, for `udp_multicast`, port."""

    interface: str
    channel: str
    port: int | None = None

    def __str__(self) -> str:
        port = "" if self.port is None else f":{self.port}"
        return f"{self.interface}:{self.channel}{port}"


def parse_bus(text: str) -> BusName:
    """Read a bus name.

    Parameters
    ----------
    text : str
        `interface:channel[:port]`; a name without colon is a socketcan channel.

    Returns
    -------
    BusName

    Raises
    ------
    BridgeError
        The name is none of that, or its group or port is not one.
    """
    interface, _, rest = text.strip().partition(":")
    if not rest:
        interface, rest = "socketcan", interface
    if not interface or not rest:
        raise BridgeError(f"expected a CAN bus as interface:channel[:port], found '{text}'")
    if interface != "udp_multicast":
        return BusName(interface, rest)
    group, _, port = rest.partition(":")
    try:
        multicast = ipaddress.IPv4Address(group).is_multicast
        number = int(port or DEFAULT_BUS.rpartition(":")[2])
    except ValueError:
        multicast, number = False, 0
    if not multicast or not 0 < number < 65536:
        raise BridgeError(
            "expected udp_multicast:GROUP[:PORT] with an IPv4 group of 224.0.0.0/4 and a port"
            f" from 1 to 65535, found '{text}'"
        )
    return BusName(interface, group, number)


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
            raise BridgeError(f"{self.name}: receiving failed: {_text(error)}") from error
        if message is None:
            return None
        if message.is_error_frame:
            self._take_error(message)
            return None
        self.off = False  # a controller in bus-off receives nothing
        self.counters.received += 1
        return message

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


def open_bus(text: str, identifiers: Sequence[int] | None = None) -> Bus:
    """Open a bus.

    Parameters
    ----------
    text : str
        `socketcan:can0`, `can0` or `udp_multicast:GROUP[:PORT]`; other python-can interfaces as
        `interface:channel`.
    identifiers : sequence of int, optional
        Receive only these identifiers; by default everything.

    Returns
    -------
    Bus

    Raises
    ------
    BridgeError
        The name is malformed, or the interface is absent, down or busy.
    """
    name = parse_bus(text)
    filters = None
    if identifiers is not None:
        filters = [can.typechecking.CanFilter(can_id=i, can_mask=0x1FFFFFFF) for i in identifiers]
    if name.interface == "udp_multicast":
        return Bus(name, open_multicast(name, filters))
    if name.interface == "simulated_faults":
        return Bus(name, _open_simulated(name, filters))
    if name.interface == "socketcan":
        _check_interface(name)
    try:
        bus = can.Bus(channel=name.channel, interface=name.interface, can_filters=filters)
    except (
        can.CanError,
        OSError,
        ValueError,
        NameError,
        ImportError,
        NotImplementedError,
    ) as error:
        # NameError: what python-can's vendor interfaces raise without the vendor's library.
        raise BridgeError(f"cannot open CAN bus {name}: {_text(error)}") from error
    return Bus(name, bus)


def open_multicast(name: BusName, filters: list[can.typechecking.CanFilter] | None) -> can.BusABC:
    """Open `udp_multicast` on the loopback device.

    Parameters
    ----------
    name : BusName
    filters : list of filters, or None

    Returns
    -------
    can.BusABC

    Raises
    ------
    BridgeError
        The port is busy, or multicast is not there.
    """
    from can.interfaces.udp_multicast import UdpMulticastBus

    try:
        bus = UdpMulticastBus(
            channel=name.channel, port=name.port or 0, hop_limit=0, can_filters=filters
        )
    except (can.CanError, OSError) as error:
        raise BridgeError(f"cannot open CAN bus {name}: {_text(error)}") from error
    try:
        # The kernel takes the route of the group for the interface, which needs a network; the
        # loopback device is always there.
        with socket.socket(fileno=socket.dup(bus.fileno())) as shared:
            group, loopback = socket.inet_aton(name.channel), socket.inet_aton(LOOPBACK)
            shared.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group + loopback)
            shared.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
            shared.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
            shared.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    except OSError as error:
        bus.shutdown()
        raise BridgeError(f"cannot open CAN bus {name}: {_text(error)}") from error
    return bus


def _open_simulated(name: BusName, filters: list[can.typechecking.CanFilter] | None) -> can.BusABC:
    """Without python-can's search for interfaces: it needs the package to be installed."""
    from hydro_hw_bridge.simulated_faults import SimulatedFaultsBus

    return SimulatedFaultsBus(name.channel, can_filters=filters)


def _check_interface(name: BusName) -> None:
    """A message better than the kernel's 'No such device' where a CAN interface is absent."""
    devices = Path("/sys/class/net")
    # Type 280 is ARPHRD_CAN of linux/if_arp.h.
    known = [p.name for p in sorted(devices.glob("*")) if _read_text(p / "type").strip() == "280"]
    if devices.is_dir() and name.channel not in known:
        raise BridgeError(
            f"cannot open CAN bus {name}: no such CAN interface"
            f" (present: {', '.join(known) or 'none'})"
        )
    flags = _read_text(devices / name.channel / "flags").strip()
    if flags and not int(flags, 16) & 1:
        raise BridgeError(
            f"cannot open CAN bus {name}: the interface is down, expected it up:"
            f" sudo ip link set {name.channel} up type can bitrate 1000000"
        )


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii")
    except OSError:
        return ""


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


def _text(error: BaseException) -> str:
    cause = error.__cause__
    text = f"{error} ({cause})" if cause is not None else str(error)
    return " ".join(text.split()) or type(error).__name__


def quiet_python_can() -> None:
    """Keep python-can's own log lines off the terminal of a command."""
    logging.getLogger("can").setLevel(logging.CRITICAL)
