"""Bag to columns, against other readers and against the floor of unpacking it."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from hydro_ident.bag.reader import read_bag
from hydro_ident.bench.job import Job
from hydro_ident.study.long_bag import write_repeated
from hydro_ident.study.synthetic import synthetic_recording
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.messages import VECTOR_FIELDS

RUN_S, REPEATS = 20.0, 3
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
    """Reading all topics of a bag into columns; peers that are missing are said."""
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
            assert found.keys() == expected.keys()
            for topic, values in expected.items():
                np.testing.assert_array_equal(found[topic], values, err_msg=topic)

        yield Job(name, peer, goal, lambda: read_bag(bag), theirs, check)
    peer = "unpacking its chunks and touching every byte (floor)"
    yield Job(
        name, peer, 1.0 / 2.5, lambda: read_bag(bag), lambda: _floor(file), lambda: _whole(file)
    )


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


def _floor(file: Path) -> int:
    total, unpacker = 0, zstandard.ZstdDecompressor()
    with open(file, "rb") as stream:
        for record in StreamReader(ReadDataStream(stream), emit_chunks=True).records:
            if isinstance(record, Chunk):
                data = unpacker.decompress(record.data, record.uncompressed_size)
                total += int(np.frombuffer(data, np.uint8).sum())
    return total


def _whole(file: Path) -> None:
    assert _floor(file) > 0
