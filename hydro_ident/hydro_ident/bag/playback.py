"""The raw messages of a bag in order, for playing them back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from hydro_ident.bag.mcap_types import Channel, unchecked
from hydro_ident.bag.reader import files_of, no_message


@dataclass(frozen=True, slots=True)
class Contents:
    """What there is to play of a bag.

    Attributes
    ----------
    channels : tuple of Channel
        Those that carry messages, one per topic.
    damage : tuple of str
        Everything that could not be read, in words; empty for a sound bag.
    unchecked : tuple of str
        What is under no checksum, in a line; empty where every message is under one.
    """

    channels: tuple[Channel, ...]
    damage: tuple[str, ...]
    unchecked: tuple[str, ...]


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
    channels: dict[str, Channel] = {}
    for file in files:
        channels.update((block.channel.topic, block.channel) for block in file.blocks())
        notes += file.health.told
    if not channels:
        raise no_message(Path(path), notes)
    in_order = tuple(channels[topic] for topic in sorted(channels))
    healths = [file.health for file in files]
    return Contents(in_order, tuple(dict.fromkeys(notes)), unchecked(healths))


def messages(path: str | Path) -> Iterator[tuple[Channel, int, bytes]]:
    """The raw messages of a bag, by time of reception within each chunk.

    What cannot be read is left out; `contents_of` says it.

    Parameters
    ----------
    path : str or Path

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
            blocks = list(group)
            log_ns = np.concatenate([block.log_ns for block in blocks])
            of_block = np.repeat(np.arange(len(blocks)), [len(block.offset) for block in blocks])
            begins = np.concatenate([block.offset for block in blocks])
            ends = begins + np.concatenate([block.length for block in blocks])
            # Columns, not rows of Python objects: a chunk may hold millions of messages.
            for at in np.argsort(log_ns, kind="stable"):
                block = blocks[of_block[at]]
                yield block.channel, int(log_ns[at]), block.data[begins[at] : ends[at]]
