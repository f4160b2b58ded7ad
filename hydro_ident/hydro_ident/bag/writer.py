"""Writes bags of the contract: rosbag2 directories with MCAP storage that survive a kill.

Chunks are closed and handed to the operating system every 0.2 s of log time, under checksums,
and each can be read alone. A process that dies loses the chunk it was filling, no more.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from mcap.writer import CompressionType, IndexType, Writer
from numpy.typing import ArrayLike

from hydro_ident.bag.definitions import TYPE_HASHES, definition
from hydro_ident.bag.described_chunks import describe_in_every_chunk
from hydro_ident.bag.metadata import (
    FileRecord,
    OfferedQos,
    TopicRecord,
    metadata_text,
    qos_text,
)
from hydro_ident.bag.reader import METADATA_FILE, PROJECT_METADATA
from hydro_ident.errors import BagError
from hydro_model.command_line.output import unwritable, write_atomically
from hydro_msgs_docs.cdr import encode

CHUNK_NS = 200_000_000
#: A new file after this much log time keeps the index that a writer holds in memory small.
SPLIT_NS = 1_800_000_000_000
_COMPRESSION = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}


class BagWriter:
    """A bag that is being written; also a context manager that closes it.

    Parameters
    ----------
    directory : Path
        Must not exist: nothing is ever overwritten.
    metadata : mapping of str to str
        Robot, mapping, controller parameters, software version, operator's note ...; kept at
        the front of every file and in metadata.yaml.
    compression : {"zstd", "lz4", "none"}
    split_ns : int
        Log time per file.

    Raises
    ------
    BagError
        The directory exists or cannot be made.
    """

    def __init__(
        self,
        directory: str | Path,
        metadata: Mapping[str, str] | None = None,
        *,
        compression: str = "zstd",
        split_ns: int = SPLIT_NS,
    ) -> None:
        self.directory = Path(directory)
        self._metadata = dict(metadata or {})
        self._compression = _COMPRESSION[compression]
        self._split_ns = split_ns
        self._topics: dict[str, TopicRecord] = {}
        self._definitions: dict[str, str] = {}
        self._files: list[FileRecord] = []
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._chunk_ns: int | None = None
        self._closed = False
        #: Longest that the disk took for a chunk, s.
        self.slowest_s = 0.0
        try:
            self.directory.mkdir(parents=True, exist_ok=False)
            self._open_file()
        except FileExistsError as error:
            raise BagError(f"{self.directory}: exists already, nothing overwritten") from error
        except OSError as error:
            raise BagError(unwritable(self.directory, error)) from error

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written per topic."""
        return {record.topic: record.count for record in self._topics.values()}

    @property
    def metadata(self) -> dict[str, str]:
        """What is kept beside the messages."""
        return dict(self._metadata)

    def add_metadata(self, more: Mapping[str, str]) -> None:
        """Keep more beside the messages: in a record of its own, and in what is written later.

        Parameters
        ----------
        more : mapping of str to str
        """
        self._metadata |= more
        self._writer.add_metadata(PROJECT_METADATA, dict(more))
        self._stream.flush()

    def add_topic(
        self,
        topic: str,
        message_type: str,
        *,
        qos: Sequence[OfferedQos] = (OfferedQos(),),
        text: str | None = None,
        type_hash: str | None = None,
    ) -> None:
        """Announce a topic before its first message.

        Parameters
        ----------
        topic, message_type : str
            The type as `package/msg/Name`.
        qos : sequence of OfferedQos
            Of its publishers.
        text, type_hash : str, optional
            Definition and RIHS01 hash; known for the types of the contract.
        """
        if topic in self._topics:
            raise BagError(f"{self.directory}: topic {topic} announced twice")
        if text is None:
            try:
                text = definition(message_type)
            except KeyError as error:
                raise BagError(f"no definition of message type '{message_type}'") from error
        known = TYPE_HASHES.get(message_type, "")
        record = TopicRecord(topic, message_type, type_hash or known, tuple(qos))
        self._topics[topic] = record
        self._definitions[message_type] = text
        self._register(record)

    def write(self, topic: str, data: bytes, log_ns: int, publish_ns: int | None = None) -> None:
        """Append one serialised message.

        Parameters
        ----------
        topic : str
            Announced before.
        data : bytes
            CDR with its encapsulation head.
        log_ns : int
            When it was received.
        publish_ns : int, optional
            When it was published; `log_ns` by default.
        """
        file = self._files[-1]
        if file.count and log_ns - file.first_ns >= self._split_ns:
            # Forcing it onto the disk here would keep what comes meanwhile waiting.
            self._finish_file(force=False)
            self._open_file()
            file = self._files[-1]
        # A stepped clock may go backwards: that closes the chunk, too.
        if self._chunk_ns is not None and not 0 <= log_ns - self._chunk_ns < CHUNK_NS:
            self.flush()
        if self._chunk_ns is None:
            self._chunk_ns = log_ns
        record = self._topics[topic]
        self._writer.add_message(
            channel_id=self._channels[topic],
            log_time=log_ns,
            data=data,
            publish_time=log_ns if publish_ns is None else publish_ns,
            sequence=record.count & 0xFFFFFFFF,
        )
        record.count += 1
        file.add(log_ns)

    def write_stamped(
        self,
        topic: str,
        stamp_ns: int,
        values: Mapping[str, ArrayLike],
        *,
        names: Sequence[str] = (),
        log_ns: int | None = None,
        frame_id: str = "",
    ) -> None:
        """Serialise and append one message of a type of `cdr.FIELDS`.

        Parameters
        ----------
        topic : str
            Announced before.
        stamp_ns : int
            Header stamp.
        values : mapping of str to array_like
            Fields, e.g. `position` and `effort`, or `point`.
        names : sequence of str
            Of a JointState.
        log_ns : int, optional
            `stamp_ns` by default.
        frame_id : str
        """
        data = encode(
            self._topics[topic].message_type,
            stamp_ns,
            values,
            names=tuple(names),
            frame_id=frame_id,
        )
        self.write(topic, data, stamp_ns if log_ns is None else log_ns)

    def flush(self) -> None:
        """Close the chunk that is being filled and hand it to the operating system."""
        self._chunk_ns = None
        began_s = time.monotonic()
        self._writer.flush()
        self.slowest_s = max(self.slowest_s, time.monotonic() - began_s)

    def flush_older_than(self, log_ns: int) -> None:
        """Close the chunk unless it was begun within the 0.2 s before `log_ns`."""
        if self._chunk_ns is not None and not 0 <= log_ns - self._chunk_ns < CHUNK_NS:
            self.flush()

    def close(self) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._finish_file(force=True)
        write_atomically(self.directory / METADATA_FILE, self._metadata_text())

    def abandon(self) -> None:
        """Leave the bag as it is on the disk, where writing failed; then `close` does nothing."""
        self._closed = True
        with suppress(OSError):
            self._stream.close()

    def _metadata_text(self) -> str:
        return metadata_text(self._files, list(self._topics.values()), self._metadata)

    def _open_file(self) -> None:
        name = f"{self.directory.name}_{len(self._files)}.mcap"
        self._stream: IO[bytes] = open(self.directory / name, "xb")  # noqa: SIM115
        self._files.append(FileRecord(name))
        self._channels, self._schemas = {}, {}
        self._writer: Any = Writer(
            self._stream,
            compression=self._compression,
            index_types=IndexType.ALL,
            enable_crcs=True,
            enable_data_crcs=True,
        )
        describe_in_every_chunk(self._writer)
        self._writer.start(profile="ros2", library="hydro_ident")
        if self._metadata:
            self._writer.add_metadata(PROJECT_METADATA, self._metadata)
        for record in self._topics.values():
            self._register(record)
        self._stream.flush()

    def _finish_file(self, *, force: bool) -> None:
        self._chunk_ns = None
        # What `ros2 bag` reads of a single file without its metadata.yaml.
        self._writer.add_metadata("rosbag2", {"serialized_metadata": self._metadata_text()})
        self._writer.finish()
        self._stream.flush()
        if force:
            os.fsync(self._stream.fileno())
        self._stream.close()

    def _register(self, record: TopicRecord) -> None:
        kind = record.message_type
        if kind not in self._schemas:
            text = self._definitions[kind].encode("utf-8")
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text)
        self._channels[record.topic] = self._writer.register_channel(
            topic=record.topic,
            message_encoding="cdr",
            schema_id=self._schemas[kind],
            metadata={
                "offered_qos_profiles": qos_text(record.qos),
                "topic_type_hash": record.type_hash,
            },
        )
