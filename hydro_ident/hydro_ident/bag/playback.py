"""The raw messages of a bag in order, for playing them back."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

from hydro_ident.bag.mcap_types import Channel
from hydro_ident.bag.reader import files_of
from hydro_ident.errors import BagError


def messages(path: str | Path) -> Iterator[tuple[Channel, int, bytes]]:
    """The raw messages of a bag, by time of reception within each chunk.

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


def bag_channels(path: str | Path) -> list[Channel]:
    """The channels of a bag that carry messages, one per topic.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    list of Channel

    Raises
    ------
    BagError
        No bag, or not a single message.
    """
    files, _, _ = files_of(Path(path))
    channels = {b.channel.topic: b.channel for file in files for b in file.blocks()}
    if not channels:
        raise BagError(f"{path}: no message in this bag")
    return [channels[topic] for topic in sorted(channels)]
