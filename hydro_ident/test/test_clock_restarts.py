"""Bags in which a simulation's clock starts over: two runs, one behind the other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.digest import Digest
from hydro_ident.bag.recording import Recording, read_recording
from hydro_ident.bag.streaming import stream_recordings
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import BagError
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import JOINT_STATE
from hydro_msgs_docs.topics import (
    CHAMBER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    VALVE_COMMAND,
)

N, PERIOD_NS = 900, 2_000_000
TOPICS = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_COMMAND)
SAID = "the clock of the stamps starts over (1x): 2 runs (1.8 s, 1.8 s) in one bag"


def _written(
    path: Path, columns: dict, order: Iterable[tuple[str, int, int]], *, wall: bool = False
) -> Path:
    """Messages: topic, row and stamp in ns; received by a clock of the wall, or as stamped."""
    with BagWriter(path, {"robot": "xs031"}) as bag:
        for topic in columns:
            bag.add_topic(topic, JOINT_STATE)
        for came, (topic, k, stamp_ns) in enumerate(order):
            names, fields = columns[topic]
            values = {name: v[k] for name, v in fields.items()}
            log_ns = 10**18 + 500_000 * came if wall else None
            bag.write_stamped(topic, stamp_ns, values, names=names, log_ns=log_ns)
    return path


def _two_runs(topics: Sequence[str], offset_ns: int) -> list[tuple[str, int, int]]:
    """Side by side: N cycles, and N more from the same stamp on, moved by an offset."""
    stamps = 10**9 + PERIOD_NS * (np.arange(2 * N) % N) + offset_ns * (np.arange(2 * N) >= N)
    return [(topic, k, int(stamps[k])) for k in range(2 * N) for topic in topics]


def _read(path: Path, robot: Robot) -> list[Recording]:
    """The bag as a whole, and in pieces."""
    digest = Digest()
    for piece in stream_recordings(path, robot, 0.5, 0.1):
        digest.add(piece)
    return [read_recording(path, robot), digest.recording()]


@pytest.mark.parametrize("topic_by_topic", [False, True])
@pytest.mark.parametrize("offset_ns", [0, 700_000])
def test_two_runs_of_one_clock_are_put_one_behind_the_other(
    tmp_path: Path,
    run_columns,
    robot: Robot,
    small_blocks,
    offset_ns: int,
    *,
    topic_by_topic: bool,
) -> None:
    """Whether their cycles have the same stamps or lie between each other's."""
    small_blocks(100)
    columns, order = run_columns(2 * N), _two_runs(TOPICS, offset_ns)
    if topic_by_topic:
        order.sort(key=lambda message: TOPICS.index(message[0]))
    path = _written(tmp_path / "bag", columns, order)
    for read in _read(path, robot):
        assert len(read) == 2 * N
        np.testing.assert_array_equal(read.q, columns[JOINT_STATES][1]["position"])
        np.testing.assert_array_equal(read.valve_v, columns[VALVE_COMMAND][1]["effort"])
        assert np.isfinite(read.p_a).all()
        steps = np.diff(read.stamp_ns)
        assert np.flatnonzero(steps != PERIOD_NS).tolist() == [N - 1]
        assert len(read.gaps) == 1
        assert [note for note in read.notes if note.startswith(SAID)]
        assert read.duplicates == {}
    for rows in (100, 1 << 40):
        said = inspect_bag(path, rows=rows, late_s=0.1)
        assert said.cycles == 2 * N
        assert [line for line in said.damage if line.startswith(SAID)]
        assert all(topic.duplicates == topic.disordered == 0 for topic in said.topics)


def test_a_recording_that_lies_in_the_bag_twice_is_one(
    tmp_path: Path, run_columns, robot: Robot, small_blocks
) -> None:
    small_blocks(100)
    columns = run_columns(N)
    order = [(topic, k % N, stamp) for topic, k, stamp in _two_runs(TOPICS, 0)]
    path = _written(tmp_path / "bag", columns, order)
    for read in _read(path, robot):
        assert len(read) == N
        assert read.duplicates == dict.fromkeys(TOPICS, N)
        assert not any("starts over" in note for note in read.notes)


def test_joints_that_were_written_one_after_the_other_are_one_run(
    tmp_path: Path, run_columns, robot: Robot, small_blocks
) -> None:
    """What the second one tells at the same stamps the first one did not."""
    small_blocks(100)
    q = run_columns(N)[JOINT_STATES][1]["position"]
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(JOINT_STATES, JOINT_STATE)
        for j, name in enumerate(robot.joint_names):
            for k in range(N):
                fields = {"position": q[k, j : j + 1]}
                bag.write_stamped(JOINT_STATES, PERIOD_NS * (k + 1), fields, names=(name,))
    for read in _read(tmp_path / "bag", robot):
        np.testing.assert_array_equal(read.q, q)


@pytest.mark.parametrize("jump_s", [-1.5, 1e6])
def test_late_messages_are_no_second_run(
    tmp_path: Path, run_columns, robot: Robot, jump_s: float
) -> None:
    """A few, or one whose stamp changed."""
    order = _two_runs(TOPICS, 0)[: 3 * N]
    few = 5 if jump_s < 0.0 else 1
    for at in range(3 * N - 30, 3 * N - 30 + few):
        topic, k, stamp = order[at]
        order[at] = topic, k, stamp + round(jump_s * 1e9) + 1
    read = read_recording(_written(tmp_path / "bag", run_columns(N), order), robot)
    assert not any("starts over" in note for note in read.notes)


def test_a_topic_of_the_second_run_alone_goes_by_its_reception(
    tmp_path: Path, run_columns, robot: Robot
) -> None:
    columns = run_columns(2 * N)
    order = [m for m in _two_runs(TOPICS, 0) if m[0] != VALVE_COMMAND or m[1] >= N]
    volts = columns[VALVE_COMMAND][1]["effort"]
    read = read_recording(_written(tmp_path / "bag", columns, order, wall=True), robot)
    assert len(read) == 2 * N
    assert np.isnan(read.valve_v[:N]).all()
    np.testing.assert_array_equal(read.valve_v[N:], volts[N:])
    path = _written(tmp_path / "stamped", columns, order)
    wrong = rf"start over 1 times and those of {VALVE_COMMAND} 0 times: record each run into a bag"
    for read_it in (read_recording, inspect_bag):
        with pytest.raises(BagError, match=wrong):
            read_it(path, robot)


def test_a_topic_of_names_without_values_goes_with_the_others(
    tmp_path: Path, run_columns, robot: Robot, small_blocks
) -> None:
    small_blocks(100)
    columns = run_columns(2 * N)
    columns[JOINT_REFERENCE] = robot.joint_names, {}
    order = _two_runs((*TOPICS, JOINT_REFERENCE), 0)
    path = _written(tmp_path / "bag", columns, order)
    for read in _read(path, robot):
        assert len(read) == 2 * N
        assert read.q_ref is None
        assert [note for note in read.notes if note.startswith(SAID)]
    assert inspect_bag(path, robot).cycles == 2 * N
