"""What an inspection goes through on its way over a bag, and the memory that it takes."""

from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag import mcap_records
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.streaming import cut_recording
from hydro_ident.bag.stretch_cycles import LearntError
from hydro_ident.bag.stretches import Passage, Stretch, look_through
from hydro_ident.errors import BagError
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_ident.inspecting.named_robot import named_robot
from hydro_ident.inspecting.signal_look import SignalLook
from hydro_ident.study.long_bag import write_repeated

N = 900
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000


@pytest.mark.parametrize("length", [5, 6, 7, 20])
def test_the_first_latch_is_told_wherever_a_stretch_begins(crane_run, length: int) -> None:
    """Motion asked for from cycle 20 on, the valves at 0 V before and `length` cycles more."""
    volts, command = np.ones((40, 2)), np.zeros((40, 2))
    volts[10 : 20 + length], command[20:] = 0.0, 3.0
    run = cut_recording(crane_run.recording(), slice(0, 40))
    run = replace(run, valve_v=volts, command_v=command)
    told = []
    for cut in (40, *range(12, 36)):
        look = SignalLook(run.robot)
        for part in (slice(0, cut), slice(cut, 40)):
            look.add(cut_recording(run, part))
            look.add_latches(cut_recording(run, part))
        look.finish()
        first_ns = look.latched.first_ns if look.latched.count else None
        told.append((look.latched.count, look.latched.cycles, first_ns))
    latched = (1, length, int(run.stamp_ns[20])) if length > 5 else (0, 0, None)
    assert told == [latched] * len(told)


def _named_at_its_end(path: Path, robot: str) -> Path:
    """A bag whose file says a robot's name behind all messages."""
    [file] = path.glob("*.mcap")
    text = [struct.pack("<I", len(t)) + t.encode() for t in ("robot", robot)]
    name = struct.pack("<I", 5) + b"hydro"
    body = name + struct.pack("<I", sum(map(len, text))) + b"".join(text)
    record = struct.pack("<BQ", mcap_records.METADATA, len(body)) + body
    data, end = file.read_bytes(), struct.pack("<BQ", mcap_records.DATA_END, 4)
    at = data.rindex(end)
    late = path.parent / "late.mcap"
    # The data section's own checksum is none: what it is over has changed.
    late.write_bytes(data[:at] + record + end + bytes(4) + data[at + 13 :])
    return late


def test_the_robot_that_only_the_end_of_a_bag_names(
    write_bag, run_columns, small_blocks, known
) -> None:
    # By its joints it may be another one, and is until its name comes.
    late = _named_at_its_end(write_bag(run_columns(200)), "patu655")
    small_blocks(9)
    said = inspect_bag(late, rows=1, late_s=0.01)
    assert (said.robot, said.robot_by_joints, said.cycles) == ("patu655", False, 200)
    assert [one.robot for one in known] == [None, "patu655", "patu655"]
    assert named_robot(read_bag(late).metadata) is not None


def test_a_robot_whose_name_the_end_of_a_bag_takes_back(
    write_bag, run_columns, small_blocks, known
) -> None:
    late = _named_at_its_end(write_bag(run_columns(200), metadata={"robot": "emps"}), "")
    small_blocks(9)
    said = inspect_bag(late, rows=1, late_s=0.01)
    assert (said.robot, said.robot_by_joints, said.cycles) == ("xs031", True, 200)
    assert [one.robot for one in known] == [None, "", ""]


def test_a_bag_that_never_reads_the_same_is_refused(
    write_bag, run_columns, known, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(self: Passage) -> Iterator[Stretch]:
        raise LearntError(replace(self.known, whole=True))
        yield

    monkeypatch.setattr(Passage, "stretches", never)
    with pytest.raises(BagError, match="the same in each reading"):
        inspect_bag(write_bag(run_columns(20)))
    assert [one.whole for one in known] == [False, True]


@pytest.mark.thorough
def test_memory_does_not_grow_with_the_bag(tmp_path: Path, crane_run, small_blocks) -> None:
    """Of 18 s, and of twice as long: what grows is what a gap adds."""
    small_blocks(500)
    recording = crane_run.recording(q_ref=crane_run.q)
    peaks = []
    for repeats in (1, 2):
        path = tmp_path / f"run_{repeats}"
        write_repeated(path, recording, repeats)
        tracemalloc.start()
        inspect_bag(path, rows=2000)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.05 * peaks[0]


def test_a_stretch_owns_its_messages_alone(write_bag, run_columns, small_blocks) -> None:
    path = write_bag(run_columns(N), metadata={"robot": "xs031"})
    small_blocks(60)
    stamps: list[np.ndarray] = []
    look_through(
        path,
        named_robot,
        lambda _: lambda s: stamps.append(s.stamps.get("/joint_states", np.zeros(0, int))),
        rows=100,
        late_s=0.02,
    )
    assert len(stamps) > 5
    read = read_bag(path).series["/joint_states"].stamp_ns
    np.testing.assert_array_equal(np.concatenate(stamps), read)


def test_a_bag_of_many_small_files_is_several_stretches(write_bag, run_columns) -> None:
    path = write_bag(run_columns(N), metadata={"robot": "xs031"}, split_ns=50 * PERIOD_NS)
    assert len(list(path.glob("*.mcap"))) == 18
    counts: list[int] = []

    def take(stretch: Stretch) -> None:
        counts.append(0 if stretch.cycles is None else len(stretch.cycles))

    look_through(path, named_robot, lambda _: take, rows=100, late_s=0.02)
    assert len(counts) == 18
    assert sum(counts) == N
