"""What is still to come of a bag behind each block of its messages: how far it may be cut.

A script that writes one topic after the other closes a bag in which the last topic's first
message lies behind all others. Only the whole file tells: it is read through once for its stamps.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hydro_ident.bag.aligned import TYPES
from hydro_ident.bag.clock_restarts import FEW
from hydro_ident.bag.mcap_types import MessageBlock
from hydro_ident.bag.reader import files_of
from hydro_model.arrays import IntArray
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES

#: A message that is further behind the newest of its topic is late.
LATE_S = 1.0
#: Of a topic of which fewer are late, nothing waits for them: strays, or stamps that changed.
_STRAYS, _MOST_STRAYS = 0.01, 1000
#: Encapsulation and stamp, by byte order.
_HEADERS = tuple(
    np.dtype([("kind", "V4"), ("sec", f"{order}i4"), ("nanosec", f"{order}u4")]) for order in "><"
)
_HEADER_BYTES = _HEADERS[0].itemsize
_NOTHING_NS = int(np.iinfo(np.int64).max)
#: Before every stamp, and what is late behind it is an int64 yet.
_NEVER_NS = -_NOTHING_NS // 2


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Stamps of a bag in the order in which they come.

    Attributes
    ----------
    coming_ns : (K + 1,) int64 array
        After so many blocks that `is_joined` takes: the oldest stamp still to come that may be
        that of a cycle.
    pressures : bool
        There are messages of `/chamber_pressures`.
    """

    coming_ns: IntArray
    pressures: bool

    def oldest_ns(self, blocks: int) -> int:
        """The oldest stamp still to come.

        Parameters
        ----------
        blocks : int
            Taken in so far, of those that `is_joined` takes.
        """
        return int(self.coming_ns[min(blocks, len(self.coming_ns) - 1)])


def is_joined(block: MessageBlock) -> bool:
    """Whether the messages of a block become columns of a recording."""
    channel = block.channel
    return TYPES.get(channel.topic) == channel.message_type and channel.encoding == "cdr"


def arrivals_of(path: Path) -> Arrivals:
    """Read a bag through for its stamps, once as long as its files stay the same.

    Parameters
    ----------
    path : Path
        rosbag2 directory or MCAP file.

    Returns
    -------
    Arrivals

    Raises
    ------
    BagError
        As `read_bag`, of files that cannot be read.
    """
    states = [(f.path, f.path.stat()) for f in files_of(path)[0]]
    return _looked_through(path, tuple((p, s.st_size, s.st_mtime_ns) for p, s in states))


@dataclass(slots=True)
class _Stamps:
    """Of one topic."""

    #: The newest stamp that more than `FEW` messages running reached: fewer that leap ahead, as a
    #: stamp that changed on the disk, make nothing late that goes on from before them.
    newest_ns: int = _NEVER_NS
    count: int = 0
    late: int = 0
    #: By number of the block: oldest of all, oldest of those that are not late, and newest.
    blocks: list[tuple[int, int, int, int]] = field(default_factory=list)
    _before_ns: IntArray = field(
        default_factory=lambda: np.full(FEW, _NEVER_NS, dtype=np.int64), repr=False
    )

    def add(self, number: int, stamp_ns: IntArray) -> None:
        row = np.concatenate([self._before_ns, stamp_ns])
        reached = sliding_window_view(row, FEW + 1).min(axis=1)
        so_far = np.maximum(np.maximum.accumulate(reached), self.newest_ns)
        in_time = stamp_ns[stamp_ns >= so_far - round(LATE_S * 1e9)]
        self.newest_ns, self._before_ns = int(so_far[-1]), row[-FEW:].copy()
        self.count += len(stamp_ns)
        self.late += len(stamp_ns) - len(in_time)
        oldest = int(in_time.min()) if len(in_time) else _NOTHING_NS
        self.blocks.append((number, int(stamp_ns.min()), oldest, int(stamp_ns.max())))

    def oldest(self) -> list[tuple[int, int, int]]:
        """Per block its number, the oldest stamp that is waited for, and the newest."""
        strays = self.strays
        return [(n, in_time if strays else every, new) for n, every, in_time, new in self.blocks]

    @property
    def strays(self) -> bool:
        """Late messages are so few that nothing waits for them."""
        return self.late < min(_STRAYS * self.count, _MOST_STRAYS)


@lru_cache(maxsize=32)
def _looked_through(path: Path, states: tuple[tuple[Path, int, int], ...]) -> Arrivals:
    """`states` are what tells whether the files of `path` are still the same."""
    del states
    topics: dict[str, _Stamps] = {}
    count = 0
    for file in files_of(path)[0]:
        for block in file.blocks():
            if not is_joined(block):
                continue
            stamps = _stamps_of(block)
            if len(stamps):
                topics.setdefault(block.channel.topic, _Stamps()).add(count, stamps)
            count += 1
    return Arrivals(_coming_ns(topics, count), CHAMBER_PRESSURES in topics)


def _coming_ns(topics: dict[str, _Stamps], count: int) -> IntArray:
    oldest: IntArray = np.full(count + 1, _NOTHING_NS, dtype=np.int64)
    joints = topics[JOINT_STATES].oldest() if JOINT_STATES in topics else []
    first = min((old for _, old, _ in joints), default=_NOTHING_NS)
    if joints and not topics[JOINT_STATES].strays:
        # Where their clock starts over, only the whole bag tells what is of which run.
        oldest[-1] = first
    for stamps in topics.values():
        for number, old, newest in stamps.oldest():
            # Stamps of another clock before all cycles are none of theirs.
            if newest >= first:
                oldest[number] = old
    return np.minimum.accumulate(oldest[::-1])[::-1]


def _stamps_of(block: MessageBlock) -> IntArray:
    """Header stamps, with which all these messages begin."""
    buffer = np.frombuffer(block.data, dtype=np.uint8)
    there = block.offset[block.length >= _HEADER_BYTES]
    heads = np.ascontiguousarray(sliding_window_view(buffer, _HEADER_BYTES)[there])
    big, little = (
        fields["sec"].astype(np.int64) * 1_000_000_000 + fields["nanosec"].astype(np.int64)
        for fields in (heads.view(kind)[:, 0] for kind in _HEADERS)
    )
    # The second byte of the encapsulation tells the byte order.
    return np.where(heads[:, 1] == 0, big, little)
