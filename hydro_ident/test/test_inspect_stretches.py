"""An inspection says the same however its bag is cut into stretches, in memory that stays flat."""

from __future__ import annotations

import math
import struct
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag import mcap_records
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.streaming import cut_recording
from hydro_ident.bag.stretch_cycles import LearntError
from hydro_ident.bag.stretches import Passage, Stretch, look_through
from hydro_ident.errors import BagError
from hydro_ident.health import find_irregularities
from hydro_ident.inspection import ranges_of
from hydro_ident.inspection_reading import inspect_bag
from hydro_ident.named_robot import named_robot
from hydro_ident.signal_look import SignalLook
from hydro_ident.study.long_bag import write_repeated
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import VALVE_COMMAND, VALVE_STATE

N = 900
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000
Columns = dict[str, tuple[tuple[str, ...], dict[str, np.ndarray]]]


def _plain(columns: Columns) -> None:
    del columns


def _stuck_and_dead(columns: Columns) -> None:
    """A chamber at the end of its scale, one that stands still, an encoder that does."""
    pressures = columns["/chamber_pressures"][1]["effort"]
    pressures[:, 0] = 0.0
    pressures[100:800, 2] = pressures[100, 2]
    pressures[300:320, 3], pressures[:, 4] = 2.6e7, pressures[:, 4] - 6e6
    columns["/joint_states"][1]["position"][200:760, 1] = -1.2


def _gapped(columns: Columns) -> None:
    columns["/joint_states"][1]["position"][[3, 300, 301, 302, 310, 897]] = np.nan
    columns["/chamber_pressures"][1]["effort"][500:560] = np.nan


def _latched(columns: Columns) -> None:
    volts = columns[VALVE_COMMAND][1]["effort"].copy()
    volts[100:190] = volts[400:403] = volts[600:] = 0.0
    columns[VALVE_STATE] = columns[VALVE_STATE][0], {"effort": volts}


def _late_pressures(columns: Columns) -> None:
    columns["/chamber_pressures"][1]["effort"][:450] = np.nan


def _late_joints(columns: Columns) -> None:
    columns["/joint_states"][1]["position"][:450] = np.nan


def _late_valves(columns: Columns) -> None:
    columns[VALVE_STATE][1]["effort"][:450] = np.nan


def _strokes(columns: Columns) -> None:
    """Stroke sensors alone."""
    names = ("lift_cylinder", "tilt_cylinder")
    way = 0.3 + 0.1 * np.sin(np.arange(N)[:, None] * [4e-3, 5e-3])
    columns["/joint_states"] = names, {"position": way, "velocity": 0.0 * way}


def _held(columns: Columns) -> None:
    """Ten samples for each reading."""
    for topic, name in (("/joint_states", "position"), ("/chamber_pressures", "effort")):
        values = columns[topic][1][name]
        columns[topic][1][name] = values[np.arange(N) // 10 * 10]


def _interpolated(columns: Columns) -> None:
    for topic, name in (("/joint_states", "position"), ("/chamber_pressures", "effort")):
        values, at = columns[topic][1][name], np.arange(N)
        readings = values + 0.01 * np.abs(values) * np.random.default_rng(1).normal(
            size=values.shape
        )
        lines = [np.interp(at, at[::16], column[::16]) for column in readings.T]
        columns[topic][1][name] = np.stack(lines, axis=1)


def _not_finite(columns: Columns) -> None:
    columns["/joint_states"][1]["position"][[0, 450, 899], 1] = np.inf
    columns["/chamber_pressures"][1]["effort"][40:60, 3] = -np.inf


def _other_stamps(columns: Columns) -> None:
    """Joints only, of another robot's names."""
    columns["/joint_states"] = ("boom", "arm"), columns["/joint_states"][1]


CHANGES = [
    _plain, _stuck_and_dead, _gapped, _latched, _late_pressures, _late_joints, _late_valves,
    _strokes, _held, _interpolated, _not_finite, _other_stamps,
]  # fmt: skip


def _answer(path: Path, robot: Robot | None, rows: int, late_s: float) -> dict[str, Any]:
    return inspect_bag(path, robot, rows=rows, late_s=late_s).as_dict()


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return list(one) == list(other) and all(_same(v, other[k]) for k, v in one.items())
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return one == other or (isinstance(one, float) and math.isnan(one) and math.isnan(other))


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("named", [True, False])
def test_wherever_a_bag_is_cut_its_inspection_is_the_same(
    write_bag, run_columns, robot, small_blocks, known, change, named: bool
) -> None:
    columns = run_columns(N)
    change(columns)
    path = write_bag(columns, metadata={"robot": "xs031"} if named else None)
    given = None if named else robot
    whole = _answer(path, given, 1 << 40, 2.0)
    assert len(known) == 2
    for block, rows, late_s in ((40, 1, 0.01), (333, 700, 0.1)):
        small_blocks(block)
        known.clear()
        assert _same(_answer(path, given, rows, late_s), whole), (block, rows, late_s)
        assert not any(one.whole for one in known), known


def test_one_message_at_a_time_is_the_same(write_bag, run_columns, robot, small_blocks) -> None:
    columns = run_columns(60)
    columns["/joint_states"][1]["position"][[3, 30, 31, 58]] = np.nan
    path = write_bag(columns)
    whole = _answer(path, robot, 1 << 40, 2.0)
    small_blocks(1)
    assert _same(_answer(path, robot, 1, 0.002), whole)


@pytest.mark.parametrize("seed", range(12))
def test_stamps_of_any_kind_give_the_same(
    write_bag, run_columns, robot, small_blocks, seed: int
) -> None:
    """Jitter, pauses, messages out of order and stamps that come again."""
    random = np.random.default_rng(seed)
    stamps = START_NS + PERIOD_NS * np.arange(N)
    stamps += np.round(random.choice([0.0, 2e5, 8e5]) * random.normal(size=N)).astype(np.int64)
    if seed % 3 == 0:
        stamps[random.integers(1, N)] -= 10**9 * int(random.integers(0, 3))
    if seed % 4 == 1:
        stamps[N // 2 :] += 30 * 10**9
    if seed % 5 == 2:
        stamps[400:410] = stamps[400]
    path = write_bag(run_columns(N), stamps=stamps)
    whole = _answer(path, robot, 1 << 40, 2.0)
    for block in random.integers(20, 400, 2):
        small_blocks(int(block))
        cut = _answer(path, robot, int(random.integers(1, 900)), float(random.uniform(0.0, 0.5)))
        assert _same(cut, whole), block


@pytest.mark.parametrize("change", CHANGES[:-1])
def test_it_is_what_the_columns_in_memory_say(write_bag, run_columns, robot, change) -> None:
    """The recording that everything else works on, looked at as a whole."""
    columns = run_columns(N)
    change(columns)
    path = write_bag(columns)
    read, said = read_recording(path, robot), inspect_bag(path, robot)
    assert said.findings == find_irregularities(read)
    assert said.ranges == ranges_of(read)
    assert said.losses == [{"channel": x.channel, "reason": x.reason} for x in read.losses]
    assert said.damage == list(read.notes)
    assert (said.cycles, said.duration_s) == (len(read), read.duration_s)
    assert said.rate_hz == 1.0 / read.period_s
    for one in said.ranges:
        kind = {"position": read.q, "voltage": read.valve_v}.get(one.signal.split(" ")[-1])
        if kind is not None:
            names = robot.joint_names if one.unit == "rad" else robot.valve_names
            column = kind[:, names.index(one.signal.split(" ")[0])]
            column = column[np.isfinite(column)]
            assert (one.low, one.high) == (column.min(), column.max())
            assert one.mean == pytest.approx(math.fsum(column) / column.size, rel=1e-15)


@pytest.mark.parametrize("first", ["/joint_states", "/valve_state"])
def test_a_bag_written_topic_by_topic_is_read_as_one(
    write_bag, run_columns, robot, small_blocks, known, first: str
) -> None:
    columns = run_columns(N)
    stamps = START_NS + PERIOD_NS * np.arange(2 * N)
    late: Columns = {}
    for topic, (names, fields) in columns.items():
        nothing = {n: np.full_like(v, np.nan) for n, v in fields.items()}
        order = (fields, nothing) if topic == first else (nothing, fields)
        late[topic] = names, {n: np.concatenate([o[n] for o in order]) for n in fields}
    stamps = np.concatenate([stamps[:N], stamps[:N]])
    path = write_bag(late, stamps=stamps)
    whole = _answer(path, robot, 1 << 40, 2.0)
    assert whole["cycles"] == N
    small_blocks(50)
    known.clear()
    assert _same(_answer(path, robot, 10, 0.1), whole)
    assert known[-1].whole or known[-1].waits


def test_a_bag_cut_anywhere_is_the_same_in_stretches(
    tmp_path: Path, write_bag, run_columns, small_blocks
) -> None:
    [file] = write_bag(run_columns(200), metadata={"robot": "xs031"}).glob("*.mcap")
    data = file.read_bytes()
    cut = tmp_path / "cut.mcap"
    for size in np.linspace(20, len(data), 25).astype(int):
        cut.write_bytes(data[:size])
        answers = []
        for block, rows, late_s in ((1 << 16, 1 << 40, 2.0), (9, 1, 0.01)):
            small_blocks(block)
            try:
                answers.append(_answer(cut, None, rows, late_s))
            except BagError as error:
                answers.append({"error": str(error)})
        assert _same(*answers), size


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
    late = _named_at_its_end(write_bag(run_columns(200)), "xs031")
    small_blocks(9)
    said = inspect_bag(late, rows=1, late_s=0.01)
    assert (said.robot, said.cycles) == ("xs031", 200)
    assert [one.robot for one in known] == [None, "xs031", "xs031"]
    assert named_robot(read_bag(late).metadata) is not None


def test_a_robot_whose_name_the_end_of_a_bag_takes_back(
    write_bag, run_columns, small_blocks, known
) -> None:
    late = _named_at_its_end(write_bag(run_columns(200), metadata={"robot": "xs031"}), "")
    small_blocks(9)
    assert inspect_bag(late, rows=1, late_s=0.01).robot is None
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


def test_memory_does_not_grow_with_the_bag(tmp_path: Path, crane_run, small_blocks) -> None:
    """Of 18 s, and of three times as long: what grows is what a gap adds."""
    small_blocks(500)
    recording = crane_run.recording(q_ref=crane_run.q)
    peaks = []
    for repeats in (1, 3):
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
