"""Messages of the 500 Hz path, straight from and to their bytes.

rclpy makes an object of a message field by field, with checks of each: most of what taking one
costs, and half of what publishing one does. What is the same in every message of a topic is
looked at once here, by `hydro_msgs_docs.cdr`; per message the numbers alone go in and out.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from hydro_msgs_docs.cdr import JOINT_STATE, CdrError, Layout, encode, layout_of
from hydro_msgs_docs.hot_loop import HotSubscription
from hydro_msgs_docs.messages import VECTOR_FIELDS, StampedVector

_SECOND_NS = 1_000_000_000
#: Where a message's stamp lies: behind the head of four bytes.
_STAMP_AT = 4
#: Encapsulations that are read: others, whose alignment differs, rclpy takes for these.
_HEADS = (b"\0\0", b"\0\1")
#: Ways in which a topic's senders make their messages that are remembered, by length.
_KNOWN = 8


@dataclass(frozen=True, slots=True)
class _Made:
    """How a message is made: which of its bits tell so and what they say; where numbers are."""

    structure: int
    expected: int
    stamp: struct.Struct
    lists: tuple[tuple[struct.Struct, int], ...]
    names: tuple[str, ...]

    @classmethod
    def of(cls, layout: Layout) -> _Made:
        structure = int.from_bytes(layout.mask.tobytes(), "little")
        places = [layout.values[name] for name in VECTOR_FIELDS]
        return cls(
            structure,
            int.from_bytes(layout.template.tobytes(), "little") & structure,
            struct.Struct(f"{layout.order}iI"),
            tuple((struct.Struct(f"{layout.order}{count}d"), at) for at, count in places),
            layout.names,
        )


class VectorReader:
    """Reads one topic's messages: fast where each is made as one before it."""

    def __init__(self) -> None:
        self._known: dict[int, _Made] = {}

    def read(self, data: bytes) -> StampedVector:
        """A message from its bytes.

        Parameters
        ----------
        data : bytes
            Serialised, with the encapsulation head.

        Returns
        -------
        StampedVector

        Raises
        ------
        CdrError
            They are no such message.
        """
        made = self._known.get(len(data))
        if made is None or int.from_bytes(data, "little") & made.structure != made.expected:
            try:
                made = self._learned(data)
            except CdrError:
                # Lists of another length than the names': legal, and for others to judge.
                return _read_slowly(data)
        sec, nanosec = made.stamp.unpack_from(data, _STAMP_AT)
        lists = (numbers.unpack_from(data, at) for numbers, at in made.lists)
        return StampedVector(sec * _SECOND_NS + nanosec, made.names, *lists)

    def _learned(self, data: bytes) -> _Made:
        made = _Made.of(layout_of(data, JOINT_STATE))
        if any("\0" in name for name in made.names):
            raise CdrError("a name with a zero in it")  # rclpy's ends there
        if len(data) not in self._known and len(self._known) >= _KNOWN:
            self._known.clear()
        self._known[len(data)] = made
        return made


def _read_slowly(data: bytes) -> StampedVector:
    if data[:2] not in _HEADS:
        raise CdrError(f"{len(data)} bytes that are no JointState")
    try:
        return StampedVector.of(deserialize_message(data, JointState))
    except RuntimeError as error:
        raise CdrError(f"{len(data)} bytes that are no JointState") from error


class HotVectors(HotSubscription):
    """A subscription to stamped vectors whose messages are taken by hand, as `StampedVector`.

    Parameters
    ----------
    node : Node
    topic : str
    qos : QoSProfile

    Attributes
    ----------
    unreadable : int
        Messages that were none, and were passed over.
    message : str
        What was wrong with the newest message; empty where it could be read.
    """

    def __init__(self, node: Node, topic: str, qos: QoSProfile) -> None:
        super().__init__(node, JointState, topic, qos, raw=True)
        self._reader = VectorReader()
        self.forget()

    def forget(self) -> None:
        """Count anew."""
        self.unreadable, self.message = 0, ""

    def take_numbered(self) -> tuple[StampedVector, int | None] | None:
        """The next waiting vector and its number, or None, as of `HotSubscription`."""
        while (taken := super().take_numbered()) is not None:
            try:
                vector = self._reader.read(taken[0])
            except CdrError as error:
                self.unreadable += 1
                self.message = f"{self.topic} should carry JointState, found {error}"
            else:
                self.message = ""
                return vector, taken[1]
        return None


class HotMessage:
    """The bytes of one topic's messages, of which only the numbers change.

    Parameters
    ----------
    message_type : str
        One of `hydro_msgs_docs.cdr.FIELDS`.
    sizes : mapping of str to int
        How many values each field has that is filled, in the order in which they are given.
    names : sequence of str
        For types with names.
    frame_id : str

    Raises
    ------
    CdrError
        The type has no such field, or not of such a size.
    """

    def __init__(
        self,
        message_type: str,
        sizes: Mapping[str, int],
        *,
        names: Sequence[str] = (),
        frame_id: str = "",
    ) -> None:
        zero = {field: np.zeros(size) for field, size in sizes.items()}
        data = encode(message_type, 0, zero, names=tuple(names), frame_id=frame_id)
        layout = layout_of(data, message_type)
        self._data = bytearray(data)
        self._stamp = struct.Struct("<iI")
        self._fields = [
            (struct.Struct(f"<{count}d"), at)
            for at, count in (layout.values[field] for field in sizes)
        ]

    def filled(self, stamp: int, *values: Sequence[float]) -> bytes:
        """The message of a stamp, for `rclpy.publisher.Publisher.publish`.

        Parameters
        ----------
        stamp : int
            Nanoseconds of ROS time.
        values : sequence of float
            Of every field of `sizes`.

        Returns
        -------
        bytes

        Raises
        ------
        struct.error
            A field has another number of values.
        ValueError
            There is another number of fields.
        """
        data = self._data
        self._stamp.pack_into(data, _STAMP_AT, *divmod(stamp, _SECOND_NS))
        for (numbers, at), field in zip(self._fields, values, strict=True):
            numbers.pack_into(data, at, *field)
        return bytes(data)
