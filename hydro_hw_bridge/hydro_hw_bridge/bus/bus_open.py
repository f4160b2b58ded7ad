"""Opens a CAN bus by its name, as each interface needs it.

- `socketcan:can0` (or just `can0`) in the lab.
- `udp_multicast:239.74.163.2:43113` where the kernel has no CAN: kept on the loopback device with
  hop limit 0, and IPv4 (python-can's own defaults leave the machine, by IPv6).
- `simulated_faults:239.74.163.2:43113:FILE`: the same with bus-off and error frames on command.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Sequence
from pathlib import Path

import can

from hydro_hw_bridge.bus.bus import Bus, told
from hydro_hw_bridge.bus.bus_name import BusName, parse_bus
from hydro_hw_bridge.errors import BridgeError

#: Interfaces that give error frames whatever is filtered: the kernel's, and those on which nobody
#: but the plugin makes any. Elsewhere python-can filters in software, and they would be dropped.
FILTERED = ("socketcan", "udp_multicast", "simulated_faults")
LOOPBACK = "127.0.0.1"
RECEIVE_BUFFER_BYTES = 1 << 20


def open_bus(text: str, identifiers: Sequence[int] | None = None) -> Bus:
    """Open a bus.

    Parameters
    ----------
    text : str
        `socketcan:can0`, `can0` or `udp_multicast:GROUP[:PORT]`; other python-can interfaces as
        `interface:channel`.
    identifiers : sequence of int, optional
        Receive only these identifiers, where the interface gives error frames all the same
        (`FILTERED`); by default, and elsewhere, everything.

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
    if identifiers is not None and name.interface in FILTERED:
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
        raise BridgeError(f"cannot open CAN bus {name}: {told(error)}") from error
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
        raise BridgeError(f"cannot open CAN bus {name}: {told(error)}") from error
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
        raise BridgeError(f"cannot open CAN bus {name}: {told(error)}") from error
    return bus


def _open_simulated(name: BusName, filters: list[can.typechecking.CanFilter] | None) -> can.BusABC:
    """Without python-can's search for interfaces: it needs the package to be installed."""
    from hydro_hw_bridge.bus.simulated_faults import SimulatedFaultsBus

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


def quiet_python_can() -> None:
    """Keep python-can's own log lines off the terminal of a command."""
    logging.getLogger("can").setLevel(logging.CRITICAL)
