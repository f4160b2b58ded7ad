"""AUTOSAR end-to-end protection, profile 2, on single frames.

Byte 0 is the CRC-8 over the other bytes and one data identifier; the low nibble of byte 1 is the
alive counter, which also selects the identifier out of sixteen. cantools computes the CRC of every
byte once, so a frame of ours is by construction what any profile 2 tool accepts; its own loop over
the bits takes 6 us a frame, too long for all frames of the 500 Hz path.
"""

from __future__ import annotations

from collections.abc import Sequence

from cantools.autosar.end_to_end import compute_profile2_crc

IDENTIFIERS = 16
ALIVE_MASK = IDENTIFIERS - 1
#: Bits of a frame that belong to the protection: the CRC byte and the alive nibble.
PROTECTED_BITS = 0xFFF
#: Start value of the CRC, and what is added to its end.
_FLIPPED = 0xFF
#: What a byte makes of a CRC of 0. A first byte like the start value leaves 0, so that of the two
#: bytes that cantools is given here only the second, the data identifier, is seen.
_TABLE = bytes(compute_profile2_crc(b"\x00\xff", byte) ^ _FLIPPED for byte in range(256))


def alive_counter(data: bytes | bytearray) -> int:
    """The alive counter of a protected frame, 0 to 15."""
    return data[1] & ALIVE_MASK


def protect(data: bytearray, alive: int, identifiers: Sequence[int]) -> None:
    """Write alive counter and CRC into a frame, in place.

    Parameters
    ----------
    data : bytearray
        At least two bytes.
    alive : int
        Any counter; its low four bits are used.
    identifiers : sequence of int
        The frame's sixteen data identifiers.
    """
    alive &= ALIVE_MASK
    data[1] = data[1] & ~ALIVE_MASK | alive
    data[0] = _crc(data, identifiers[alive])


def is_intact(data: bytes | bytearray, identifiers: Sequence[int]) -> bool:
    """Whether the CRC fits the frame and its alive counter.

    Parameters
    ----------
    data : bytes
    identifiers : sequence of int

    Returns
    -------
    bool
    """
    if len(data) < 2:
        return False
    return data[0] == _crc(data, identifiers[alive_counter(data)])


def _crc(data: bytes | bytearray, identifier: int) -> int:
    """CRC-8 over all bytes but the first, and the data identifier."""
    crc = _FLIPPED
    for byte in data[1:]:
        crc = _TABLE[crc ^ byte]
    return _TABLE[crc ^ identifier] ^ _FLIPPED
