"""What an error frame says, by the classes of Linux's `can/error.h`.

Controllers report through frames of their own: the class is in the identifier, details of the
controller's state in the second data byte. Other python-can interfaces that deliver error frames
use the same classes or none.
"""

from __future__ import annotations

import can

TRANSMIT_TIMEOUT = 0x001
LOST_ARBITRATION = 0x002
CONTROLLER = 0x004
PROTOCOL = 0x008
TRANSCEIVER = 0x010
NO_ACKNOWLEDGE = 0x020
BUS_OFF = 0x040
BUS_ERROR = 0x080
RESTARTED = 0x100

_CLASSES = {
    TRANSMIT_TIMEOUT: "transmit timeout",
    LOST_ARBITRATION: "lost arbitration",
    CONTROLLER: "controller",
    PROTOCOL: "protocol violation",
    TRANSCEIVER: "transceiver",
    NO_ACKNOWLEDGE: "no acknowledge",
    BUS_OFF: "bus-off",
    BUS_ERROR: "bus error",
    RESTARTED: "controller restarted",
}
_CONTROLLER_STATES = {
    0x01: "receive overflow",
    0x02: "transmit overflow",
    0x04: "receive warning",
    0x08: "transmit warning",
    0x10: "receive passive",
    0x20: "transmit passive",
    0x40: "active again",
}


def name_of(message: can.Message) -> str:
    """An error frame in words.

    Parameters
    ----------
    message : can.Message

    Returns
    -------
    str
        Its classes, the controller's state in brackets; `unknown` without any.
    """
    words = []
    for bit, text in _CLASSES.items():
        if not message.arbitration_id & bit:
            continue
        state = message.data[1] if bit == CONTROLLER and len(message.data) > 1 else 0
        details = [word for flag, word in _CONTROLLER_STATES.items() if state & flag]
        words.append(f"{text} ({', '.join(details)})" if details else text)
    return ", ".join(words) or "unknown"


def error_frame(classes: int) -> can.Message:
    """An error frame of some classes, as a controller would report it.

    Parameters
    ----------
    classes : int

    Returns
    -------
    can.Message
    """
    return can.Message(
        arbitration_id=classes, is_extended_id=False, is_error_frame=True, data=bytes(8)
    )
