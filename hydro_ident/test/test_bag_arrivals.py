"""Bags in pieces whose topics do not come side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag import streaming
from hydro_ident.bag.playback import contents_of, messages_in_order
from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.streaming import COLUMNS, Piece, cut_recording, stream_recordings
from hydro_ident.bag.writer import BagWriter
from hydro_ident.identify.continuity import Continuity
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, VALVE_COMMAND, VALVE_STATE

N, START_NS, PERIOD_NS = 1500, 10**18, 2_000_000
#: Three seconds in pieces of half of one.
PIECE_S, OVERLAP_S = 0.5, 0.1


@pytest.fixture
def written(tmp_path: Path) -> Callable[..., Path]:
    """Writes messages, each a topic and a cycle, in the order given; stamps of some are moved.

    From the middle on the clock of the reception may be set back.
    """

    def write(
        columns: dict,
        order: Sequence[tuple[str, int]],
        moved_ns: Mapping[str | tuple[str, int], int] | None = None,
        *,
        log_by_stamp: bool = False,
        back_ns: int = 0,
    ) -> Path:
        path = tmp_path / f"bag{len(list(tmp_path.iterdir()))}"
        with BagWriter(path) as writer:
            for topic, (names, _) in columns.items():
                writer.add_topic(topic, JOINT_STATE if names else POINT_STAMPED)
            for came, (topic, k) in enumerate(order):
                names, fields = columns[topic]
                moved = moved_ns or {}
                stamp = START_NS + PERIOD_NS * k + moved.get((topic, k), moved.get(topic, 0))
                values = {name: v[k] for name, v in fields.items()}
                log_ns = stamp if log_by_stamp else START_NS + PERIOD_NS * came
                log_ns -= back_ns * (2 * came >= len(order))
                writer.write_stamped(topic, stamp, values, names=names, log_ns=log_ns)
        return path

    return write


@pytest.fixture
def blocks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Grows by the topic of each block that the reader takes in."""
    met: list[str] = []
    count = streaming.count_block

    def counted(infos: dict, block) -> None:
        met.append(block.channel.topic)
        count(infos, block)

    monkeypatch.setattr(streaming, "count_block", counted)
    return met


def _one_after_the_other(topics: Sequence[str]) -> list[tuple[str, int]]:
    return [(topic, k) for topic in topics for k in range(N)]


def _side_by_side(topics: Sequence[str]) -> list[tuple[str, int]]:
    return [(topic, k) for k in range(N) for topic in topics]


def _as_whole(path: Path, robot: Robot) -> list[Piece]:
    """The pieces of a bag, seen to hold what the whole of it does."""
    whole = read_recording(path, robot)
    assert len(whole) == N
    pieces = list(stream_recordings(path, robot, PIECE_S, OVERLAP_S))
    cores = [cut_recording(p.recording, p.core) for p in pieces]
    for name in COLUMNS:
        columns = [getattr(core, name) for core in cores]
        if getattr(whole, name) is None:
            assert all(c is None for c in columns), name
            continue
        np.testing.assert_array_equal(np.concatenate(columns), getattr(whole, name), name)
    assert all(piece.recording.losses == whole.losses for piece in pieces)
    assert all(piece.recording.valve_source == whole.valve_source for piece in pieces)
    return pieces


@pytest.mark.parametrize(
    "topics",
    [
        (JOINT_STATES, CHAMBER_PRESSURES, VALVE_COMMAND),
        (VALVE_COMMAND, JOINT_STATES, CHAMBER_PRESSURES),
        (CHAMBER_PRESSURES, VALVE_COMMAND, JOINT_STATES),
        (JOINT_STATES, CHAMBER_PRESSURES, VALVE_COMMAND, VALVE_STATE),
    ],
)
def test_topics_written_one_after_the_other_are_in_every_piece(
    written, run_columns, robot: Robot, small_blocks, topics: tuple[str, ...]
) -> None:
    small_blocks(100)
    columns = {topic: run_columns(N)[topic] for topic in topics}
    assert len(_as_whole(written(columns, _one_after_the_other(topics)), robot)) > 4


def test_topics_written_one_after_the_other_file_by_file(
    written, run_columns, robot: Robot, small_blocks
) -> None:
    """A second of each, as of a script that goes from log to log."""
    small_blocks(100)
    topics = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_STATE, VALVE_COMMAND)
    columns = {topic: run_columns(N)[topic] for topic in topics}
    order = [(t, k) for b in range(0, N, 500) for t in topics for k in range(b, b + 500)]
    assert len(_as_whole(written(columns, order), robot)) > 4


@pytest.mark.parametrize("moved_s", [0.0, -100.0, 100.0])
def test_a_bag_is_cut_before_its_end_where_nothing_is_to_come(
    written, run_columns, robot: Robot, small_blocks, blocks: list[str], moved_s: float
) -> None:
    """Also where voltages are of another clock, so that no piece has them."""
    small_blocks(100)
    topics = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_COMMAND)
    columns = {topic: run_columns(N)[topic] for topic in topics}
    path = written(columns, _side_by_side(topics), {VALVE_COMMAND: round(moved_s * 1e9)})
    read = [len(blocks) for _ in stream_recordings(path, robot, PIECE_S, OVERLAP_S)]
    assert len(read) > 4
    assert read[0] < 0.4 * len(blocks)
    assert all(after > before for before, after in pairwise(read[:-1]))


def test_a_bag_does_not_wait_for_a_stray_message(
    written, run_columns, robot: Robot, small_blocks, blocks: list[str]
) -> None:
    small_blocks(100)
    topics = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_COMMAND)
    columns = {topic: run_columns(N)[topic] for topic in topics}
    order = [*_side_by_side(topics)[:-30], (VALVE_COMMAND, 3), *_side_by_side(topics)[-30:]]
    path = written(columns, order)
    read = [len(blocks) for _ in stream_recordings(path, robot, PIECE_S, OVERLAP_S)]
    assert read[0] < 0.4 * len(blocks)


@pytest.mark.parametrize("leaps", [[N // 2], [0, N // 3, N // 2], range(N // 2, N // 2 + 10)])
def test_joint_stamps_that_leap_ahead_are_not_waited_for(
    written, run_columns, robot: Robot, small_blocks, blocks: list[str], leaps: Sequence[int]
) -> None:
    """As of bits that changed on the disk: what goes on from before them is not late."""
    small_blocks(100)
    topics = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_COMMAND)
    columns = {topic: run_columns(N)[topic] for topic in topics}
    path = written(columns, _side_by_side(topics), {(JOINT_STATES, k): 10**11 for k in leaps})
    read = [len(blocks) for _ in stream_recordings(path, robot, PIECE_S, OVERLAP_S)]
    assert len(read) > 4
    assert read[0] < 0.4 * len(blocks)
    assert all(after > before for before, after in pairwise(read[:-1]))


def test_a_sensor_that_only_some_pieces_have_is_told(
    written, run_columns, robot: Robot, small_blocks
) -> None:
    """Pressures that ended; a piece without any has no column of them."""
    columns = {topic: run_columns(N)[topic] for topic in (JOINT_STATES, CHAMBER_PRESSURES)}
    path = written(columns, _side_by_side(tuple(columns)))
    [piece] = stream_recordings(path, robot)
    bare = replace(piece, recording=replace(piece.recording, p_a=None, p_b=None))
    continuity = Continuity()
    for one in (piece, bare):
        continuity.add(one, ())
    assert continuity.partial["lift_cylinder/a"] == pytest.approx(0.5)
    assert "lift effort" not in continuity.partial


def test_topics_written_one_after_the_other_are_played_side_by_side(
    written, run_columns, small_blocks
) -> None:
    """By time of reception, which such a script takes from the stamps."""
    small_blocks(100)
    topics = (JOINT_STATES, CHAMBER_PRESSURES)
    columns = {topic: run_columns(N)[topic] for topic in topics}
    for apart in (True, False):
        path = written(columns, _one_after_the_other(topics), log_by_stamp=apart)
        contents = contents_of(path)
        assert contents.apart == apart
        played = [(c.topic, at) for c, at, _ in messages_in_order(path, contents)]
        assert [at for _, at in played] == sorted(at for _, at in played)
        assert len(played) == 2 * N
        assert len({topic for topic, _ in played[:4]}) == (2 if apart else 1)


def test_a_bag_whose_clock_of_reception_was_set_back_is_played_as_recorded(
    written, run_columns, small_blocks
) -> None:
    """The messages of a cycle stay beside each other."""
    small_blocks(100)
    topics = (JOINT_STATES, CHAMBER_PRESSURES, VALVE_COMMAND)
    columns = {topic: run_columns(N)[topic] for topic in topics}
    order = _side_by_side(topics)
    path = written(columns, order, log_by_stamp=True, back_ns=1_200_000_000)
    contents = contents_of(path)
    assert not contents.apart
    played = [c.topic for c, _, _ in messages_in_order(path, contents)]
    assert len(played) == 3 * N
    at = np.array([[i for i, t in enumerate(played) if t == topic] for topic in topics])
    assert np.ptp(at, axis=0).max() < 6
