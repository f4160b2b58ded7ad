"""Messages of the 500 Hz path, straight from and to their bytes.

rclpy makes an object of a message field by field, with checks of each: most of what taking one
costs, and half of what publishing one does. What is the same in every message of a topic is
looked at once here, by `hydro_msgs_docs.cdr`; per message the numbers alone go in and out.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

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


class VectorReader:
    """Reads one topic's messages: fast where each is made as the one before it."""

    def __init__(self) -> None:
        # Of the whole message as one number: which bits tell how it is made, and what they say.
        self._size, self._structure, self._expected = 0, 0, 1
        self._stamp = struct.Struct("<iI")
        self._lists: tuple[tuple[struct.Struct, int], ...] = ()
        self._names: tuple[str, ...] = ()

    def read(self, data: bytes) -> StampedVector:
        """A message from its bytes.

        Parameters
        ----------
        data : bytes
            Serialised, with the encapsulation head.

        Returns
        -------
        StampedVector
        """
        head = int.from_bytes(data[: self._size], "little")
        if head & self._structure != self._expected or len(data) < self._size:
            try:
                self._learn(layout_of(data, JOINT_STATE))
            except CdrError:
                # Lists of another length than the names': legal, and for others to judge.
                return StampedVector.of(deserialize_message(data, JointState))
        sec, nanosec = self._stamp.unpack_from(data, _STAMP_AT)
        lists = (numbers.unpack_from(data, at) for numbers, at in self._lists)
        return StampedVector(sec * _SECOND_NS + nanosec, self._names, *lists)

    def _learn(self, layout: Layout) -> None:
        self._size, self._names = layout.size, layout.names
        self._structure = int.from_bytes(layout.mask.tobytes(), "little")
        self._expected = int.from_bytes(layout.template.tobytes(), "little") & self._structure
        self._stamp = struct.Struct(f"{layout.order}iI")
        self._lists = tuple(
            (struct.Struct(f"{layout.order}{count}d"), at)
            for at, count in (layout.values[name] for name in VECTOR_FIELDS)
        )


class HotVectors(HotSubscription):
    """A subscription to stamped vectors whose messages are taken by hand, as `StampedVector`.

    Parameters
    ----------
    node : Node
    topic : str
    qos : QoSProfile
    """

    def __init__(self, node: Node, topic: str, qos: QoSProfile) -> None:
        super().__init__(node, JointState, topic, qos, raw=True)
        self._reader = VectorReader()

    def take_numbered(self) -> tuple[StampedVector, int | None] | None:
        """The next waiting vector and its number, or None, as of `HotSubscription`."""
        taken = super().take_numbered()
        return None if taken is None else (self._reader.read(taken[0]), taken[1])


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
