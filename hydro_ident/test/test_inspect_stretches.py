"""An inspection says the same however its bag is cut into stretches, in memory that stays flat."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag import writer
from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.stretches import Passage, Stretch
from hydro_ident.errors import BagError
from hydro_ident.inspecting.health import find_irregularities
from hydro_ident.inspecting.inspection import ranges_of
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_ident.inspecting.signal_look import SignalLook
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import VALVE_COMMAND, VALVE_STATE

N = 900
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000
Columns = dict[str, tuple[tuple[str, ...], dict[str, np.ndarray]]]


@pytest.fixture
def chunks_of(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Lets the writer begin a chunk, which no stretch ends within, after so many cycles.

    After 0 each message has its own.
    """
    return lambda cycles: monkeypatch.setattr(writer, "CHUNK_NS", cycles * PERIOD_NS)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many stretches each passage over a bag had."""
    counts: list[int] = []
    read = Passage.stretches

    def noted(self: Passage) -> Iterator[Stretch]:
        counts.append(0)
        for stretch in read(self):
            counts[-1] += 1
            yield stretch

    monkeypatch.setattr(Passage, "stretches", noted)
    return counts


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


def _one_valve(columns: Columns) -> None:
    """The other one's command stands for it."""
    _latched(columns)
    columns[VALVE_STATE][1]["effort"][:, 1] = np.nan


def _late_valve(columns: Columns) -> None:
    columns[VALVE_STATE][1]["effort"][:450, 1] = np.nan


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
    _one_valve, _late_valve, _strokes, _held, _interpolated, _not_finite, _other_stamps,
]  # fmt: skip


def _answer(path: Path, robot: Robot | None, rows: int, late_s: float) -> dict[str, Any]:
    return inspect_bag(path, robot, rows=rows, late_s=late_s).as_dict()


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return list(one) == list(other) and all(_same(v, other[k]) for k, v in one.items())
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return one == other or (isinstance(one, float) and math.isnan(one) and math.isnan(other))


@pytest.mark.parametrize(
    ("change", "named"), [(change, k % 2 == 0) for k, change in enumerate(CHANGES)]
)
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


def test_one_message_at_a_time_is_the_same(
    write_bag, run_columns, robot, small_blocks, chunks_of, counted
) -> None:
    columns = run_columns(30)
    columns["/joint_states"][1]["position"][[3, 15, 16, 28]] = np.nan
    chunks_of(0)
    path = write_bag(columns)
    whole = _answer(path, robot, 1 << 40, 2.0)
    assert counted == [1, 1]
    counted.clear()
    small_blocks(1)
    assert _same(_answer(path, robot, 1, 0.002), whole)
    assert counted == [whole["messages"]] * 2


@pytest.mark.parametrize("seed", range(4))
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
    apart = [f"{f.signal}: {f.text}" for f in said.findings if f.kind == "apart"]
    assert sorted([*said.damage, *apart]) == sorted(read.notes)
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


def test_a_stretch_costs_what_it_holds_however_many_were_before(
    write_bag, run_columns, robot
) -> None:
    stretch = read_recording(write_bag(run_columns(N)), robot)
    look, peaks = SignalLook(robot), []
    tracemalloc.start()
    for _ in range(100):
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        look.add(stretch)
        peaks.append(tracemalloc.get_traced_memory()[1] - before)
    tracemalloc.stop()
    assert max(peaks[-10:]) < 1.2 * max(peaks[:10])
    assert look.silent["supply"].longest_s(0.002) == 0.0


def test_a_bag_cut_anywhere_is_the_same_in_stretches(
    tmp_path: Path, write_bag, run_columns, small_blocks, chunks_of, counted
) -> None:
    chunks_of(10)
    [file] = write_bag(run_columns(100), metadata={"robot": "xs031"}).glob("*.mcap")
    data = file.read_bytes()
    cut, most = tmp_path / "cut.mcap", []
    for size in np.linspace(20, len(data), 13).astype(int):
        cut.write_bytes(data[:size])
        answers = []
        for block, rows, late_s in ((1 << 16, 1 << 40, 2.0), (9, 1, 0.01)):
            small_blocks(block)
            counted.clear()
            try:
                answers.append(_answer(cut, None, rows, late_s))
            except BagError as error:
                answers.append({"error": str(error)})
        assert _same(*answers), size
        most.append(max(counted))
    assert most[-1] >= 10
    assert len(set(most)) > 5
