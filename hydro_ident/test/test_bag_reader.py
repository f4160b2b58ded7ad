"""The bag reader over every way an MCAP file may be written, cut off or damaged."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from hydro_ident.bag.chunks import ChunkError, decompress_chunk
from hydro_ident.bag.definitions import definition
from hydro_ident.bag.playback import messages
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import read_recording
from hydro_ident.commands import diagnose, inspect
from hydro_ident.errors import BagError
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.cdr import JOINT_STATE, encode

NAMES = ("lift", "tilt")
COUNT = 400
START = 10**18


def _values(k: int) -> list[float]:
    return [k + 0.25, -k / 7.0]


def _write_plain(path: Path, count: int = COUNT, encoding: str = "cdr", **options: object) -> Path:
    """A bare file by mcap's own writer, one topic."""
    with open(path, "wb") as stream:
        writer = Writer(stream, **options)  # type: ignore[arg-type]
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema(JOINT_STATE, "ros2msg", definition(JOINT_STATE).encode())
        channel = writer.register_channel("/joint_states", encoding, schema)
        for k in range(count):
            stamp = START + 2_000_000 * k
            data = encode(JOINT_STATE, stamp, {"position": _values(k)}, names=NAMES)
            writer.add_message(channel, stamp + 5, data, stamp + 1, k)
        writer.finish()
    return path


def _check_prefix(path: Path, least: int = 0) -> int:
    """The series is a prefix of what was written; returns its length."""
    series = read_bag(path).series["/joint_states"]
    count = len(series)
    assert least <= count <= COUNT
    assert series.names == NAMES
    np.testing.assert_array_equal(series.stamp_ns, START + 2_000_000 * np.arange(count))
    np.testing.assert_array_equal(series.log_ns, series.stamp_ns + 5)
    expected = np.array([_values(k) for k in range(count)])
    np.testing.assert_array_equal(series.fields["position"], expected)
    return count


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize("chunk_size", [None, 2000, 1 << 20])
@pytest.mark.parametrize("checksums", [True, False])
def test_every_kind_of_file_reads_alike(
    tmp_path: Path,
    compression: CompressionType,
    indexed: bool,
    chunk_size: int | None,
    checksums: bool,
) -> None:
    path = _write_plain(
        tmp_path / "a.mcap",
        compression=compression,
        index_types=IndexType.ALL if indexed else IndexType.NONE,
        use_chunking=chunk_size is not None,
        chunk_size=chunk_size or 1,
        use_summary_offsets=indexed,
        use_statistics=indexed,
        repeat_channels=indexed,
        repeat_schemas=indexed,
        enable_crcs=checksums,
        enable_data_crcs=checksums,
    )
    bag = read_bag(path)
    assert _check_prefix(path) == COUNT
    assert bag.losses == ()
    assert bag.files[0].complete
    assert bag.checksummed == checksums
    assert bag.topics["/joint_states"].latency_ns == 4


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunk_size", [None, 3000])
def test_a_file_cut_off_anywhere_gives_its_prefix_and_says_so(
    tmp_path: Path, compression: CompressionType, chunk_size: int | None
) -> None:
    whole = _write_plain(
        tmp_path / "whole.mcap",
        compression=compression,
        use_chunking=chunk_size is not None,
        chunk_size=chunk_size or 1,
    ).read_bytes()
    cut = tmp_path / "cut.mcap"
    last = 0
    for size in [*range(0, len(whole), max(1, len(whole) // 150)), len(whole) - 1]:
        cut.unlink(missing_ok=True)  # a file that is emptied goes to the disk each time
        cut.write_bytes(whole[:size])
        try:
            bag = read_bag(cut)
        except BagError:
            continue
        assert any("cut off" in loss for loss in bag.losses), size
        count = _check_prefix(cut)
        assert count >= last
        last = count
    assert last == COUNT


def test_a_project_bag_cut_at_every_byte(tmp_path: Path, write_bag, run_columns, robot) -> None:
    columns = {k: v for k, v in run_columns(8).items() if k != "/joint_reference"}
    (file,) = write_bag(columns, compression="none").glob("*.mcap")
    whole = file.read_bytes()
    cut = tmp_path / "cut.mcap"
    # Every eleventh: records are no multiples of it, so every kind of place is met.
    for size in range(0, len(whole), 11):
        cut.unlink(missing_ok=True)  # a file that is emptied goes to the disk each time
        cut.write_bytes(whole[:size])
        try:
            bag = read_bag(cut)
        except BagError:
            continue
        assert bag.losses
        for topic, series in bag.series.items():
            for field, values in columns[topic][1].items():
                np.testing.assert_array_equal(series.fields[field], values[: len(series)])


def test_changed_bytes_never_pass_as_data(tmp_path: Path, write_bag, run_columns) -> None:
    columns = {k: v for k, v in run_columns(30).items() if k == "/joint_states"}
    (file,) = write_bag(columns).glob("*.mcap")
    whole = bytearray(file.read_bytes())
    flipped = tmp_path / "flipped.mcap"
    rng = np.random.default_rng(1)
    for at in rng.choice(len(whole), 250, replace=False):
        data = bytearray(whole)
        data[at] ^= 1 << int(rng.integers(8))
        flipped.unlink(missing_ok=True)
        flipped.write_bytes(data)
        try:
            bag = read_bag(flipped)
        except BagError:
            continue
        series = bag.series.get("/joint_states")
        if series is None or not len(series):
            assert bag.losses or "/joint_states" not in bag.topics
            continue
        right = np.array_equal(series.fields["position"], columns["/joint_states"][1]["position"])
        assert right or bag.losses, f"byte {at}"


def test_a_damaged_chunk_costs_only_its_own_messages(tmp_path: Path) -> None:
    path = _write_plain(tmp_path / "a.mcap", chunk_size=3000, compression=CompressionType.NONE)
    data = bytearray(path.read_bytes())
    data[data.find(struct.pack("<d", 200.25))] ^= 0x10
    path.write_bytes(data)
    bag = read_bag(path)
    series = bag.series["/joint_states"]
    assert COUNT - 40 < len(series) < COUNT
    expected = np.array([_values(round(k)) for k in (series.stamp_ns - START) / 2e6])
    np.testing.assert_array_equal(series.fields["position"], expected)
    assert any("checksum does not match" in loss for loss in bag.losses)


def test_agreement_with_mcaps_and_rosbags_own_readers(write_bag, run_columns) -> None:
    path = write_bag(run_columns(700))
    bag = read_bag(path)
    (file,) = path.glob("*.mcap")
    with open(file, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        theirs = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
    ours = [(channel.topic, log_ns, data) for channel, log_ns, data in messages(path)]
    assert sorted(ours) == sorted(theirs)
    assert [log_ns for _, log_ns, _ in ours] == sorted(log_ns for _, log_ns, _ in ours)
    seen: dict[str, list[np.ndarray]] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/chamber_pressures":
                seen.setdefault("effort", []).append(message.effort)
            elif connection.topic == "/tip_reference":
                point = message.point
                seen.setdefault("point", []).append(np.array([point.x, point.y, point.z]))
    pressures, tip = bag.series["/chamber_pressures"], bag.series["/tip_reference"]
    np.testing.assert_array_equal(pressures.fields["effort"], np.array(seen["effort"]))
    np.testing.assert_array_equal(tip.fields["point"], np.array(seen["point"]))


@pytest.mark.parametrize("little", [True, False])
def test_bags_of_other_writers(tmp_path: Path, little: bool) -> None:
    """A rosbag2 directory as rosbags writes it; layouts change on the way."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    empty = np.zeros(0)
    path = tmp_path / "bag"
    with RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=store)
        for k in range(60):
            names = ["tilt", "lift"] if k < 20 else ["lift", f"wheel{k % 3}"]
            time = types["builtin_interfaces/msg/Time"](7, k)
            message = types[JOINT_STATE](
                types["std_msgs/msg/Header"](time, "x" * (k % 5)),
                names,
                np.array([float(k), -float(k)]),
                empty,
                empty,
            )
            raw = store.serialize_cdr(message, JOINT_STATE, little_endian=little)
            writer.write(connection, k, raw)
    series = read_bag(path).series["/joint_states"]
    assert series.names == ("tilt", "lift", "wheel2", "wheel0", "wheel1")
    assert series.malformed == 0
    np.testing.assert_array_equal(series.stamp_ns, 7_000_000_000 + np.arange(60))
    lift, tilt = series.column("lift", "position"), series.column("tilt", "position")
    assert lift is not None
    assert tilt is not None
    k = np.arange(60.0)
    np.testing.assert_array_equal(lift, np.where(k < 20, -k, k))
    np.testing.assert_array_equal(tilt[:20], k[:20])
    assert np.isnan(tilt[20:]).all()
    assert series.column("lift", "effort") is None


def test_split_files_are_one_bag_and_a_missing_one_is_said(write_bag, run_columns) -> None:
    columns = run_columns(500)
    path = write_bag(columns, split_ns=300_000_000)
    files = sorted(path.glob("*.mcap"))
    assert len(files) == 4
    q = columns["/joint_states"][1]["position"]
    whole = read_bag(path)
    assert whole.losses == ()
    np.testing.assert_array_equal(whole.series["/joint_states"].fields["position"], q)
    files[1].unlink()
    bag = read_bag(path)
    assert bag.losses == (f"{files[1].name}: named by metadata.yaml, not there",)
    kept = np.r_[0:150, 300:500]
    np.testing.assert_array_equal(bag.series["/joint_states"].fields["position"], q[kept])


def test_a_recording_that_was_not_closed_reads(write_bag, run_columns) -> None:
    path = write_bag(run_columns(50))
    (path / "metadata.yaml").unlink()
    bag = read_bag(path)
    assert bag.count == 300
    assert "no metadata.yaml" in bag.losses[0]


@pytest.mark.parametrize("begun", [b"", b"\x89MCAP", b"\x89MCAP0\r\n"])
def test_a_file_that_was_only_just_begun_takes_the_others_not_with_it(
    write_bag, run_columns, begun: bytes
) -> None:
    """What a recorder that is killed while it rolls over leaves behind."""
    path = write_bag(run_columns(500), split_ns=300_000_000)
    (path / "metadata.yaml").unlink()
    last = sorted(path.glob("*.mcap"))[-1]
    last.write_bytes(begun)
    bag = read_bag(path)
    assert len(bag.series["/joint_states"]) == 450
    (said,) = [loss for loss in bag.losses if loss.startswith(last.name)]
    assert "expected an MCAP file, found" in said or "cut off between records" in said


def test_files_of_a_recording_that_was_not_closed_are_read_as_they_were_written(
    write_bag, run_columns
) -> None:
    columns = run_columns(600)
    path = write_bag(columns, split_ns=100_000_000)
    (path / "metadata.yaml").unlink()
    assert len(list(path.glob("*.mcap"))) == 12
    q = columns["/joint_states"][1]["position"]
    np.testing.assert_array_equal(read_bag(path).series["/joint_states"].fields["position"], q)


def test_metadata_of_the_directory_cannot_point_outside(
    tmp_path: Path, write_bag, run_columns
) -> None:
    outside = _write_plain(tmp_path / "secret.mcap")
    path = write_bag(run_columns(20))
    file = path / "metadata.yaml"
    data = yaml.safe_load(file.read_text())
    data["rosbag2_bagfile_information"]["relative_file_paths"] = ["../secret.mcap", str(outside)]
    file.write_text(yaml.safe_dump(data))
    bag = read_bag(path)
    assert [f.path.parent for f in bag.files] == [path]
    assert bag.count == 120
    next(path.glob("*.mcap")).unlink()
    with pytest.raises(BagError, match="found none"):
        read_bag(path)


@pytest.mark.parametrize("text", ["", "[1, 2", "a: 1", "rosbag2_bagfile_information: 3", "\0"])
def test_unusable_metadata_is_said_and_the_files_are_read(
    write_bag, run_columns, text: str
) -> None:
    path = write_bag(run_columns(20))
    (path / "metadata.yaml").write_text(text)
    bag = read_bag(path)
    assert bag.count == 120
    assert "metadata.yaml is not usable" in bag.losses[0]


def test_what_is_no_bag_is_said(tmp_path: Path, write_bag, run_columns) -> None:
    with pytest.raises(BagError, match=r"no bag '.*nowhere'"):
        read_bag(tmp_path / "nowhere")
    (tmp_path / "folder").mkdir()
    with pytest.raises(BagError, match=r"expected a rosbag2 directory with \.mcap files"):
        read_bag(tmp_path / "folder")
    (tmp_path / "empty.mcap").touch()
    with pytest.raises(BagError, match="found an empty file"):
        read_bag(tmp_path / "empty.mcap")
    (tmp_path / "text.mcap").write_text("not an mcap file")
    with pytest.raises(BagError, match="expected an MCAP file, found bytes 6e 6f"):
        read_bag(tmp_path / "text.mcap")
    with pytest.raises(BagError, match="no message in this bag"):
        read_bag(_write_plain(tmp_path / "none.mcap", count=0))
    path = write_bag(run_columns(5))
    file = path / "metadata.yaml"
    file.write_text(file.read_text().replace("storage_identifier: mcap", "storage_identifier: x"))
    with pytest.raises(BagError, match="expected MCAP storage, found 'x'"):
        read_bag(path)


def _chunk(data: bytes, packed: bytes, name: str, size: int | None = None) -> bytes:
    size = len(data) if size is None else size
    head = struct.pack("<QQQII", 0, 0, size, zlib.crc32(data), len(name))
    return head + name.encode() + struct.pack("<Q", len(packed)) + packed


def test_chunks_that_would_grow_are_refused() -> None:
    zeros = bytes(50_000_000)
    for name, packed in (
        ("zstd", zstandard.compress(zeros)),
        ("lz4", lz4.frame.compress(zeros)),
    ):
        with pytest.raises(ChunkError, match="declares 50000000 bytes, more than 1000000"):
            decompress_chunk(_chunk(zeros, packed, name), 1_000_000)
        with pytest.raises(ChunkError):
            decompress_chunk(_chunk(zeros, packed, name, size=1000), 1_000_000)
    with pytest.raises(ChunkError, match="found 'br'"):
        decompress_chunk(_chunk(b"abc", b"abc", "br"), 100)
    for name in ("lz4", "zstd"):
        with pytest.raises(ChunkError):
            decompress_chunk(_chunk(b"abc" * 9, b"abc" * 9, name), 100)


def test_an_absurd_record_length_ends_the_file_without_allocation(tmp_path: Path) -> None:
    path = _write_plain(tmp_path / "a.mcap", use_chunking=False)
    data = path.read_bytes()
    stamp = START + 2_000_000 * 200
    message = encode(JOINT_STATE, stamp, {"position": _values(200)}, names=NAMES)
    head = data.find(message) - 22 - 9
    path.write_bytes(data[:head] + struct.pack("<BQ", 5, 1 << 62) + data[head + 9 :])
    bag = read_bag(path)
    assert any("cut off inside a record" in loss for loss in bag.losses)
    assert len(bag.series["/joint_states"]) == 200


def test_messages_that_are_not_cdr_are_told_and_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """JSON, as of a bridge to the web: the topic and its type are there, and nothing to decode."""
    path = _write_plain(tmp_path / "web.mcap", encoding="json")
    bag = read_bag(path)
    assert dict(bag.series) == {}
    assert bag.topics["/joint_states"].count == COUNT
    assert bag.losses == ("/joint_states: expected encoding cdr, found 'json'",)
    wanted = f"{path}: /joint_states: expected messages in CDR, found none that is read"
    with pytest.raises(BagError, match=f"^{re.escape(wanted)}$"):
        read_recording(path, load_robot("xs031"))
    assert inspect.main([str(path)]) == 0
    assert bag.losses[0] in capsys.readouterr().out
    assert inspect.main([str(path), "--robot", "xs031"]) == 2
    assert capsys.readouterr().err == f"inspect: {wanted}\n"
    out = tmp_path / "out"
    with pytest.raises(BagError, match=re.escape(wanted)):
        diagnose.run([str(path), "--robot", "xs031", "--out", str(out)])
    assert not out.exists()
