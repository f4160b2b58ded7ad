"""A bag cut at every byte, and with every byte changed: what is read is right, or it is said.

Whichever way it is read: whole, in pieces, or message by message as for playing back.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer

from hydro_ident.bag import writer as bag_writer
from hydro_ident.bag.playback import contents_of, messages
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.streaming import cut_recording, stream_recordings
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.inspect import text_of
from hydro_ident.errors import BagError
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.cdr import JOINT_STATE, encode

NAMES = ("lift", "tilt")
TOPIC = "/joint_states"
Read = TypeVar("Read")
COUNT = 6
START = 1_700_000_000_000_000_000
METADATA = {"robot": "xs031", "note": "small"}
ROBOT = load_robot("xs031")
#: A bag of a second is no more pieces than this, whatever a changed stamp says.
MOST_PIECES = 20


def _stamp(k: int) -> int:
    return START + 150_000_000 * k


def _values(k: int) -> list[float]:
    return [k + 0.25, -k / 7.0]


def _written(folder: Path, split_ns: int = 10**12) -> BagWriter:
    """A bag of three chunks, or of two files of two, that is not closed yet."""
    writer = BagWriter(folder, METADATA, split_ns=split_ns)
    writer.add_topic(TOPIC, JOINT_STATE, text="x")
    for k in range(COUNT):
        writer.write_stamped(TOPIC, _stamp(k), {"position": _values(k)}, names=NAMES)
    return writer


@pytest.fixture
def project_bag(tmp_path: Path) -> Path:
    """The one file of a bag of the project's, of three chunks."""
    _written(tmp_path / "bag").close()
    return tmp_path / "bag" / "bag_0.mcap"


@pytest.fixture
def killed_bag(tmp_path: Path) -> Path:
    """The same, of a recorder that was killed behind its third chunk."""
    writer = _written(tmp_path / "killed")
    writer.flush()
    writer.abandon()
    return tmp_path / "killed" / "killed_0.mcap"


def _rosbag2_bag(path: Path) -> Path:
    """A file whose chunks carry checksums, but not its data section: what rosbag2 writes."""
    with open(path, "wb") as stream:
        writer = Writer(stream, chunk_size=300)
        writer.start(profile="ros2", library="other")
        _fill(writer)
    return path


def _fill(writer: Writer) -> None:
    schema = writer.register_schema(JOINT_STATE, "ros2msg", b"x")
    channel = writer.register_channel(TOPIC, "cdr", schema)
    for k in range(COUNT):
        writer.add_message(channel, _stamp(k), _message(k), _stamp(k), k)
    writer.finish()


def _message(k: int) -> bytes:
    return encode(JOINT_STATE, _stamp(k), {"position": _values(k)}, names=NAMES)


#: Whatever else a writer leaves out that has no checksums: tables of what the file holds.
_LEFT_OUT = (
    "use_summary_offsets", "use_statistics", "repeat_channels", "repeat_schemas", "enable_crcs",
    "enable_data_crcs",
)  # fmt: skip


def _foreign_bag(path: Path, chunked: bool) -> Path:
    """A file without any checksum."""
    plain = {"compression": CompressionType.NONE, "index_types": IndexType.NONE}
    off = dict.fromkeys(_LEFT_OUT, False)
    with open(path, "wb") as stream:
        writer = Writer(stream, chunk_size=300, use_chunking=chunked, **plain, **off)
        writer.start(profile="ros2", library="other")
        _fill(writer)
    return path


@dataclass(frozen=True)
class Found:
    """What came of a bag: a row of positions per cycle, and what was said of the others.

    `log_ns` is there where the way of reading gives it.
    """

    stamp_ns: np.ndarray
    rows: np.ndarray
    losses: tuple[str, ...]
    log_ns: np.ndarray | None = None


def _whole(path: Path) -> Found:
    bag = read_bag(path)
    series = bag.series.get(TOPIC)
    if series is None:
        return Found(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), bag.losses)
    columns = [series.column(name, "position") for name in NAMES]
    nothing = np.full(len(series), np.nan)
    rows = np.column_stack([nothing if c is None else c for c in columns])
    return Found(series.stamp_ns, rows, bag.losses, series.log_ns)


def _in_pieces(path: Path) -> Found:
    cores = []
    for piece in stream_recordings(path, ROBOT, piece_s=0.2, overlap_s=0.2):
        cores.append(cut_recording(piece.recording, piece.core))
        assert len(cores) <= MOST_PIECES
    stamp_ns = np.concatenate([core.stamp_ns for core in cores])
    return Found(stamp_ns, np.concatenate([core.q for core in cores]), cores[-1].notes)


def _played(path: Path) -> Found:
    """Rows are of numbers where the bytes are those that were written, else of NaN."""
    damage = contents_of(path).damage
    stamps, rows = [], []
    for channel, log_ns, data in messages(path):
        if channel.topic == TOPIC:
            k = round((log_ns - START) / 150_000_000)
            stamps.append(log_ns)
            rows.append(_values(k) if data == _message(k) else [np.nan, np.nan])
    return Found(np.array(stamps, dtype=np.int64), np.reshape(rows, (-1, 2)), damage)


WAYS: Mapping[str, Callable[[Path], Found]] = {
    "whole": _whole,
    "in pieces": _in_pieces,
    "played": _played,
}
each_way = pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
#: The others share what reads records with the first.
each_way_thoroughly = pytest.mark.parametrize(
    "way",
    [_whole, *(pytest.param(way, marks=pytest.mark.thorough) for way in (_in_pieces, _played))],
    ids=WAYS,
)
#: Where the changes of a file begin and how far they lie apart. All ways read records alike: after
#: every change one of them does, the other two after every second, in turn.
STEPS = {_whole: (0, 1), _in_pieces: (0, 2), _played: (1, 2)}


def _read(path: Path, way: Callable[[Path], Read]) -> Read | None:
    """What came of a bag, or None where it is refused in one line."""
    said = ""
    try:
        return way(path)
    except BagError as error:
        said = str(error)
    assert str(path) in said
    assert "\n" not in said
    return None


def _anew(path: Path, data: bytes) -> None:
    """Write a file as a new one: ext4 brings one that is emptied to the disk each time (3 ms)."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


def _one_bit(at: int) -> int:
    """Which bit of a byte changes, another one in each."""
    return 1 << at // 2 % 8


def _flipped(
    path: Path, changes: Callable[[int], int] = _one_bit, steps: tuple[int, int] = (0, 1)
) -> Iterator[int]:
    """Change every byte of a file in turn, or those that lie so far apart, and none in the end."""
    whole = path.read_bytes()
    first, apart = steps
    for at in range(first, len(whole), apart):
        data = bytearray(whole)
        data[at] ^= changes(at)
        _anew(path, data)
        yield at
    _anew(path, whole)


def _right_cycles(found: Found) -> list[int]:
    """Which cycles were found; all numbers are those that were written."""
    cycles = [round((int(stamp) - START) / 150_000_000) for stamp in found.stamp_ns]
    np.testing.assert_array_equal(found.stamp_ns, [_stamp(k) for k in cycles])
    if found.log_ns is not None:
        np.testing.assert_array_equal(found.log_ns, found.stamp_ns)
    np.testing.assert_array_equal(found.rows, np.reshape([_values(k) for k in cycles], (-1, 2)))
    return cycles


@each_way_thoroughly
@pytest.mark.parametrize(
    "kind",
    ["project", pytest.param("killed", marks=pytest.mark.thorough),
     pytest.param("chunks", marks=pytest.mark.thorough), "no chunks"],
)  # fmt: skip
def test_cut_at_every_byte_a_prefix_is_read_and_the_loss_said(
    tmp_path: Path, project_bag: Path, killed_bag: Path, kind: str, way: Callable[[Path], Found]
) -> None:
    own = {"project": project_bag, "killed": killed_bag}
    file = own.get(kind) or _foreign_bag(tmp_path / "f", kind == "chunks")
    whole = file.read_bytes()
    cut, last = tmp_path / "cut.mcap", 0
    first, apart = STEPS[way]
    for size in range(first, len(whole), apart):
        _anew(cut, whole[:size])
        found = _read(cut, way)
        if found is None:
            assert last == 0, size
            continue
        assert any("cut off" in loss for loss in found.losses), size
        cycles = _right_cycles(found)
        assert cycles == list(range(len(cycles))), size
        assert len(cycles) >= last, size
        last = len(cycles)
    assert last == COUNT


@each_way_thoroughly
def test_every_byte_of_a_project_bag_changed_is_right_or_said(
    tmp_path: Path, project_bag: Path, way: Callable[[Path], Found]
) -> None:
    whole, silent = project_bag.read_bytes(), list[int]()
    assert _right_cycles(way(project_bag)) == list(range(COUNT))
    changed = tmp_path / "changed.mcap"
    _anew(changed, whole)
    for at in _flipped(changed, lambda at: _one_bit(at) if at // 2 % 2 else 0xFF, STEPS[way]):
        found = _read(changed, way)
        if found is None:
            continue
        cycles = _right_cycles(found)  # what is left beside a loss has to be right all the same
        if found.losses:
            continue
        silent.append(at)
        assert cycles == list(range(COUNT)), at
        bag = read_bag(changed)
        assert dict(bag.metadata) == METADATA, at
        assert bag.checksummed, at
    # Only the index behind the data may change unnoticed: nothing is read from it.
    assert min(silent) > whole.index(b"\x0f\x04\0\0\0\0\0\0\0")


@each_way
def test_no_message_of_a_bag_with_checksums_on_chunks_alone_is_lost_in_silence(
    tmp_path: Path, way: Callable[[Path], Found]
) -> None:
    """A chunk whose kind changed is a record that is skipped: the end of the file counts it."""
    path = _rosbag2_bag(tmp_path / "rosbag2.mcap")
    assert way(path).losses == ()
    assert read_bag(path).checksummed
    for at in _flipped(path, steps=STEPS[way]):
        found = _read(path, way)
        if found is not None and not found.losses:
            assert _right_cycles(found) == list(range(COUNT)), at


def test_what_is_under_no_checksum_is_counted(tmp_path: Path, killed_bag: Path) -> None:
    """Chunks that were cut cannot be checked, messages outside chunks have no checksum."""
    assert read_bag(killed_bag).unchecked == ()
    whole = killed_bag.read_bytes()
    killed_bag.write_bytes(whole[: whole.rindex(b"zstd") + 80])
    (said,) = read_bag(killed_bag).unchecked
    assert said.startswith("not checksummed: 1 of 3 chunks;")
    (killed_bag.parent / "killed_1.mcap").write_bytes(whole[:8])
    assert read_bag(killed_bag.parent).unchecked == (said,)
    path = _rosbag2_bag(tmp_path / "mixed.mcap")
    data = path.read_bytes()
    end = data.index(b"\x0f\x04\0\0\0\0\0\0\0")
    body = struct.pack("<HIQQ", 1, 0, _stamp(9), _stamp(9)) + _message(9)
    loose = struct.pack("<BQ", 5, len(body)) + body
    path.write_bytes(data[:end] + loose + data[end:])
    (said,) = read_bag(path).unchecked
    assert said.startswith("not checksummed: 1 message outside chunks;")


@pytest.mark.parametrize("chunked", [True, False])
def test_a_bag_without_checksums_is_called_so_whatever_byte_changed(
    tmp_path: Path, chunked: bool, robot
) -> None:
    path = _foreign_bag(tmp_path / "foreign.mcap", chunked)
    for at in _flipped(path):
        bag = _read(path, read_bag)
        if bag is None:
            continue
        assert bag.unchecked, at
        assert not bag.checksummed, at
        assert contents_of(path).unchecked == bag.unchecked, at
        if at % 3:
            continue
        inspection = inspect_bag(path, robot)
        assert ("not checksummed" in text_of(inspection)) != bag.checksum_failed, at


@pytest.mark.thorough
@pytest.mark.parametrize("chunked", [True, False])
def test_whatever_byte_changed_a_bag_without_checksums_ends_in_few_pieces(
    tmp_path: Path, chunked: bool
) -> None:
    """Also where a changed stamp is years away: what lies between is no work."""
    path = _foreign_bag(tmp_path / "foreign.mcap", chunked)
    for bits in (lambda at: 1 << at % 8, lambda at: 1 << 7):
        for _ in _flipped(path, bits):
            _read(path, _in_pieces)


def test_every_byte_of_metadata_yaml_changed(tmp_path: Path) -> None:
    """Of a bag of two files: read whole, or what is missing is said, or refused in one line.

    Numbers come from the messages alone.
    """
    _written(tmp_path / "bag", split_ns=400_000_000).close()
    file = tmp_path / "bag/metadata.yaml"
    for at in _flipped(file):
        found = _read(tmp_path / "bag", _whole)
        if found is not None:
            cycles = _right_cycles(found)
            assert cycles == list(range(COUNT)) or found.losses, at
            assert cycles == sorted(set(cycles)), at


@each_way
def test_a_file_that_metadata_yaml_names_twice_for_another_is_read_once(
    tmp_path: Path, way: Callable[[Path], Found]
) -> None:
    """One changed bit makes a 0 of a 1."""
    _written(tmp_path / "bag", split_ns=400_000_000).close()
    file = tmp_path / "bag/metadata.yaml"
    file.write_text(file.read_text().replace("- bag_1.mcap", "- bag_0.mcap"))
    found = way(tmp_path / "bag")
    assert "bag_1.mcap: not named by metadata.yaml, left out" in found.losses
    assert _right_cycles(found) == [0, 1, 2]


def test_every_intact_chunk_of_a_killed_recorders_bag_is_read_alone(killed_bag: Path) -> None:
    """Where the file has no end, what describes the channels must not hang on the first chunk."""
    data = killed_bag.read_bytes()
    begins = [at for at in range(len(data)) if data[at : at + 4] == b"zstd"]
    assert len(begins) == 3
    for kept, cycles in enumerate(([0, 1], [2, 3], [4, 5])):
        damaged = bytearray(data)
        for which, at in enumerate(begins):
            damaged[at + 30] ^= 0 if which == kept else 0x55
        _anew(killed_bag, damaged)
        found = _whole(killed_bag)
        assert sum("left out" in loss for loss in found.losses) == 2
        assert _right_cycles(found) == cycles


def test_no_bit_of_a_killed_recorders_first_chunk_takes_the_others_with_it(
    killed_bag: Path,
) -> None:
    data = killed_bag.read_bytes()
    begin = data.index(b"zstd")
    length = int.from_bytes(data[begin + 4 : begin + 12], "little")
    for at in range(begin, begin + 12 + length):
        damaged = bytearray(data)
        damaged[at] ^= 1 << at % 8
        _anew(killed_bag, damaged)
        found = _whole(killed_bag)
        cycles = _right_cycles(found)
        # A bit that means nothing changes nothing.
        said = any("left out" in loss for loss in found.losses)
        assert cycles == ([2, 3, 4, 5] if said else list(range(COUNT))), at


@each_way
def test_every_byte_of_a_killed_recorders_bag_changed_leaves_right_numbers(
    killed_bag: Path, way: Callable[[Path], Found]
) -> None:
    """It has no end that a count could stand in: that it has none is said in any case."""
    for at in _flipped(killed_bag, steps=STEPS[way]):
        found = _read(killed_bag, way)
        if found is not None:
            cycles = _right_cycles(found)
            assert found.losses, at
            assert cycles == sorted(set(cycles)), at


def test_channels_of_a_damaged_first_chunk_come_from_the_end_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of writers that describe their channels once."""
    monkeypatch.setattr(bag_writer, "describe_in_every_chunk", lambda writer: None)
    _written(tmp_path / "bag").close()
    project_bag = tmp_path / "bag" / "bag_0.mcap"
    data = bytearray(project_bag.read_bytes())
    first = data.index(b"zstd")
    data[first + 30] ^= 0x55
    project_bag.write_bytes(data)
    assert read_bag(project_bag).checksum_failed
    found = _whole(project_bag)
    assert any("left out" in loss for loss in found.losses)
    assert _right_cycles(found) == [2, 3, 4, 5]
