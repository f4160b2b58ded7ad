"""The raw messages of a bag in order, for playing them back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import merge
from itertools import groupby
from pathlib import Path

import numpy as np

from hydro_ident.bag.arrivals import LATE_S
from hydro_ident.bag.mcap_types import Channel, unchecked
from hydro_ident.bag.reader import files_of, no_message
from hydro_model.command_line.terminal import advance

#: A topic's own times that step back by more are of a clock that was set: less than `LATE_S`, as
#: a topic ends somewhat before the newest of all.
_STEP_S = 0.5 * LATE_S


@dataclass(frozen=True, slots=True)
class PlayedTopic:
    """A topic of a bag as it can be played.

    Attributes
    ----------
    channel : Channel
    first_ns, last_ns : int
        Reception of its first and of its last message.
    """

    channel: Channel
    first_ns: int
    last_ns: int


@dataclass(frozen=True, slots=True)
class Contents:
    """What there is to play of a bag.

    Attributes
    ----------
    topics : tuple of PlayedTopic
        Those that carry messages, in order of their names.
    damage : tuple of str
        Everything that could not be read, in words; empty for a sound bag.
    unchecked : tuple of str
        What is under no checksum, in a line; empty where every message is under one.
    apart : bool
        Topics do not lie side by side, as of a script that writes one after the other. Where a
        topic's own times of reception step back, as by a clock that was set, they tell no order.
    """

    topics: tuple[PlayedTopic, ...]
    damage: tuple[str, ...]
    unchecked: tuple[str, ...]
    apart: bool = False

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One per topic."""
        return tuple(topic.channel for topic in self.topics)


def contents_of(path: str | Path) -> Contents:
    """Read a bag through, for what there is to play and what is missing.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Contents

    Raises
    ------
    BagError
        No bag, or not a single message.
    """
    files, notes, _ = files_of(Path(path))
    found: dict[str, PlayedTopic] = {}
    every, own = _Onward(LATE_S), dict[str, _Onward]()
    for number, file in enumerate(files, 1):
        for block in file.blocks():
            what = f"looking at file {number} of {len(files)}"
            advance(what, file.health.read_bytes, file.health.size_bytes)
            first, last = int(block.log_ns.min()), int(block.log_ns.max())
            topic = block.channel.topic
            every.add(block.data, first, last)
            own.setdefault(topic, _Onward(_STEP_S)).add(block.data, first, last)
            one = found.get(topic)
            if one is not None:
                first, last = min(first, one.first_ns), max(last, one.last_ns)
            found[topic] = PlayedTopic(block.channel, first, last)
        notes += file.health.told
    if not found:
        raise no_message(Path(path), notes)
    in_order = tuple(found[topic] for topic in sorted(found))
    healths = [file.health for file in files]
    damage = tuple(dict.fromkeys(notes))
    apart = not every.so_far and all(one.so_far for one in own.values())
    return Contents(in_order, damage, unchecked(healths), apart)


@dataclass(slots=True)
class _Onward:
    """Whether no buffer holds messages that are older by `most_s` than those of buffers before."""

    most_s: float
    so_far: bool = True
    _buffer: bytes = b""
    _newest_ns: int | None = None
    _before_ns: int | None = None

    def add(self, data: bytes, first_ns: int, last_ns: int) -> None:
        """Take in the span of times of a block in the buffer `data`."""
        if data is not self._buffer:
            self._buffer, self._before_ns = data, self._newest_ns
        if self._before_ns is not None and first_ns < self._before_ns - round(self.most_s * 1e9):
            self.so_far = False
        self._newest_ns = last_ns if self._newest_ns is None else max(self._newest_ns, last_ns)


def messages_in_order(
    path: str | Path, contents: Contents
) -> Iterator[tuple[Channel, int, bytes]]:
    """As `messages`, of topics that do not lie side by side by time of reception all the same.

    Each of them is read on its own then, so that memory stays flat.

    Parameters
    ----------
    path : str or Path
    contents : Contents
        Of that bag.
    """
    if not contents.apart:
        return messages(path)
    apart = (messages(path, topic.channel.topic) for topic in contents.topics)
    return merge(*apart, key=lambda message: message[1])


def messages(path: str | Path, topic: str | None = None) -> Iterator[tuple[Channel, int, bytes]]:
    """The raw messages of a bag, by time of reception within each chunk.

    What cannot be read is left out; `contents_of` says it.

    Parameters
    ----------
    path : str or Path
    topic : str, optional
        Those of this topic only.

    Yields
    ------
    channel : Channel
    log_ns : int
    data : bytes
        Serialised.
    """
    files, _, _ = files_of(Path(path))
    for file in files:
        # Blocks of one buffer come one after the other.
        for _, group in groupby(file.blocks(), key=lambda block: id(block.data)):
            blocks = [b for b in group if topic is None or b.channel.topic == topic]
            if not blocks:
                continue
            log_ns = np.concatenate([block.log_ns for block in blocks])
            of_block = np.repeat(np.arange(len(blocks)), [len(block.offset) for block in blocks])
            begins = np.concatenate([block.offset for block in blocks])
            ends = begins + np.concatenate([block.length for block in blocks])
            # Columns, not rows of Python objects: a chunk may hold millions of messages.
            for at in np.argsort(log_ns, kind="stable"):
                block = blocks[of_block[at]]
                yield block.channel, int(log_ns[at]), block.data[begins[at] : ends[at]]
