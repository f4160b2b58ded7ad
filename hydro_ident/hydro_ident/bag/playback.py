"""The raw messages of a bag in order, for playing them back."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

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
            rows = sorted(
                (int(log_ns), i, int(offset), int(length))
                for i, block in enumerate(blocks)
                for log_ns, offset, length in zip(
                    block.log_ns, block.offset, block.length, strict=True
                )
            )
            for log_ns, i, offset, length in rows:
                yield blocks[i].channel, log_ns, blocks[i].data[offset : offset + length]


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
