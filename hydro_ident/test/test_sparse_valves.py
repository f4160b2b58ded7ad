"""Voltages of controllers that are slower than the sensors, or that send changes alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from hydro_ident.bag.digest import Digest
from hydro_ident.bag.recording import Recording, read_recording
from hydro_ident.bag.streaming import stream_recordings
from hydro_ident.estimate.flows.chambers import WindowSettings, chamber_rows, chambers_of
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.recordings.sources import KeptSource, bag_source
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_STATES, VALVE_COMMAND, VALVE_STATE

N, PERIOD_S = 1500, 0.002


@pytest.fixture
def bag_of(write_bag, run_columns):
    """A bag with the messages of topics of valves in the cycles given; returns it and voltages.

    Voltages change with the cycles that are told.
    """

    def write(cycles: Mapping[str, np.ndarray], voltages: np.ndarray | None = None):
        columns = run_columns(N)
        volts = columns[VALVE_COMMAND][1]["effort"] if voltages is None else voltages
        chosen = {topic: columns[topic] for topic in (JOINT_STATES, CHAMBER_PRESSURES)}
        for topic, told in cycles.items():
            names, _ = columns[topic]
            effort = np.full_like(volts, np.nan)
            effort[told] = volts[told]
            chosen[topic] = names, {"effort": effort}
        name = "given" if voltages is not None else "own"
        return write_bag(chosen, name=name), volts

    return write


def _every_way(path, robot: Robot) -> list[Recording]:
    """As a whole, as `diagnose` reads it, and in pieces as `identify` does."""
    digest = Digest()
    for piece in stream_recordings(path, robot, 0.5, 0.2):
        digest.add(piece)
    [kept] = KeptSource(bag_source(path, robot)).pieces()
    return [read_recording(path, robot), kept.recording, digest.recording()]


def _windows(recording: Recording) -> int:
    """Windows of the balances of all chambers."""
    [trace] = traces_of([recording])
    settings = WindowSettings()
    chambers = chambers_of(recording.robot)
    return sum(len(chamber_rows(one, trace, 0.0, settings).y) for one in chambers)


@pytest.mark.parametrize("topic", [VALVE_COMMAND, VALVE_STATE])
def test_a_slower_controllers_voltages_are_held_until_the_next(
    bag_of, robot: Robot, small_blocks, topic: str
) -> None:
    """100 Hz among sensors of 500 Hz: every window of the balances has its voltage."""
    small_blocks(100)
    path, volts = bag_of({topic: np.arange(0, N, 5)})
    held = np.repeat(volts[::5], 5, axis=0)
    full = bag_of({topic: np.arange(N)}, held)[0]
    said = f"{topic} tells voltages in 20% of the cycles: each is held until the next, for up to"
    for recording in _every_way(path, robot):
        np.testing.assert_array_equal(recording.valve_v, held)
        assert recording.losses == ()
        assert [note for note in recording.notes if note.startswith(said)]
    sparse, dense = read_recording(path, robot), read_recording(full, robot)
    assert _windows(sparse) == _windows(dense) > 0
    assert not any("held" in note for note in dense.notes)


def test_voltages_sent_on_change_are_held_no_longer_than_a_tenth_of_a_second(
    bag_of, robot: Robot
) -> None:
    told = np.array([0, 7, 9, 30, 400, 402, 1000, N - 1])
    path, volts = bag_of({VALVE_COMMAND: told})
    recording = read_recording(path, robot)
    last = told[np.searchsorted(told, np.arange(N), side="right") - 1]
    known = (np.arange(N) - last) * PERIOD_S <= 0.1 + 1e-9
    assert recording.valve_v is not None
    np.testing.assert_array_equal(recording.valve_v[known], volts[last[known]])
    assert np.isnan(recording.valve_v[~known]).all()
    without = f"{np.mean(~known):.0%} of the cycles stay without"
    assert any(note.endswith(without) for note in recording.notes)


def test_a_message_that_was_lost_is_not_made_up(bag_of, robot: Robot) -> None:
    """What valves were told meanwhile nobody knows."""
    told = np.setdiff1d(np.arange(N), np.arange(3, N, 10))
    path, _ = bag_of({VALVE_COMMAND: told})
    recording = read_recording(path, robot)
    assert recording.valve_v is not None
    assert np.flatnonzero(np.isnan(recording.valve_v).all(axis=1)).tolist() == [*range(3, N, 10)]
    assert not any("held" in note for note in recording.notes)
    assert [n for n in recording.notes if n.startswith(f"{VALVE_COMMAND} tells voltages in 90%")]


def test_a_node_that_was_down_for_long_is_not_slow(bag_of, robot: Robot) -> None:
    told = np.setdiff1d(np.arange(N), [30, 60, *range(400, 1000)])
    path, _ = bag_of({VALVE_COMMAND: told})
    recording = read_recording(path, robot)
    assert recording.valve_v is not None
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(recording.valve_v[:, 0])), told)
    assert [n for n in recording.notes if n.startswith(f"{VALVE_COMMAND} tells voltages in 60%")]


def test_a_controller_that_paused_is_not_slow_read_any_way(
    bag_of, robot: Robot, small_blocks
) -> None:
    """Pieces that begin or end within the pause: what was lost outside it is not made up."""
    small_blocks(100)
    told = np.setdiff1d(np.arange(N), [*range(570, 1060), 1200])
    path, _ = bag_of({VALVE_COMMAND: told})
    said = f"{VALVE_COMMAND} tells voltages in {len(told) / N:.0%} of the cycles: windows of flows"
    for recording in _every_way(path, robot):
        assert recording.valve_v is not None
        np.testing.assert_array_equal(np.flatnonzero(np.isfinite(recording.valve_v[:, 0])), told)
        assert not any("held" in note for note in recording.notes)
        assert [note for note in recording.notes if note.startswith(said)]


def test_commands_are_taken_beside_one_burst_of_the_valves_state(
    bag_of, robot: Robot, small_blocks
) -> None:
    small_blocks(100)
    path, volts = bag_of({VALVE_COMMAND: np.arange(N), VALVE_STATE: np.arange(900, 950)})
    said = f"{VALVE_STATE} tells voltages in 3% of the cycles, {VALVE_COMMAND} in 100%"
    for recording in _every_way(path, robot):
        np.testing.assert_array_equal(recording.valve_v, volts)
        assert recording.valve_source == VALVE_COMMAND
        assert [note for note in recording.notes if note.startswith(said)]
        assert not any("held" in note for note in recording.notes)


def test_a_controller_hardly_slower_than_the_sensors_is_sparse(bag_of, robot: Robot) -> None:
    """350 Hz among 500 Hz: most voltages are one cycle behind the one before, not all."""
    told = np.unique(np.arange(0.0, N, 500.0 / 350.0).astype(int))
    recording = read_recording(bag_of({VALVE_COMMAND: told})[0], robot)
    assert np.isfinite(recording.valve_v).all()
    assert any("70% of the cycles: each is held" in note for note in recording.notes)


def test_commands_are_taken_where_the_valves_state_is_told_seldom(
    bag_of, robot: Robot, small_blocks
) -> None:
    small_blocks(100)
    path, volts = bag_of({VALVE_COMMAND: np.arange(N), VALVE_STATE: np.arange(0, N, 10)})
    said = f"{VALVE_STATE} tells voltages in 10% of the cycles, {VALVE_COMMAND} in 100%"
    for recording in _every_way(path, robot):
        np.testing.assert_array_equal(recording.valve_v, volts)
        assert recording.valve_source == VALVE_COMMAND
        assert [note for note in recording.notes if note.startswith(said)]
        assert not recording.latched.any()


def test_a_latch_is_seen_in_a_state_that_is_told_seldom(write_bag, run_columns, robot) -> None:
    columns = run_columns(N)
    names, fields = columns[VALVE_STATE]
    state = fields["effort"].copy()
    state[500:800] = 0.0
    state[np.arange(N) % 10 != 0] = np.nan
    columns[VALVE_STATE] = names, {"effort": state}
    recording = read_recording(write_bag(columns), robot)
    assert recording.latched[500:800].all()
    assert not recording.latched[:500].any()
    assert not recording.latched[800:].any()
