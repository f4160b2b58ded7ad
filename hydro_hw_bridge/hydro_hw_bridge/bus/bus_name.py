"""Names of CAN buses: `interface:channel[:port]`, as python-can calls its interfaces."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass

from hydro_hw_bridge.errors import BridgeError

DEFAULT_BUS = "udp_multicast:239.74.163.2:43113"


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
