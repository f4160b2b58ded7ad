"""Frames with other contents under valid protection: broken sensors and counters. Pure."""

from __future__ import annotations

import can

from hydro_hw_bridge.faults.bus_faults import BusFault
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.e2e import alive_counter, protect

LOCKSTEP_BIT = "lockstep"
#: Times this, modulo 2^32, no two sample counters in a row are near each other (Knuth's hash).
_WILD = 2_654_435_761


class Contents:
    """Applies the content faults; remembers what was there when a fault began.

    Parameters
    ----------
    codec : Codec
    """

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self._frames = {frame.identifier: frame for frame in codec.layout.frames}
        self._first: dict[tuple[BusFault, int], bytes] = {}

    def applied(self, fault: BusFault, message: can.Message) -> can.Message:
        """A frame as it is with the fault.

        Parameters
        ----------
        fault : BusFault
            Of a content kind, acting, and about this frame.
        message : can.Message

        Returns
        -------
        can.Message
        """
        identifier = message.arbitration_id
        first = self._first.setdefault((fault, identifier), bytes(message.data))
        if fault.kind == "frozen":
            return copy_of(message, first)
        data = bytearray(message.data)
        if fault.kind == "frozen_alive":
            return self._protected(message, data, alive_counter(first))
        name = fault.signal
        if fault.kind == "wild":
            name = self._codec.mapping.counter
        if fault.kind == "clock_bit":
            name = self._codec.mapping.status[LOCKSTEP_BIT]
        signal = self._codec.layout.signals.get(name)
        if signal is None or signal.frame != self._frames[identifier].name:
            return message
        raw = signal.unpack(data)
        if fault.kind == "stuck":
            raw = signal.unpack(first)
        elif fault.kind == "jump":
            raw = min(max(raw + fault.amount, signal.low), signal.high)
        elif fault.kind == "extreme":
            raw = signal.high if fault.amount else signal.low
        elif fault.kind == "wild":
            raw = raw * _WILD & signal.high
        else:
            raw = 1 - raw
        empty = int.from_bytes(data, "little") & ~signal.bits()
        data[:] = empty.to_bytes(len(data), "little")
        signal.pack(raw, data)
        alive = raw if fault.kind == "wild" else alive_counter(data)
        return self._protected(message, data, alive)

    def _protected(self, message: can.Message, data: bytearray, alive: int) -> can.Message:
        identifiers = self._frames[message.arbitration_id].identifiers
        if identifiers is not None:
            protect(data, alive, identifiers)
        return copy_of(message, bytes(data))


def copy_of(message: can.Message, data: bytes) -> can.Message:
    """A message with the same identifier and other bytes."""
    return can.Message(
        arbitration_id=message.arbitration_id,
        is_extended_id=message.is_extended_id,
        data=data,
        check=False,
    )
