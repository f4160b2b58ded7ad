"""What nodes said about themselves: `/diagnostics` of a bag."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

from hydro_ident.bag.mcap_types import MessageBlock
from hydro_msgs_docs.cdr import CdrError, Cursor

DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
LEVELS = ("ok", "warn", "error", "stale")
_MOST_ENTRIES = 10_000
#: A day of ten nodes, once a second; and the size of one message.
_MOST_STATUSES, _MOST_BYTES = 1_000_000, 1 << 20


@dataclass(frozen=True, slots=True)
class Status:
    """One status of one node (REP-107).

    Attributes
    ----------
    stamp_ns : int
    level : str
        One of `LEVELS`.
    name, message : str
    values : mapping of str to str
    """

    stamp_ns: int
    level: str
    name: str
    message: str
    values: Mapping[str, str]


def statuses_of(data: bytes) -> list[Status]:
    """Decode one serialised DiagnosticArray.

    Parameters
    ----------
    data : bytes

    Returns
    -------
    list of Status

    Raises
    ------
    CdrError
        The bytes are no such message.
    """
    cursor = Cursor(data)
    sec, nanosec = struct.unpack_from(f"{cursor.order}iI", data, cursor.skip(8))
    cursor.text()
    return [_status(cursor, sec * 1_000_000_000 + nanosec) for _ in range(_few(cursor.count()))]


def _few(count: int) -> int:
    if count > _MOST_ENTRIES:
        raise CdrError(f"expected at most {_MOST_ENTRIES} entries, found {count}")
    return count


def _status(cursor: Cursor, stamp_ns: int) -> Status:
    level = cursor.message[cursor.skip(1)]
    name, message = cursor.text(), cursor.text()
    cursor.text()  # the hardware's identifier
    values = {}
    for _ in range(_few(cursor.count())):
        key = cursor.text()
        values[key] = cursor.text()
    known = LEVELS[level] if level < len(LEVELS) else f"level {level}"
    return Status(stamp_ns, known, name, message, values)


def add_statuses(block: MessageBlock, statuses: list[Status], before: int = 0) -> int:
    """Decode a block onto a list; returns how many messages could not be decoded.

    So many statuses came `before` those of the list.
    """
    malformed = 0
    for offset, length in zip(block.offset, block.length, strict=True):
        if before + len(statuses) > _MOST_STATUSES or length > _MOST_BYTES:
            malformed += 1
            continue
        try:
            statuses += statuses_of(block.data[int(offset) : int(offset + length)])
        except CdrError:
            malformed += 1
    return malformed
