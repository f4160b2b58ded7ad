"""A bag cut at every byte, and with every byte changed: what is read is right, or it is said."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer

from hydro_ident.bag import writer as bag_writer
from hydro_ident.bag.cdr import JOINT_STATE, encode
from hydro_ident.bag.reader import Bag, read_bag
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.inspect import text_of
from hydro_ident.errors import BagError
from hydro_ident.inspection import inspect_bag, robot_of

NAMES = ("lift", "tilt")
TOPIC = "/joint_states"
COUNT = 6
START = 1_700_000_000_000_000_000
METADATA = {"robot": "xs031", "note": "small"}


def _stamp(k: int) -> int:
    return START + 150_000_000 * k


def _values(k: int) -> list[float]:
    return [k + 0.25, -k / 7.0]


def _written(folder: Path) -> BagWriter:
    """A bag of three chunks that is not closed yet."""
    writer = BagWriter(folder, METADATA)
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


def _foreign_bag(path: Path, chunked: bool) -> Path:
    """A file without any checksum."""
    with open(path, "wb") as stream:
        writer = Writer(
            stream,
            chunk_size=300,
            use_chunking=chunked,
            compression=CompressionType.NONE,
            index_types=IndexType.NONE,
            use_summary_offsets=False,
            use_statistics=False,
            repeat_channels=False,
            repeat_schemas=False,
            enable_crcs=False,
            enable_data_crcs=False,
        )
        writer.start(profile="ros2", library="other")
        schema = writer.register_schema(JOINT_STATE, "ros2msg", b"x")
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for k in range(COUNT):
            data = encode(JOINT_STATE, _stamp(k), {"position": _values(k)}, names=NAMES)
            writer.add_message(channel, _stamp(k), data, _stamp(k), k)
        writer.finish()
    return path


def _read(path: Path) -> Bag | None:
    """The bag, or None where it is refused in one line."""
    said = ""
    try:
        return read_bag(path)
    except BagError as error:
        said = str(error)
    assert str(path) in said
    assert "\n" not in said
    return None


def _right_cycles(bag: Bag) -> list[int]:
    """Which cycles the bag holds; all its numbers are those that were written."""
    if TOPIC not in bag.series or not len(bag.series[TOPIC]):
        return []
    series = bag.series[TOPIC]
    cycles = [round((int(stamp) - START) / 150_000_000) for stamp in series.stamp_ns]
    np.testing.assert_array_equal(series.stamp_ns, [_stamp(k) for k in cycles])
    np.testing.assert_array_equal(series.log_ns, series.stamp_ns)
    assert series.names == NAMES
    np.testing.assert_array_equal(series.fields["position"], [_values(k) for k in cycles])
    return cycles


@pytest.mark.parametrize("kind", ["project", "chunks", "no chunks"])
def test_cut_at_every_byte_a_prefix_is_read_and_the_loss_said(
    tmp_path: Path, project_bag: Path, kind: str
) -> None:
    file = project_bag if kind == "project" else _foreign_bag(tmp_path / "f", kind == "chunks")
    whole = file.read_bytes()
    cut, last = tmp_path / "cut.mcap", 0
    for size in range(len(whole)):
        cut.write_bytes(whole[:size])
        bag = _read(cut)
        if bag is None:
            assert last == 0, size
            continue
        assert any("cut off" in loss for loss in bag.losses), size
        cycles = _right_cycles(bag)
        assert cycles == list(range(len(cycles))), size
        assert len(cycles) >= last, size
        last = len(cycles)
    assert last == COUNT


def test_every_byte_of_a_project_bag_changed_is_right_or_said(
    tmp_path: Path, project_bag: Path
) -> None:
    whole = project_bag.read_bytes()
    assert _right_cycles(read_bag(project_bag)) == list(range(COUNT))
    changed, silent = tmp_path / "changed.mcap", 0
    for at in range(len(whole)):
        data = bytearray(whole)
        data[at] ^= 1 << at // 2 % 8 if at % 2 else 0xFF
        changed.write_bytes(data)
        bag = _read(changed)
        if bag is None:
            continue
        cycles = _right_cycles(bag)  # what is left beside a loss has to be right all the same
        if bag.losses:
            continue
        silent += 1
        assert cycles == list(range(COUNT)), at
        assert dict(bag.metadata) == METADATA, at
        assert bag.checksummed, at
    # Only the index behind the data may change unnoticed: nothing is read from it.
    assert silent < len(whole) - whole.index(b"\x0f\x04\0\0\0\0\0\0\0")


@pytest.mark.parametrize("chunked", [True, False])
def test_a_bag_without_checksums_is_called_so_whatever_byte_changed(
    tmp_path: Path, chunked: bool, robot
) -> None:
    path = _foreign_bag(tmp_path / "foreign.mcap", chunked)
    whole = path.read_bytes()
    changed = tmp_path / "changed.mcap"
    for at in range(len(whole)):
        data = bytearray(whole)
        data[at] ^= 1 << at % 8
        changed.write_bytes(data)
        bag = _read(changed)
        if bag is None:
            continue
        assert not bag.checksummed, at
        inspection = inspect_bag(bag, robot)
        assert ("not checksummed" in text_of(inspection)) != bag.checksum_failed, at


def test_every_fifth_byte_of_metadata_yaml_changed(project_bag: Path) -> None:
    """Its directory is read, or refused in one line; numbers come from the messages alone."""
    file = project_bag.with_name("metadata.yaml")
    whole = file.read_bytes()
    for at in range(0, len(whole), 5):
        data = bytearray(whole)
        data[at] ^= 1 << at // 5 % 8
        file.write_bytes(data)
        bag = _read(project_bag.parent)
        if bag is not None:
            assert _right_cycles(bag) == list(range(COUNT)), at


def test_every_intact_chunk_of_a_killed_recorders_bag_is_read_alone(killed_bag: Path) -> None:
    """Where the file has no end, what describes the channels must not hang on the first chunk."""
    data = killed_bag.read_bytes()
    begins = [at for at in range(len(data)) if data[at : at + 4] == b"zstd"]
    assert len(begins) == 3
    for kept, cycles in enumerate(([0, 1], [2, 3], [4, 5])):
        damaged = bytearray(data)
        for which, at in enumerate(begins):
            damaged[at + 30] ^= 0 if which == kept else 0x55
        killed_bag.write_bytes(damaged)
        bag = read_bag(killed_bag)
        assert sum("left out" in loss for loss in bag.losses) == 2
        assert _right_cycles(bag) == cycles


def test_no_bit_of_a_killed_recorders_first_chunk_takes_the_others_with_it(
    killed_bag: Path,
) -> None:
    data = killed_bag.read_bytes()
    begin = data.index(b"zstd")
    length = int.from_bytes(data[begin + 4 : begin + 12], "little")
    for at in range(begin, begin + 12 + length):
        damaged = bytearray(data)
        damaged[at] ^= 1 << at % 8
        killed_bag.write_bytes(damaged)
        bag = read_bag(killed_bag)
        cycles = _right_cycles(bag)
        # A bit that means nothing changes nothing.
        said = any("left out" in loss for loss in bag.losses)
        assert cycles == ([2, 3, 4, 5] if said else list(range(COUNT))), at


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
    bag = read_bag(project_bag)
    assert bag.checksum_failed
    assert any("left out" in loss for loss in bag.losses)
    assert _right_cycles(bag) == [2, 3, 4, 5]


def test_a_failed_checksum_is_in_the_inspection(project_bag: Path, robot) -> None:
    sound = text_of(inspect_bag(read_bag(project_bag), robot))
    assert "checksums hold" in sound
    data = bytearray(project_bag.read_bytes())
    data[data.index(b"small")] ^= 1
    project_bag.write_bytes(data)
    told = text_of(inspect_bag(read_bag(project_bag), robot))
    assert "a checksum FAILS" in told
    assert "bytes changed" in told


def test_what_a_bag_says_commands_no_terminal_and_opens_no_file(tmp_path: Path, robot) -> None:
    metadata: Mapping[str, str] = {"robot": "/etc/hostname", "note": "\x1b[2Jgone\nnext"}
    with BagWriter(tmp_path / "bag", metadata) as writer:
        writer.add_topic(TOPIC, JOINT_STATE)
        writer.write_stamped(TOPIC, _stamp(0), {"position": _values(0)}, names=NAMES)
    bag = read_bag(tmp_path / "bag")
    assert robot_of(bag, None) is None
    text = text_of(inspect_bag(bag, robot))
    assert "\x1b" not in text
    assert "\\x1b[2Jgone\\nnext" in text
