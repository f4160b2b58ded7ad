"""AUTOSAR end-to-end protection, profile 2, on single frames.

Byte 0 is the CRC-8 over the other bytes and one data identifier; the low nibble of byte 1 is the
alive counter, which also selects the identifier out of sixteen. cantools computes the CRC, so a
frame of ours is by construction what any profile 2 tool accepts.
"""

from __future__ import annotations

from collections.abc import Sequence

from cantools.autosar.end_to_end import compute_profile2_crc

IDENTIFIERS = 16
ALIVE_MASK = IDENTIFIERS - 1
#: Bits of a frame that belong to the protection: the CRC byte and the alive nibble.
PROTECTED_BITS = 0xFFF


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
    data[0] = compute_profile2_crc(data, identifiers[alive])


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
    return bool(data[0] == compute_profile2_crc(data, identifiers[alive_counter(data)]))
