"""Messages of one stamp: parts of a cycle are put together, contradictions and repeats told."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.digest import Digest
from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.streaming import stream_recordings
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands.inspect import text_of
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import JOINT_STATE, TEMPERATURE
from hydro_msgs_docs.topics import JOINT_STATES, OIL_TEMPERATURE

N, START_NS, PERIOD_NS = 600, 10**18, 2_000_000
Q = np.array([0.8, -1.2]) + 0.1 * np.random.default_rng(1).normal(size=(N, 2))
NAMES = ("lift", "tilt")


def _written(path: Path, robot: Robot, messages: Iterable[tuple[int, dict[str, float]]]) -> Path:
    """Messages of a cycle and what is told of joints."""
    assert robot.joint_names == NAMES
    with BagWriter(path, {"robot": robot.name}) as bag:
        bag.add_topic(JOINT_STATES, JOINT_STATE)
        for k, told in messages:
            stamp, fields = START_NS + PERIOD_NS * k, {"position": list(told.values())}
            bag.write_stamped(JOINT_STATES, stamp, fields, names=tuple(told))
    return path


def _streamed(path: Path, robot: Robot) -> tuple[np.ndarray, tuple[str, ...]]:
    """Positions and notes of a bag in pieces."""
    digest = Digest()
    for piece in stream_recordings(path, robot, 0.2, 0.1):
        digest.add(piece)
    whole = digest.recording()
    return whole.q, whole.notes


@pytest.mark.parametrize("apart", [0, 7])
def test_joints_of_a_cycle_that_come_in_messages_of_their_own(
    tmp_path: Path, robot: Robot, small_blocks, apart: int
) -> None:
    """One behind the other, or the second one some cycles later."""
    small_blocks(40)
    order = [
        (k, {NAMES[j]: Q[k, j]})
        for came in range(N + apart)
        for j, k in ((0, came), (1, came - apart))
        if 0 <= k < N
    ]
    path = _written(tmp_path / "bag", robot, order)
    read = read_recording(path, robot)
    np.testing.assert_array_equal(read.q, Q)
    assert not [loss for loss in read.losses if "position" in loss.reason]
    assert read.duplicates == {}
    np.testing.assert_array_equal(_streamed(path, robot)[0], Q)
    said = inspect_bag(path, rows=100, late_s=0.05)
    assert (said.cycles, said.topics[0].duplicates) == (N, 0)
    assert repr(said.as_dict()) == repr(inspect_bag(path, rows=1 << 40).as_dict())


def test_an_entry_that_is_told_twice_otherwise_is_said(
    tmp_path: Path, robot: Robot, small_blocks
) -> None:
    """The first value holds, and what else the second message tells."""
    small_blocks(40)
    order = [
        one
        for k in range(N)
        for one in ((k, {"lift": Q[k, 0]}), (k, {"lift": 9.0, "tilt": Q[k, 1]}))
    ]
    path = _written(tmp_path / "bag", robot, order)
    said = f"{JOINT_STATES}: {N} of {2 * N} messages tell another value"
    read = read_recording(path, robot)
    np.testing.assert_array_equal(read.q, Q)
    assert [note for note in read.notes if note.startswith(said)]
    q, notes = _streamed(path, robot)
    np.testing.assert_array_equal(q, Q)
    assert [note for note in notes if note.startswith(said)]
    assert [note for note in inspect_bag(path, rows=100).damage if note.startswith(said)]


@pytest.mark.parametrize(("every", "told"), [(200, False), (20, True)])
def test_many_repeated_messages_are_said_few_are_counted(
    tmp_path: Path, robot: Robot, small_blocks, every: int, *, told: bool
) -> None:
    small_blocks(40)
    order = [
        (k, dict(zip(NAMES, Q[k], strict=True)))
        for k in range(N)
        for _ in range(2 if k % every == 0 else 1)
    ]
    path = _written(tmp_path / "bag", robot, order)
    again = N // every
    said = f"{JOINT_STATES}: {again} of {N + again} messages left out"
    read = read_recording(path, robot)
    assert read.duplicates == {JOINT_STATES: again}
    for notes in (read.notes, _streamed(path, robot)[1], inspect_bag(path, rows=100).damage):
        assert any(note.startswith(said) for note in notes) == told
        assert not any("another value" in note for note in notes)
    shown = text_of(inspect_bag(path))
    assert ("DAMAGE" in shown) == told
    # Right beside damage, too.
    assert "twice: a stamp that came again, with nothing new; harmless where health is" in shown


def test_a_repeated_message_that_differs_once_is_no_damage(tmp_path: Path, robot: Robot) -> None:
    """As of a lockstep that sends a cycle's command again."""
    order = [(k, dict(zip(NAMES, Q[k], strict=True))) for k in range(N)]
    order.insert(301, (300, {"lift": 0.0, "tilt": 0.0}))
    path = _written(tmp_path / "bag", robot, order)
    np.testing.assert_array_equal(read_recording(path, robot).q, Q)
    assert inspect_bag(path).damage == []


def test_an_oil_temperature_that_is_sent_again_is_no_damage(tmp_path: Path, robot: Robot) -> None:
    """With the stamp of its reading, until there is another: 1 Hz as 10 Hz."""
    with BagWriter(tmp_path / "bag", {"robot": robot.name}) as bag:
        bag.add_topic(JOINT_STATES, JOINT_STATE)
        bag.add_topic(OIL_TEMPERATURE, TEMPERATURE)
        for k in range(N):
            stamp = START_NS + PERIOD_NS * k
            bag.write_stamped(JOINT_STATES, stamp, {"position": Q[k]}, names=NAMES)
            if k % 50 == 0:
                reading = START_NS + PERIOD_NS * (k // 500 * 500)
                bag.write_stamped(
                    OIL_TEMPERATURE, reading, {"temperature": [40.0 + k // 500]}, log_ns=stamp
                )
    read = read_recording(tmp_path / "bag", robot)
    assert read.duplicates == {OIL_TEMPERATURE: 10}
    assert read.temperature_c is not None
    np.testing.assert_array_equal(read.temperature_c, [40.0, 41.0])
    for notes in (read.notes, inspect_bag(tmp_path / "bag").damage):
        assert not any(OIL_TEMPERATURE in note for note in notes)
