"""The records of one MCAP file in file order, as far as they can be read.

The format (https://mcap.dev/spec) is a magic, then records of opcode (1 byte), length (8 bytes)
and body; messages, channels and schemas may sit inside chunks, compressed. Reading straight
through needs no index and ends well wherever the file was cut off. Sizes are checked before
anything is allocated.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from hydro_ident.bag import memory
from hydro_ident.bag.chunks import ChunkError, declared_bytes, decompress_chunk
from hydro_ident.bag.log_kinds import instead_of_bag
from hydro_ident.bag.mcap_gather import BLOCK_BYTES, BLOCK_ROWS, Gatherer
from hydro_ident.bag.mcap_summary import counted_messages, summary_records
from hydro_ident.bag.mcap_types import Channel, FileHealth, MessageBlock
from hydro_ident.bag.record_walk import CHANNEL, MESSAGE, SCHEMA, RecordWalk
from hydro_ident.errors import BagError

MAGIC = b"\x89MCAP0\r\n"
#: No honest writer makes larger records or chunks; a corrupt length is caught here.
MAX_RECORD_BYTES = 1 << 29
#: What chunks may unfold to: so much, and so many times the bytes read. A machine at rest, zeros
#: without noise, is packed to a fiftieth at best.
_FREE_BYTES, _LARGEST_RATIO = 1 << 27, 100
#: Records and chunks above this are asked for: four times their size goes through memory at once.
_LARGE_BYTES, _TIMES = 1 << 24, 4
#: Read from the file at once: beside every chunk are short records.
_BUFFER_BYTES = 1 << 18
#: Text of schemas, channels and metadata that is kept of one file.
_DESCRIBED_BYTES = 1 << 26

HEADER, FOOTER, CHUNK, METADATA, DATA_END = 0x01, 0x02, 0x06, 0x0C, 0x0F

#: Encodings of schemas whose names are those of messages of ROS 2.
_OF_ROS2 = ("ros2msg", "ros2idl")

_HEAD = struct.Struct("<BQ")
_SHORT_PAIR = struct.Struct("<HH")


class McapFile:
    """One MCAP file, read once from the front by `blocks`.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    channels : dict of int to Channel
        Filled while reading.
    metadata : dict of str to dict
        Metadata records by name, filled while reading.
    health : FileHealth
        Complete once `blocks` is exhausted.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.health = FileHealth(path)
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._noted: dict[tuple[int, bytes], bytes] = {}
        self._data_crc = 0
        self._unfolded = self._described = 0
        self._summary_read = False
        self._walk, self._gathered = RecordWalk(self._note), Gatherer()

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages in file order within each channel, block by block.

        Yields
        ------
        MessageBlock

        Raises
        ------
        BagError
            The file cannot be opened, is no MCAP file or has a chunk that no memory is left for.
        """
        try:
            with open(self.path, "rb", _BUFFER_BYTES) as stream:
                self.health.size_bytes = os.fstat(stream.fileno()).st_size
                if self._read_magic(stream):
                    yield from self._records(stream)
                    self._compare_counts()
        except OSError as error:
            raise BagError(f"{self.path}: cannot be read: {error.strerror}") from error

    def _compare_counts(self) -> None:
        """Hold the messages found against the file's own count.

        A record whose kind changed is skipped as one that is not known: no checksum but that of
        the data section notices it, which few writers give.
        """
        health = self.health
        if health.complete and not health.data_checksum:
            counted = counted_messages(self.path)
            if counted is not None and counted != health.messages:
                health.lose(f"its end counts {counted} messages, {health.messages} were found")

    def _read_magic(self, stream: IO[bytes]) -> bool:
        """False for a file that its writer had only just begun: a loss, no error."""
        magic = stream.read(len(MAGIC))
        if magic != MAGIC:
            what = "an empty file" if not magic else f"bytes {magic.hex(' ')}"
            if not MAGIC.startswith(magic):
                other = instead_of_bag(self.path)
                raise BagError(f"{self.path}: expected an MCAP file, found {what}{other}")
            self.health.lose(f"expected an MCAP file, found {what}")
            return False
        self._data_crc = zlib.crc32(magic)
        self.health.read_bytes = len(MAGIC)
        return True

    def _records(self, stream: IO[bytes]) -> Iterator[MessageBlock]:
        loose = bytearray()  # messages outside chunks
        health = self.health
        while True:
            head = stream.read(_HEAD.size)
            if len(head) < _HEAD.size:
                self._cut("in the head of a record" if head else "between records")
                break
            opcode, length = _HEAD.unpack(head)
            left = health.size_bytes - health.read_bytes - _HEAD.size
            if length > MAX_RECORD_BYTES and length <= left:
                health.lose(
                    f"record of {length} bytes at byte {health.read_bytes}: more than"
                    f" {MAX_RECORD_BYTES}, everything behind it left out"
                )
                break
            if length > left:
                self._cut(f"inside a record of {length} bytes")
                if opcode == CHUNK:
                    self._ask(left)
                    yield from self._chunk(stream.read(left), truncated=True)
                break
            self._ask(length)
            body = stream.read(length)
            if opcode == DATA_END:
                self._data_end(body, stream)
                break
            self._data_crc = zlib.crc32(body, zlib.crc32(head, self._data_crc))
            if opcode == MESSAGE:
                loose += head + body
                health.loose_messages += 1
                if len(loose) >= BLOCK_BYTES:
                    yield from self._messages(bytes(loose))
                    loose.clear()
            elif opcode == CHUNK:
                yield from self._chunk(body, truncated=False)
            else:
                self._note(opcode, body)
            health.read_bytes += _HEAD.size + length
        if loose:
            yield from self._messages(bytes(loose))
        yield from self._handed_on()

    def _ask(self, size: int) -> None:
        """See that what is read as one piece fits into memory."""
        if size > _LARGE_BYTES:
            memory.require(
                self.path,
                _TIMES * size,
                what="a chunk",
                found="one that takes up to",
                way_out="write it with smaller chunks",
            )

    def _cut(self, where: str) -> None:
        health = self.health
        rest = health.size_bytes - health.read_bytes
        tail = f", the last {rest} bytes are no complete record" if rest else ""
        health.lose(f"cut off {where} at byte {health.read_bytes}{tail}")

    def _data_end(self, body: bytes, stream: IO[bytes]) -> None:
        health = self.health
        crc = int.from_bytes(body[:4], "little")
        health.data_checksum = crc == self._data_crc
        if crc and not health.data_checksum:
            health.checksum_failed = True
            health.lose("checksum of the data section does not match: bytes changed")
        health.read_bytes = stream.tell()
        stream.seek(-len(MAGIC), os.SEEK_END)
        health.complete = stream.read() == MAGIC
        if not health.complete:
            health.lose("cut off behind the data: all messages are there")
        health.read_bytes = health.size_bytes

    def _note(self, opcode: int, body: bytes) -> None:
        """Take in a record that is neither message nor chunk; unknown ones are skipped."""
        # Writers say them again in every chunk; the number is in the first two bytes.
        if self._noted.get((opcode, body[:2])) == body:
            return
        self._described += len(body) if opcode in (SCHEMA, CHANNEL, METADATA) else 0
        if self._described > _DESCRIBED_BYTES:
            self.health.lose(f"descriptions of more than {_DESCRIBED_BYTES} bytes: left out")
            return
        try:
            if opcode == HEADER:
                self.health.profile, at = _string(body, 0)
                self.health.library, _ = _string(body, at)
            elif opcode == SCHEMA:
                (schema,) = struct.unpack_from("<H", body, 0)
                name, at = _string(body, 2)
                encoding, at = _string(body, at)
                text, _ = _string(body, at)
                self._schemas[schema] = name, encoding, text
                self._noted[opcode, body[:2]] = body
            elif opcode == CHANNEL:
                self._note_channel(body)
                self._noted[opcode, body[:2]] = body
            elif opcode == METADATA:
                name, at = _string(body, 0)
                self.metadata.setdefault(name, {}).update(_mapping(body, at))
        except (struct.error, UnicodeDecodeError, ValueError) as error:
            self.health.lose(
                f"record of kind {opcode} at byte {self.health.read_bytes} is malformed ({error})"
            )

    def _note_channel(self, body: bytes) -> None:
        channel, schema = _SHORT_PAIR.unpack_from(body, 0)
        topic, at = _string(body, 4)
        encoding, at = _string(body, at)
        metadata = _mapping(body, at)
        name, schema_encoding, text = self._schemas.get(schema, ("", "", ""))
        if schema_encoding in _OF_ROS2:
            name = _in_three_parts(name)
        self.channels.setdefault(
            channel, Channel(topic, name, encoding, schema_encoding, text, metadata)
        )

    def _chunk(self, body: bytes, *, truncated: bool) -> Iterator[MessageBlock]:
        health = self.health
        allowed = _FREE_BYTES + _LARGEST_RATIO * (health.read_bytes + len(body)) - self._unfolded
        limit = max(0, min(MAX_RECORD_BYTES, allowed))
        self._ask(min(limit, declared_bytes(body)))
        try:
            chunk = decompress_chunk(body, limit, truncated=truncated)
        except ChunkError as error:
            health.checksum_failed |= error.checksum
            health.lose(f"chunk at byte {health.read_bytes} left out: {error}")
            return
        self._unfolded += len(chunk.data)
        health.chunks += 1
        health.checked_chunks += chunk.checked
        health.compression.add(chunk.compression)
        yield from self._messages(chunk.data, truncated=truncated)

    def _messages(self, data: bytes, *, truncated: bool = False) -> Iterator[MessageBlock]:
        """Find the messages of a buffer; they are handed on together with those of others."""
        rows = 0
        for bodies in self._walk.bodies(data, BLOCK_ROWS):
            self._gathered.add(data, bodies)
            rows += bodies.size
            if rows == BLOCK_ROWS:
                yield from self._handed_on()
                rows = 0
        if not self._walk.whole and not truncated:
            self.health.lose("a chunk ends inside a record: the rest of it left out")
        if self._gathered.full:
            yield from self._handed_on()

    def _handed_on(self) -> Iterator[MessageBlock]:
        """What was gathered of channels that a record describes."""
        for found in self._gathered.take():
            self.health.messages += len(found.offset)
            if found.channel not in self.channels:
                self._note_summary()
            if found.channel not in self.channels:
                self.health.lose(
                    f"{len(found.offset)} messages of channel {found.channel}, which no record"
                    " describes"
                )
                continue
            yield MessageBlock(
                self.channels[found.channel],
                found.data,
                found.offset,
                found.length,
                found.log_ns,
                found.publish_ns,
            )

    def _note_summary(self) -> None:
        """Channels from the end of the file, once: those of a chunk that was lost."""
        if not self._summary_read:
            self._summary_read = True
            for opcode, body in summary_records(self.path):
                if opcode in (SCHEMA, CHANNEL):
                    self._note(opcode, body)


def _in_three_parts(name: str) -> str:
    """The name of a message of ROS 2, which some writers shorten to `package/Message`."""
    package, slash, message = name.partition("/")
    return f"{package}/msg/{message}" if slash and "/" not in message else name


def _string(body: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, at)
    end = at + 4 + length
    if end > len(body):
        raise ValueError(f"a string of {length} bytes where {len(body) - at - 4} are left")
    return body[at + 4 : end].decode("utf-8"), end


def _mapping(body: bytes, at: int) -> dict[str, str]:
    (size,) = struct.unpack_from("<I", body, at)
    at, end = at + 4, at + 4 + size
    pairs: dict[str, str] = {}
    while at < end:
        key, at = _string(body, at)
        pairs[key], at = _string(body, at)
    return pairs
