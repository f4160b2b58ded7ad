"""Rails that are read now and then, and sensors that are dead: followed, left out, and said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.digest import Digest
from hydro_ident.bag.recording import Recording, read_recording
from hydro_ident.bag.streaming import stream_recordings
from hydro_ident.bag.writer import BagWriter
from hydro_ident.estimate.signals.traces import traces_of, traces_of_piece
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import JOINT_STATE

START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000
COUNT = 3000
#: Sinks by a quarter within six seconds; the robot file has 190 bar.
SUPPLY_PA = 160e5 - 40e5 * np.linspace(0.0, 1.0, COUNT)


def supply_bag(path: Path, robot: Robot, read: np.ndarray) -> Path:
    """A run whose pressure messages have the supply where it was read, all else always."""
    time = PERIOD_NS * 1e-9 * np.arange(COUNT)
    noise = 1e4 * np.random.default_rng(1).normal(size=(COUNT, 5))
    with BagWriter(path) as writer:
        for topic in ("/joint_states", "/chamber_pressures", "/valve_state"):
            writer.add_topic(topic, JOINT_STATE)
        for k in range(COUNT):
            stamp, q = START_NS + k * PERIOD_NS, [0.8 + 0.2 * np.sin(time[k]), -1.2]
            writer.write_stamped("/joint_states", stamp, {"position": q}, names=robot.joint_names)
            values = [*(5e6 + noise[k, :4]), 1e6 + noise[k, 4], SUPPLY_PA[k] + 101325.0]
            kept = len(values) if read[k] else -1
            names = [n for n in robot.pressure_names if n not in ("supply", "tank")]
            writer.write_stamped(
                "/chamber_pressures", stamp, {"effort": values[:kept]},
                names=[*names, "tank", "supply"][:kept],
            )  # fmt: skip
            volts = {"effort": [1.0, -1.0]}
            writer.write_stamped("/valve_state", stamp, volts, names=robot.valve_names)
    return path


def losses(recording: Recording) -> dict[str, str]:
    return {loss.channel: loss.reason for loss in recording.losses}


def test_a_supply_in_every_fifth_message_is_followed(tmp_path: Path, robot: Robot) -> None:
    read = np.arange(COUNT) % 5 == 0
    recording = read_recording(supply_bag(tmp_path / "bag", robot, read), robot)
    assert losses(recording) == {}
    [trace] = traces_of([recording])
    assert trace.samples == COUNT
    assert np.abs(trace.supply - SUPPLY_PA).max() < 0.06e5  # held behind the last reading
    assert np.isfinite(trace.valve_signal).all()


def test_a_pause_of_the_recording_is_no_silence_of_a_rail(tmp_path: Path, robot: Robot) -> None:
    read = np.arange(COUNT) % 5 == 0
    whole = read_recording(supply_bag(tmp_path / "bag", robot, read), robot)
    paused = whole.stamp_ns + 10**10 * (np.arange(COUNT) >= 1003)
    traces = traces_of([replace(whole, stamp_ns=paused)])
    assert [t.samples for t in traces] == [1003, COUNT - 1003]
    assert all(np.isfinite(t.valve_signal).all() for t in traces)


def test_a_supply_that_is_silent_for_a_second_is_said_and_costs_the_flows(
    tmp_path: Path, robot: Robot
) -> None:
    read = np.arange(COUNT) % 5 == 0
    read[1000:1500] = False
    path = supply_bag(tmp_path / "bag", robot, read)
    recording = read_recording(path, robot)
    assert set(losses(recording)) == {"supply"}
    assert "not in /chamber_pressures for 1.0 s at a time" in losses(recording)["supply"]
    [trace] = traces_of([recording])
    # Nowhere the robot file's: straight on where nothing is known, and no flow is taken there.
    assert np.abs(trace.supply - SUPPLY_PA).max() < 0.1e5
    silent = np.flatnonzero(np.isnan(trace.valve_signal).any(axis=1))
    assert silent.tolist() == [*range(996, 1500)]
    assert np.isfinite(trace.p_a).all()
    # Read piece by piece, the piece that tells is heard.
    digest = Digest()
    for piece in stream_recordings(path, robot, 1.0, 0.5):
        digest.add(piece)
    assert "not in /chamber_pressures for" in losses(digest.recording())["supply"]


def test_a_supply_that_ends_is_not_replaced_by_the_robot_files(
    tmp_path: Path, robot: Robot
) -> None:
    path = supply_bag(tmp_path / "bag", robot, np.arange(COUNT) < 1000)
    digest, last = Digest(), None
    for piece in stream_recordings(path, robot, 1.0, 0.5):
        digest.add(piece)
        last = piece
    assert last is not None
    for trace in traces_of_piece(last):
        assert np.isnan(trace.valve_signal).all()
    assert "supply" in losses(digest.recording())


def still_at(columns: dict, topic: str, field: str, column: int, value: float) -> dict:
    """The columns with one reading that never changes."""
    names, fields = columns[topic]
    values = fields[field].copy()
    values[:, column] = value
    return columns | {topic: (names, fields | {field: values})}


def dry(columns: dict) -> dict:
    """The columns with measured torques in place of pressures."""
    names, fields = columns["/joint_states"]
    torque = 1e3 * fields["position"]
    rest = {k: v for k, v in columns.items() if k != "/chamber_pressures"}
    return rest | {"/joint_states": (names, fields | {"effort": torque})}


def test_an_effort_of_zero_is_not_measured(
    write_bag: Callable[..., Path], run_columns: Callable[[int], dict], robot: Robot
) -> None:
    columns = dry(run_columns(1000))
    filled, absent = (still_at(columns, "/joint_states", "effort", 1, v) for v in (0.0, np.nan))
    zero, none = (
        read_recording(write_bag(c, name=name), robot)
        for c, name in ((filled, "zero"), (absent, "none"))
    )
    assert losses(zero)["tilt/torque"] == "effort of tilt reads 0 throughout while the robot moves"
    assert set(losses(zero)) == set(losses(none))
    assert "lift/torque" not in losses(zero)
    np.testing.assert_array_equal(zero.effort, none.effort)
    everywhere = still_at(filled, "/joint_states", "effort", 0, 0.0)
    nothing = read_recording(write_bag(everywhere, name="nothing"), robot)
    assert nothing.effort is None
    assert "reads 0 throughout" in losses(nothing)["lift/torque"]


@pytest.mark.parametrize("reading", [0.0, 12.5])
def test_nor_is_a_constant_effort_of_a_parked_joint_while_another_moves(
    write_bag: Callable[..., Path],
    run_columns: Callable[[int], dict],
    robot: Robot,
    reading: float,
) -> None:
    columns = still_at(dry(run_columns(1000)), "/joint_states", "effort", 1, reading)
    parked = still_at(columns, "/joint_states", "position", 1, -1.2)
    found = read_recording(write_bag(parked, name="parked"), robot)
    told = f"effort of tilt reads {reading:g} throughout while the robot moves"
    assert losses(found)["tilt/torque"] == told
    assert found.effort is not None
    assert np.isnan(found.effort[:, 1]).all()
    assert np.isfinite(found.effort[:, 0]).all()


@pytest.mark.parametrize(("absolute_pa", "told"), [(0.0, "0"), (25.5e6, "255")])
def test_a_dead_transducer_is_not_measured(
    write_bag: Callable[..., Path],
    run_columns: Callable[[int], dict],
    robot: Robot,
    absolute_pa: float,
    told: str,
) -> None:
    at = robot.pressure_names.index("lift_cylinder/b")
    columns = still_at(run_columns(1000), "/chamber_pressures", "effort", at, absolute_pa)
    recording = read_recording(write_bag(columns), robot)
    reason = f"lift_cylinder/b reads {told} bar throughout while lift moves"
    assert losses(recording) == {"lift/force": reason, "lift/flow_b": reason}
    assert recording.p_b is not None
    assert np.isnan(recording.p_b[:, 0]).all()


@pytest.mark.parametrize("absolute_pa", [101325.0, 1.5e6])
def test_a_side_under_constant_pressure_is_measured(
    write_bag: Callable[..., Path],
    run_columns: Callable[[int], dict],
    robot: Robot,
    absolute_pa: float,
) -> None:
    """Of a cylinder that one side drives, the other is vented, or under a counter-pressure."""
    at = robot.pressure_names.index("lift_cylinder/b")
    columns = still_at(run_columns(1000), "/chamber_pressures", "effort", at, absolute_pa)
    recording = read_recording(write_bag(columns), robot)
    assert losses(recording) == {}
    assert recording.p_b is not None
    gauge_pa = absolute_pa - robot.atmospheric_pressure_pa
    assert recording.p_b[:, 0] == pytest.approx(gauge_pa)


def test_a_reading_that_does_not_change_while_nothing_moves_is_kept(
    write_bag: Callable[..., Path], run_columns: Callable[[int], dict], robot: Robot
) -> None:
    columns = still_at(dry(run_columns(1000)), "/joint_states", "effort", 1, 0.0)
    for joint, at in enumerate((0.5, -1.2)):
        columns = still_at(columns, "/joint_states", "position", joint, at)
    recording = read_recording(write_bag(columns), robot)
    assert "tilt/torque" not in losses(recording)
    assert recording.effort is not None
    assert (recording.effort[:, 1] == 0.0).all()


@pytest.mark.parametrize("rest_first", [False, True])
def test_a_dead_sensor_stays_dead_in_the_pieces_that_follow(
    write_bag: Callable[..., Path],
    run_columns: Callable[[int], dict],
    robot: Robot,
    rest_first: bool,
) -> None:
    columns = still_at(dry(run_columns(4000)), "/joint_states", "effort", 1, 0.0)
    q = columns["/joint_states"][1]["position"]
    resting = slice(0, 2000) if rest_first else slice(2000, 4000)
    q[resting, 1] = q[2000, 1]
    digest = Digest()
    for piece in stream_recordings(write_bag(columns), robot, 1.0, 0.5):
        digest.add(piece)
        assert piece.recording.effort is not None
        moved = np.ptp(piece.recording.q[:, 1]) > 0.1
        if moved or not rest_first:
            assert np.isnan(piece.recording.effort[:, 1]).all()
    assert "reads 0 throughout" in losses(digest.recording())["tilt/torque"]
