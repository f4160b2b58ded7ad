"""What the reading of an MCAP file yields: channels, blocks of messages, the file's health."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hydro_model.arrays import IntArray

_MOST_LOSSES = 100


@dataclass(frozen=True, slots=True)
class Channel:
    """A channel of one file: its topic, type and what its writer offered.

    Attributes
    ----------
    topic, message_type, encoding, schema_encoding : str
        `encoding` is the messages' (cdr), `schema_encoding` the definition's (ros2msg).
    definition : str
        Text of the schema.
    metadata : mapping of str to str
        `offered_qos_profiles` and the like.
    """

    topic: str
    message_type: str
    encoding: str
    schema_encoding: str
    definition: str
    metadata: dict[str, str]


@dataclass(frozen=True, slots=True)
class MessageBlock:
    """Messages of one channel that lie in one buffer.

    Attributes
    ----------
    channel : Channel
    data : bytes
        The buffer (a decompressed chunk, or a piece of the file).
    offset, length : (N,) arrays
        Where each serialised message lies in `data`.
    log_ns, publish_ns : (N,) arrays
    """

    channel: Channel
    data: bytes
    offset: IntArray
    length: IntArray
    log_ns: IntArray
    publish_ns: IntArray


@dataclass(slots=True)
class FileHealth:
    """What was found out about one file while reading it.

    Attributes
    ----------
    path : Path
    profile, library : str
        Of the header.
    size_bytes, read_bytes : int
        Size of the file, and how far it could be read.
    chunks, checked_chunks : int
        Chunks read, and those that carried a checksum.
    compression : set of str
        "none", "lz4", "zstd" as met.
    complete : bool
        The file ends as the format asks; False for a file cut off.
    data_checksum : bool
        The data section carried a checksum, and it held.
    checksum_failed : bool
        A checksum was there and did not hold.
    messages, loose_messages : int
        Messages found, and how many of them outside chunks.
    losses : list of str
        Each loss in words, the first hundred of them and how many more there are.
    """

    path: Path
    profile: str = ""
    library: str = ""
    size_bytes: int = 0
    read_bytes: int = 0
    chunks: int = 0
    checked_chunks: int = 0
    compression: set[str] = field(default_factory=set)
    complete: bool = False
    data_checksum: bool = False
    checksum_failed: bool = False
    messages: int = 0
    loose_messages: int = 0
    losses: list[str] = field(default_factory=list)
    _more: int = 0

    @property
    def told(self) -> list[str]:
        """The losses with the file's name."""
        return [f"{self.path.name}: {loss}" for loss in self.losses]

    def lose(self, text: str) -> None:
        """Say a loss; a file made of nothing else does not fill the memory with them."""
        if len(self.losses) < _MOST_LOSSES:
            self.losses.append(text)
            return
        self._more += 1
        self.losses[_MOST_LOSSES:] = [f"and {self._more} more losses"]


def unchecked(files: Sequence[FileHealth]) -> tuple[str, ...]:
    """What of a bag lies under no checksum that held.

    Parameters
    ----------
    files : sequence of FileHealth
        Of the bag, read to their ends.

    Returns
    -------
    tuple of str
        One line; none where every message is under a checksum.
    """
    bare = [f for f in files if not f.data_checksum]
    chunks = sum(f.chunks - f.checked_chunks for f in bare)
    loose = sum(f.loose_messages for f in bare)
    where = [f"{chunks} of {sum(f.chunks for f in files)} chunks"] if chunks else []
    where += [f"{loose} message{'s' if loose > 1 else ''} outside chunks"] if loose else []
    if not where:
        return ()
    said = f"not checksummed: {' and '.join(where)}; bytes that changed there go unnoticed"
    return (said,)
