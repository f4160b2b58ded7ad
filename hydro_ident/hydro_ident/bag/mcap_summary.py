"""What a complete MCAP file says behind its data: its schemas and channels again, and counts.

Read only where a message's channel is not described in front of it, as after a damaged chunk, and
where no checksum of the data section tells that every record is there.
"""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

_MAGIC_BYTES = 8
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of summary and of its offsets, crc
_HEAD = struct.Struct("<BQ")
_FOOTER_OPCODE, _FOOTER_LENGTH, _STATISTICS_OPCODE = 0x02, 20, 0x0B
_MOST_BYTES = 1 << 24


def summary_records(path: Path) -> list[tuple[int, bytes]]:
    """The records of a file's summary section.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of (int, bytes)
        Opcode and body; none where there is no summary, its checksum does not hold or it is
        larger than 16 MiB.
    """
    tail = _FOOTER.size + _MAGIC_BYTES
    with open(path, "rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        if size < tail:
            return []
        stream.seek(size - tail)
        footer = stream.read(_FOOTER.size)
        opcode, length, start, _, crc = _FOOTER.unpack(footer)
        count = size - tail - start
        known = opcode == _FOOTER_OPCODE and length == _FOOTER_LENGTH and start > 0
        if not known or not 0 < count <= _MOST_BYTES:
            return []
        stream.seek(start)
        data = stream.read(count)
    if crc and zlib.crc32(footer[:-4], zlib.crc32(data)) != crc:
        return []
    return _records(data)


def counted_messages(path: Path) -> int | None:
    """How many messages a file says that it holds; None where it does not say.

    Parameters
    ----------
    path : Path
    """
    for opcode, body in summary_records(path):
        if opcode == _STATISTICS_OPCODE and len(body) >= 8:
            return int.from_bytes(body[:8], "little")
    return None


def _records(data: bytes) -> list[tuple[int, bytes]]:
    records, at = [], 0
    while at + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if length > len(data) - at:
            break
        records.append((opcode, data[at : at + length]))
        at += length
    return records
