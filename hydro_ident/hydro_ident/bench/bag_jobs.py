"""Bag to columns, against other readers and against the floor of unpacking it."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import struct
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import MAGIC_SIZE, StreamReader

from hydro_ident.bag.reader import read_bag
from hydro_ident.bench.job import Job, agree
from hydro_ident.study.long_bag import write_repeated
from hydro_ident.study.synthetic import synthetic_recording
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.messages import VECTOR_FIELDS

RUN_S, REPEATS = 20.0, 3
FLOOR = "decompressing its chunks and touching every byte (floor)"
#: Of MCAP: opcode and length of a record; of a chunk times, size, checksum and length of the
#: compression's name, and behind that name the length of the packed bytes.
_RECORD, _CHUNK, _LENGTH = struct.Struct("<BQ"), struct.Struct("<QQQII"), struct.Struct("<Q")
#: All fields of every topic, row by row.
Columns = dict[str, FloatArray]


def write_bag(folder: Path) -> Path:
    """A bag of a minute at 500 Hz, four topics, zstd."""
    path = folder / "bag"
    write_repeated(path, synthetic_recording(load_robot("xs031"), RUN_S, seed=1), REPEATS)
    return path


def write_small(folder: Path) -> Path:
    """A bag of five seconds."""
    path = folder / "small"
    write_repeated(path, synthetic_recording(load_robot("xs031"), 5.0, seed=1), 1)
    return path


def bag_jobs(bag: Path, say: Callable[[str], None]) -> Iterator[Job]:
    """Reading all topics of a bag into columns; peers that are missing are said.

    `say` is told of each.
    """
    (file,) = bag.glob("*.mcap")
    expected = {
        topic: np.concatenate([one.fields[f] for f in VECTOR_FIELDS if f in one.fields], axis=1)
        for topic, one in read_bag(bag).series.items()
    }
    name = "bag to columns, a minute at 500 Hz, zstd"
    readers: dict[str, tuple[str, float, Callable[[Path], Columns]]] = {
        "mcap_ros2": ("mcap-ros2-support", 15.0, _with_mcap_ros2),
        "rosbags": ("rosbags", 8.0, _with_rosbags),
    }
    for module, (peer, goal, reader) in readers.items():
        if importlib.util.find_spec(module) is None:
            say(f"{name}: {peer} is not installed, skipped")
            continue

        def theirs(reader: Callable[[Path], Columns] = reader) -> Columns:
            return reader(bag)

        def check(theirs: Callable[[], Columns] = theirs) -> None:
            found = theirs()
            agree(found.keys() == expected.keys(), f"it reads {', '.join(found) or 'nothing'}")
            for topic, values in expected.items():
                np.testing.assert_array_equal(found[topic], values, err_msg=topic)

        against = f"{peer} {importlib.metadata.version(peer)}"
        yield Job(name, against, goal, lambda: read_bag(bag), theirs, check)
    floor, check_floor = partial(unpacked, file), partial(_all_unpacked, file)
    yield Job(name, FLOOR, 1.0 / 2.5, lambda: read_bag(bag), floor, check_floor)


def _with_rosbags(bag: Path) -> Columns:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    columns: dict[str, list[FloatArray]] = {}
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            values = np.concatenate([message.position, message.velocity, message.effort])
            columns.setdefault(connection.topic, []).append(values)
    return {topic: np.array(rows) for topic, rows in columns.items()}


def _with_mcap_ros2(bag: Path) -> Columns:
    from mcap.reader import make_reader

    decoder = importlib.import_module("mcap_ros2.decoder")
    (file,) = bag.glob("*.mcap")
    columns: dict[str, list[list[float]]] = {}
    with open(file, "rb") as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            values = [*message.position, *message.velocity, *message.effort]
            columns.setdefault(channel.topic, []).append(values)
    return {topic: np.array(rows) for topic, rows in columns.items()}


def unpacked(file: Path) -> tuple[int, int]:
    """Decompress every chunk of an MCAP file and touch every byte, by the cheapest means.

    Records are walked by their lengths alone, and nothing looks into a chunk.

    Parameters
    ----------
    file : Path
        Its chunks compressed with zstd.

    Returns
    -------
    (int, int)
        Bytes that were unpacked, and the sum of them as words of 64 bits (and of the bytes behind
        the last whole one), modulo 2^64.
    """
    size, total, unpacker = 0, 0, zstandard.ZstdDecompressor()
    data = memoryview(file.read_bytes())
    at = MAGIC_SIZE
    while at < len(data) - MAGIC_SIZE:
        kind, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        if kind == Opcode.CHUNK:
            _, _, whole, _, name = _CHUNK.unpack_from(data, at)
            packed = data[at + _CHUNK.size + name + _LENGTH.size : at + length]
            chunk = unpacker.decompress(packed, whole)
            words = len(chunk) // 8
            total += int(np.frombuffer(chunk, np.uint64, words).sum()) + sum(chunk[8 * words :])
            size += len(chunk)
        at += length
    return size, total % 2**64


def _all_unpacked(file: Path) -> None:
    """What the mcap package finds in the file has been unpacked."""
    size = 0
    with open(file, "rb") as stream:
        for record in StreamReader(ReadDataStream(stream), emit_chunks=True).records:
            if isinstance(record, Chunk):
                agree(record.compression == "zstd", f"its chunks are {record.compression}")
                size += record.uncompressed_size
    found = unpacked(file)[0]
    agree(found == size > 0, f"it unpacks {size} bytes, we {found}")
