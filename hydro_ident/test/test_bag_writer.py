"""The bag writer: what rosbag2 asks of a directory, checksums, chunks, nothing overwritten."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
import yaml
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from hydro_ident.bag.definitions import (
    TYPE_HASHES,
    definition,
    definition_of_class,
    message_class_of,
)
from hydro_ident.bag.metadata import OfferedQos, bag_directory
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import BagError
from hydro_msgs_docs.cdr import JOINT_STATE, TEMPERATURE
from hydro_msgs_docs.topics import MESSAGE_TYPES

STORE = get_typestore(Stores.ROS2_JAZZY)
CONTRACT_TYPES = sorted({*MESSAGE_TYPES.values(), "sensor_msgs/msg/FluidPressure"})


@pytest.mark.parametrize("kind", CONTRACT_TYPES)
def test_definitions_parse_to_the_types_of_jazzy(kind: str) -> None:
    types = get_types_from_msg(definition(kind), kind)
    for name, (_, fields) in types.items():
        assert fields == STORE.fielddefs[name][1], name
    assert TYPE_HASHES[kind] == STORE.hash_rihs01(kind)


@pytest.mark.parametrize("kind", [*CONTRACT_TYPES, "rcl_interfaces/msg/Log"])
def test_definitions_from_installed_classes_parse_to_the_same(kind: str) -> None:
    pytest.importorskip("rclpy")
    types = get_types_from_msg(definition_of_class(message_class_of(kind)), kind)
    for name, (_, fields) in types.items():
        assert fields == STORE.fielddefs[name][1], name


def test_an_unknown_type_is_said(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        with pytest.raises(BagError, match="no definition of message type 'a_msgs/msg/B'"):
            writer.add_topic("/x", "a_msgs/msg/B")
        with pytest.raises(LookupError, match="a_msgs/msg/B"):
            message_class_of("a_msgs/msg/B")


def _two_topics(path: Path, **options: object) -> BagWriter:
    writer = BagWriter(path, **options)  # type: ignore[arg-type]
    latched = OfferedQos(depth=1, durability="transient_local")
    writer.add_topic("/joint_states", JOINT_STATE)
    writer.add_topic("/oil_temperature", TEMPERATURE, qos=[latched])
    return writer


def test_metadata_is_that_of_rosbag2_version_9(tmp_path: Path) -> None:
    path = tmp_path / "20240501-120000_run"
    with _two_topics(path, metadata={"robot": "xs031", "note": "ünïcode: yes"}) as writer:
        for k in range(10):
            writer.write_stamped("/joint_states", 10**18 + k, {"position": [k]}, names=["lift"])
        writer.write_stamped("/oil_temperature", 10**18 + 99, {"temperature": 40.0})
    data = yaml.safe_load((path / "metadata.yaml").read_text(encoding="utf-8"))
    info = data["rosbag2_bagfile_information"]
    assert info["version"] == 9
    assert info["storage_identifier"] == "mcap"
    assert info["message_count"] == 11
    assert info["starting_time"] == {"nanoseconds_since_epoch": 10**18}
    assert info["duration"] == {"nanoseconds": 99}
    assert info["relative_file_paths"] == ["20240501-120000_run_0.mcap"]
    assert info["custom_data"] == {"robot": "xs031", "note": "ünïcode: yes"}
    assert info["compression_format"] == info["compression_mode"] == ""
    topics = {t["topic_metadata"]["name"]: t for t in info["topics_with_message_count"]}
    assert topics["/joint_states"]["message_count"] == 10
    meta = topics["/oil_temperature"]["topic_metadata"]
    assert meta["serialization_format"] == "cdr"
    assert meta["type_description_hash"] == STORE.hash_rihs01(TEMPERATURE)
    (offered,) = meta["offered_qos_profiles"]
    assert offered["durability"] == "transient_local"
    assert offered["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    with Reader(path) as reader:
        assert reader.message_count == 11
        assert reader.duration == 100
        assert {c.topic: c.msgcount for c in reader.connections} == {
            "/joint_states": 10,
            "/oil_temperature": 1,
        }
    assert read_bag(path).metadata == info["custom_data"]


def test_the_file_says_what_rosbag2_reads_without_metadata_yaml(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with _two_topics(path, metadata={"robot": "xs031"}) as writer:
        writer.write_stamped("/joint_states", 10**18, {"position": [1.0]}, names=["lift"])
    with open(path / "bag_0.mcap", "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        records = {m.name: m.metadata for m in reader.iter_metadata()}
        summary = reader.get_summary()
        assert summary is not None
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}
        for channel in summary.channels.values():
            assert yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]["depth"] in (1, 10)
    assert records["hydro"] == {"robot": "xs031"}
    serialized = yaml.safe_load(records["rosbag2"]["serialized_metadata"])
    assert serialized["rosbag2_bagfile_information"]["version"] == 9


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_chunks_and_data_carry_checksums_and_close_every_fifth_of_a_second(
    tmp_path: Path, compression: str
) -> None:
    path = tmp_path / "bag"
    with _two_topics(path, compression=compression) as writer:
        for k in range(1000):
            stamp = 10**18 + k * 2_000_000
            writer.write_stamped("/joint_states", stamp, {"position": [k]}, names=["lift"])
    with open(path / "bag_0.mcap", "rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    chunks = [r for r in records if isinstance(r, Chunk)]
    assert len(chunks) == 10
    for chunk in chunks:
        assert chunk.uncompressed_crc
        assert chunk.message_end_time - chunk.message_start_time < 200_000_000
    bag = read_bag(path)
    assert bag.checksummed
    assert bag.files[0].data_checksum
    assert bag.files[0].compression == {compression}


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_every_chunk_describes_its_channels_and_other_libraries_read_on(
    tmp_path: Path, compression: str
) -> None:
    path = tmp_path / "bag"
    with _two_topics(path, compression=compression) as writer:
        for k in range(500):
            stamp = 10**18 + k * 2_000_000
            writer.write_stamped("/joint_states", stamp, {"position": [k]}, names=["lift"])
            if k in (220, 450):
                writer.write_stamped("/oil_temperature", stamp, {"temperature": 40.0})
    said = []
    with open(path / "bag_0.mcap", "rb") as stream:
        for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
            if isinstance(record, Chunk):
                inside = [type(r).__name__ for r in breakup_chunk(record, validate_crc=True)]
                said.append((inside.count("Schema"), inside.count("Channel")))
    # Both are announced before the first; the oil speaks in the third and in the last again.
    assert said == [(2, 2), (1, 1), (2, 2), (1, 1), (2, 2)]
    for reading in (NonSeekingReader, SeekingReader):
        with open(path / "bag_0.mcap", "rb") as stream:
            messages = list(reading(stream, validate_crcs=True).iter_messages())
            assert [c.topic for _, c, _ in messages].count("/oil_temperature") == 2
            assert {s.name for s, _, _ in messages if s is not None} == {JOINT_STATE, TEMPERATURE}
            assert len(messages) == 502
    with Reader(path) as reader:
        rows = [STORE.deserialize_cdr(d, c.msgtype) for c, _, d in reader.messages()]
        assert [r.position[0] for r in rows if hasattr(r, "position")] == list(range(500))


def test_a_bag_that_is_never_closed_lacks_the_open_chunk_only(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    writer = _two_topics(path)
    for k in range(750):
        stamp = 10**18 + k * 2_000_000
        writer.write_stamped("/joint_states", stamp, {"position": [k]}, names=["lift"])
    assert len(read_bag(path).series["/joint_states"]) == 700
    writer.flush_older_than(10**18 + 1_590_000_000)
    assert len(read_bag(path).series["/joint_states"]) == 700
    writer.flush_older_than(10**18 + 1_600_000_000)
    bag = read_bag(path)
    assert len(bag.series["/joint_states"]) == 750
    assert any("cut off" in loss for loss in bag.losses)
    writer.close()
    writer.close()
    assert read_bag(path).losses == ()


def test_a_new_file_waits_for_no_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    forced: list[int] = []
    force = os.fsync

    def fsync(file: int) -> None:
        forced.append(len(list((tmp_path / "bag").glob("*.mcap"))))
        force(file)

    monkeypatch.setattr(os, "fsync", fsync)
    with _two_topics(tmp_path / "bag", split_ns=100_000_000) as writer:
        for k in range(150):
            stamp = 10**18 + k * 2_000_000
            writer.write_stamped("/joint_states", stamp, {"position": [k]}, names=["lift"])
        assert forced == []
    assert forced == [3, 3]  # the last file, and metadata.yaml


def test_a_clock_that_steps_back_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with _two_topics(path) as writer:
        for k, log_ns in enumerate([5_000_000_000, 5_100_000_000, 1_000_000_000, 1_100_000_000]):
            writer.write_stamped(
                "/joint_states", k, {"position": [k]}, names=["lift"], log_ns=log_ns
            )
    bag = read_bag(path)
    assert bag.series["/joint_states"].fields["position"][:, 0].tolist() == [0, 1, 2, 3]
    info = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert info["starting_time"]["nanoseconds_since_epoch"] == 1_000_000_000
    assert info["duration"]["nanoseconds"] == 4_100_000_000


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with _two_topics(path) as writer:
        writer.write_stamped("/joint_states", 1, {"position": [1.0]}, names=["lift"])
        with pytest.raises(BagError, match="announced twice"):
            writer.add_topic("/joint_states", JOINT_STATE)
    before = {p.name: p.read_bytes() for p in path.iterdir()}
    with pytest.raises(BagError, match="exists already"):
        BagWriter(path)
    assert {p.name: p.read_bytes() for p in path.iterdir()} == before
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match="cannot be written: Not a directory; give another place"):
        BagWriter(tmp_path / "file" / "bag")


def test_names_of_bags() -> None:
    now = time.struct_time((2024, 5, 1, 9, 8, 7, 0, 0, 0))
    assert bag_directory("out", "lift-1", now) == Path("out/20240501-090807_lift-1")
    for bad in ("", "../x", "a b", "-x"):
        with pytest.raises(BagError, match="expected a bag name"):
            bag_directory("out", bad, now)
