"""Stamped messages between CDR bytes and arrays, a whole block of messages at a time.

Every type that is decoded here is a header, at most one list of names, and float64 values.
Messages of one topic nearly always have the same layout, so the layout is worked out once from
a message, each further message is checked against it byte by byte, and the values come out by
views on one matrix. CDR as ROS 2 writes it (OMG formal/21-03-02, 10.2 "plain CDR"): a 4-byte
encapsulation head, then values aligned to their own size counted from behind that head.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hydro_model.arrays import ByteArray, FloatArray, IntArray
from hydro_msgs_docs.errors import ContractError

JOINT_STATE = "sensor_msgs/msg/JointState"
POINT_STAMPED = "geometry_msgs/msg/PointStamped"
FLUID_PRESSURE = "sensor_msgs/msg/FluidPressure"
TEMPERATURE = "sensor_msgs/msg/Temperature"

#: Fields behind the header: "names" is string[], "list" float64[], a number that many float64.
FIELDS: Mapping[str, tuple[tuple[str, str | int], ...]] = {
    JOINT_STATE: (
        ("name", "names"),
        ("position", "list"),
        ("velocity", "list"),
        ("effort", "list"),
    ),
    POINT_STAMPED: (("point", 3),),
    FLUID_PRESSURE: (("fluid_pressure", 1), ("variance", 1)),
    TEMPERATURE: (("temperature", 1), ("variance", 1)),
}
_ENCAPSULATION = {0: ">", 1: "<"}
_MAX_NAMES = 4096


class CdrError(ContractError, ValueError):
    """Bytes that are no message of the expected type, with what was found at which offset."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the values of a message lie, and which of its bytes tell that they lie there.

    Attributes
    ----------
    names : tuple of str
    frame_id : str
    values : mapping of str to (int, int)
        Field -> byte offset and number of float64.
    order : {"<", ">"}
        Byte order.
    size : int
        Bytes up to the last value; messages may carry padding behind.
    template, mask : (size,) uint8 arrays
        A message has this layout where ``(message ^ template) & mask`` is zero.
    """

    names: tuple[str, ...]
    frame_id: str
    values: Mapping[str, tuple[int, int]]
    order: str
    size: int
    template: ByteArray
    mask: ByteArray

    def matches(self, messages: ByteArray) -> NDArray[np.bool_]:
        """Which rows of an (N, size) uint8 array have this layout."""
        differs = messages ^ self.template
        differs &= self.mask
        # Whether any row differs is much sooner known than which.
        if not differs.any():
            return np.ones(len(messages), dtype=np.bool_)
        return np.asarray(~differs.any(axis=1), dtype=np.bool_)

    def stamp_ns(self, messages: ByteArray) -> IntArray:
        """Header stamps of an (N, size) array of messages, (N,) int64 nanoseconds."""
        sec = _column(messages, 4, 4, f"{self.order}i4").astype(np.int64)
        nanosec = _column(messages, 8, 4, f"{self.order}u4").astype(np.int64)
        return (sec * 1_000_000_000 + nanosec)[:, 0]

    def field(self, messages: ByteArray, name: str) -> FloatArray:
        """One field of an (N, size) array of messages, (N, k) float64."""
        offset, count = self.values[name]
        return _column(messages, offset, 8 * count, f"{self.order}f8").astype(np.float64)


def _column(messages: ByteArray, offset: int, size: int, kind: str) -> NDArray[np.generic]:
    return messages[:, offset : offset + size].view(kind)


class Cursor:
    """Reads one message and remembers which bytes carry structure."""

    def __init__(self, message: bytes) -> None:
        self.message = message
        self.structure: list[tuple[int, int]] = [(0, 2)]
        if len(message) < 4:
            raise CdrError(f"expected a CDR message, found {len(message)} bytes")
        kind = int.from_bytes(message[:2], "big")
        if kind not in _ENCAPSULATION:
            raise CdrError(f"expected plain CDR (encapsulation 0 or 1), found {kind}")
        self.order = _ENCAPSULATION[kind]
        self.at = 4

    def skip(self, size: int) -> int:
        """Step over `size` bytes that are there; returns where they begin."""
        begin = self.at
        if size > len(self.message) - begin:
            raise CdrError(
                f"expected {size} bytes at offset {begin}, found {len(self.message) - begin}"
            )
        self.at += size
        return begin

    def align(self, size: int) -> None:
        """Step to the next multiple of `size` counted from behind the encapsulation head."""
        self.at += -(self.at - 4) % size

    def count(self) -> int:
        """A uint32 that is part of the structure."""
        self.align(4)
        begin = self.skip(4)
        self.structure.append((begin, begin + 4))
        (value,) = struct.unpack_from(f"{self.order}I", self.message, begin)
        return int(value)

    def text(self) -> str:
        """A string with its length and closing zero."""
        size = self.count()
        begin = self.skip(size)
        self.structure.append((begin, begin + size))
        try:
            return self.message[begin : begin + size].rstrip(b"\0").decode("utf-8")
        except UnicodeDecodeError as error:
            raise CdrError(f"expected UTF-8 text at offset {begin}: {error.reason}") from error

    def doubles(self, count: int) -> tuple[int, int]:
        """Offset and number of float64; an empty list is not aligned (as Fast CDR writes it)."""
        if count == 0:
            return self.at, 0
        self.align(8)
        return self.skip(8 * count), count


def layout_of(message: bytes, message_type: str) -> Layout:
    """Work out the layout of a message.

    Parameters
    ----------
    message : bytes
        Serialised, with its encapsulation head.
    message_type : str
        One of `FIELDS`.

    Returns
    -------
    Layout

    Raises
    ------
    CdrError
        The bytes are no such message.
    """
    cursor = Cursor(message)
    cursor.skip(8)
    frame_id = cursor.text()
    names: tuple[str, ...] = ()
    values: dict[str, tuple[int, int]] = {}
    for name, kind in FIELDS[message_type]:
        if kind == "names":
            count = cursor.count()
            if count > _MAX_NAMES:
                raise CdrError(f"expected at most {_MAX_NAMES} names, found {count}")
            names = tuple(cursor.text() for _ in range(count))
        elif kind == "list":
            values[name] = cursor.doubles(cursor.count())
            if values[name][1] not in (0, len(names)):
                raise CdrError(
                    f"expected no or {len(names)} values of {name}, found {values[name][1]}"
                )
        else:
            values[name] = cursor.doubles(int(kind))
    size = cursor.at
    mask = np.zeros(size, dtype=np.uint8)
    for begin, end in cursor.structure:
        mask[begin:end] = 0xFF
    template = np.frombuffer(message[:size], dtype=np.uint8)
    return Layout(names, frame_id, values, cursor.order, size, template, mask)


def _aligned(size: int, to: int) -> int:
    """How many bytes are missing, behind so many with their head, to a multiple of `to`."""
    return -(size - 4) % to


def _text(out: bytearray, text: str) -> None:
    data = text.encode("utf-8") + b"\0"
    out += bytes(_aligned(len(out), 4)) + struct.pack("<I", len(data)) + data


@lru_cache(maxsize=256)
def _opening(frame_id: str, names: tuple[str, ...] | None) -> bytes:
    """Head, an empty stamp and all texts: the same in every message of a topic."""
    out = bytearray(b"\0\1\0\0" + bytes(8))
    _text(out, frame_id)
    if names is not None:
        out += bytes(_aligned(len(out), 4)) + struct.pack("<I", len(names))
        for name in names:
            _text(out, name)
    return bytes(out)


def encode(
    message_type: str,
    stamp_ns: int,
    values: Mapping[str, object],
    *,
    names: tuple[str, ...] = (),
    frame_id: str = "",
) -> bytes:
    """Serialise one message, little-endian plain CDR.

    Parameters
    ----------
    message_type : str
        One of `FIELDS`.
    stamp_ns : int
    values : mapping of str to array_like
        Fields by name; lists that are left out are empty, numbers that are left out zero.
    names : tuple of str
        For types with names.
    frame_id : str

    Returns
    -------
    bytes

    Examples
    --------
    >>> layout_of(encode(TEMPERATURE, 5, {"temperature": 40.0}), TEMPERATURE).size
    36
    """
    fields = FIELDS[message_type]
    unknown = values.keys() - {name for name, _ in fields}
    if unknown:
        raise CdrError(f"{message_type} has no field '{sorted(unknown)[0]}'")
    named = any(kind == "names" for _, kind in fields)
    out = bytearray(_opening(frame_id, names if named else None))
    struct.pack_into("<iI", out, 4, *divmod(int(stamp_ns), 1_000_000_000))
    for name, kind in fields:
        if kind == "names":
            continue
        data = _doubles(values[name]) if name in values else b""
        if kind == "list":
            out += bytes(_aligned(len(out), 4)) + struct.pack("<I", len(data) // 8)
        elif not data:
            data = bytes(8 * int(kind))
        elif len(data) != 8 * int(kind):
            raise CdrError(f"{message_type}.{name} takes {kind} values, found {len(data) // 8}")
        if data:
            out += bytes(_aligned(len(out), 8)) + data
    return bytes(out)


def _doubles(values: object) -> bytes:
    array = np.asarray(values, dtype="<f8")
    if array.ndim > 1:
        raise CdrError(f"expected a number or a list of them, found an array of {array.shape}")
    return array.tobytes()
