"""Messages of several chunks gathered into blocks that are worth numpy's price of a call."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

#: Messages are handed on once they are so many, or their buffers of this size.
BLOCK_ROWS, BLOCK_BYTES = 1 << 16, 1 << 20

#: A message record from its length on; the opcode is before, the data behind.
_RECORD = np.dtype(
    [
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_ns", "<u8"),
        ("publish_ns", "<u8"),
    ]
)
#: Bytes of a message record before its data that its length counts.
MESSAGE_HEAD = _RECORD.itemsize - 8


@dataclass(frozen=True, slots=True)
class Gathered:
    """Messages of one channel: their buffer, and columns (N,) of where and when they are.

    Attributes
    ----------
    channel : int
    data : bytes
    offset, length, log_ns, publish_ns : (N,) int64 array
        Of the message's data. Times are unsigned in the file; ROS time is signed, and a wrapped
        one is seen as negative.
    """

    channel: int
    data: bytes
    offset: NDArray[np.int64]
    length: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    publish_ns: NDArray[np.int64]


@dataclass(slots=True)
class Gatherer:
    """Buffers of records, and where in them messages are."""

    _data: list[bytes] = field(default_factory=list)
    _bodies: list[NDArray[np.int64]] = field(default_factory=list)
    _bytes: int = 0
    _rows: int = 0

    def add(self, data: bytes, bodies: NDArray[np.int64]) -> None:
        """Take in a buffer, or more of the messages of the last one.

        Parameters
        ----------
        data : bytes
        bodies : (N,) int64 array
            Where bodies of message records begin in it, with a whole head before and
            `MESSAGE_HEAD` bytes behind; in order.
        """
        if not bodies.size:
            return
        if not self._data or self._data[-1] is not data:
            self._data.append(data)
            self._bytes += len(data)
        self._bodies.append(bodies + (self._bytes - len(data)))
        self._rows += bodies.size

    @property
    def full(self) -> bool:
        """Enough to be handed on."""
        return self._rows >= BLOCK_ROWS or self._bytes >= BLOCK_BYTES

    def take(self) -> Iterator[Gathered]:
        """The messages by channel, in order of their first ones; the gatherer is empty then."""
        if not self._rows:
            return
        data = self._data[0] if len(self._data) == 1 else b"".join(self._data)
        bodies = np.concatenate(self._bodies)
        self._data, self._bodies, self._bytes, self._rows = [], [], 0, 0
        # As bytes without fields numpy copies records several times as fast.
        heads = rows_at(data, bodies - 8, _RECORD.itemsize)
        order = np.argsort(heads.view(_RECORD)["channel"], kind="stable")
        bodies, records = bodies[order], heads[order].view(_RECORD)
        channels = records["channel"]
        bounds = [0, *(np.flatnonzero(channels[1:] != channels[:-1]) + 1).tolist(), len(order)]
        for i in np.argsort(order[bounds[:-1]]):
            group = slice(bounds[i], bounds[i + 1])
            yield Gathered(
                int(channels[group.start]),
                data,
                bodies[group] + MESSAGE_HEAD,
                records["length"][group].astype(np.int64) - MESSAGE_HEAD,
                records["log_ns"][group].astype(np.int64),
                records["publish_ns"][group].astype(np.int64),
            )


def rows_at(data: bytes, begins: NDArray[np.int64], size: int) -> NDArray[np.void]:
    """Pieces of a buffer that are of one size.

    Parameters
    ----------
    data : bytes
    begins : (N,) int64 array
        Where they begin.
    size : int
        Of each; it ends within the buffer.

    Returns
    -------
    (N,) array
        Copied, side by side, of `size` bytes each.
    """
    every: NDArray[np.void] = np.ndarray((len(data) - size + 1,), f"V{size}", data, strides=(1,))
    return every[begins]
