"""Signals of a DBC as shifts and masks.

cantools reads the DBC and is the oracle of the tests; decoding one frame with it costs some
20 us, so the 500 Hz path extracts the few raw integers it needs by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.protocol.mapping import LARGEST


@dataclass(frozen=True, slots=True)
class RawSignal:
    """Where an integer signal sits in its frame, and its scaling.

    Attributes
    ----------
    frame, name : str
    size : int
        Bytes of the frame.
    shift, length : int
        Position of the least significant bit in the frame read as one integer, and bits.
    little_endian, signed : bool
    scale, offset : float
        Physical value = scale * raw + offset.
    """

    frame: str
    name: str
    size: int
    shift: int
    length: int
    little_endian: bool
    signed: bool
    scale: float
    offset: float

    @property
    def _mask(self) -> int:
        return (1 << self.length) - 1

    @property
    def low(self) -> int:
        """Smallest raw value."""
        return -(1 << (self.length - 1)) if self.signed else 0

    @property
    def high(self) -> int:
        """Largest raw value."""
        return (1 << (self.length - 1)) - 1 if self.signed else self._mask

    def bits(self) -> int:
        """The bits it occupies, in the frame read as one little-endian integer."""
        data = bytearray(self.size)
        self.pack(-1 if self.signed else self._mask, data)
        return int.from_bytes(data, "little")

    def unpack(self, data: bytes | bytearray) -> int:
        """The raw value in a frame."""
        whole = int.from_bytes(data, "little" if self.little_endian else "big")
        raw = whole >> self.shift & ((1 << self.length) - 1)
        return raw - (1 << self.length) if self.signed and raw >> (self.length - 1) else raw

    def pack(self, raw: int, data: bytearray) -> None:
        """Write a raw value into a frame whose bits of this signal are zero."""
        if self.little_endian:
            whole = int.from_bytes(data, "little") | (raw & self._mask) << self.shift
            data[:] = whole.to_bytes(self.size, "little")
        else:
            whole = int.from_bytes(data, "big") | (raw & self._mask) << self.shift
            data[:] = whole.to_bytes(self.size, "big")


def raw_signal(message: Any, signal: Any) -> RawSignal:
    """A signal of a cantools message.

    Parameters
    ----------
    message : cantools.database.can.Message
    signal : cantools.database.can.Signal

    Returns
    -------
    RawSignal

    Raises
    ------
    BridgeError
        The signal is multiplexed or a floating-point number.
    """
    where = f"signal {message.name}.{signal.name}"
    if signal.multiplexer_ids is not None or signal.is_multiplexer or signal.is_float:
        raise BridgeError(
            f"{where}: expected a plain integer, found a multiplexed or float signal"
        )
    scale, offset = float(signal.scale), float(signal.offset)
    if not 1.0 / LARGEST <= abs(scale) <= LARGEST or not abs(offset) <= LARGEST:
        raise BridgeError(
            f"{where}: expected a factor from {1.0 / LARGEST:g} to {LARGEST:g} and no larger"
            f" offset, found {scale:g} and {offset:g}"
        )
    little = signal.byte_order == "little_endian"
    if little:
        shift = signal.start
    else:
        # Motorola start bits name the most significant bit, counted within its byte from 7 down.
        from_top = 8 * (signal.start // 8) + 7 - signal.start % 8
        shift = 8 * message.length - from_top - signal.length
    return RawSignal(
        frame=message.name,
        name=signal.name,
        size=message.length,
        shift=shift,
        length=signal.length,
        little_endian=little,
        signed=signal.is_signed,
        scale=scale,
        offset=offset,
    )
