"""What valves are taken to have had: by their state, by their command, and where they latched."""

from __future__ import annotations

import numpy as np

from hydro_ident.bag.latches import latched_cycles
from hydro_ident.bag.recording import read_recording
from hydro_ident.inspecting.inspection_reading import inspect_bag

N = 300


def test_latched_spans_are_told(write_bag, run_columns, robot) -> None:
    columns = run_columns(N)
    volts = columns["/valve_state"][1]["effort"]
    volts = np.where(volts == 0.0, 0.1, volts)
    columns["/valve_command"] = (robot.valve_names, {"effort": volts})
    applied = volts.copy()
    applied[120:160] = 0.0
    columns["/valve_state"] = (robot.valve_names, {"effort": applied})
    r = read_recording(write_bag(columns), robot)
    np.testing.assert_array_equal(np.flatnonzero(r.latched), np.arange(120, 160))


def test_a_valve_that_the_state_does_not_tell_has_its_command(
    write_bag, run_columns, robot
) -> None:
    """The one that is told says when the gate held both."""
    columns = run_columns(N)
    volts = columns["/valve_state"][1]["effort"]
    volts = np.where(volts == 0.0, 0.1, volts)
    columns["/valve_command"] = (robot.valve_names, {"effort": volts})
    applied = volts[:, :1].copy()
    applied[120:160] = 0.0
    columns["/valve_state"] = (robot.valve_names[:1], {"effort": applied})
    r = read_recording(write_bag(columns), robot)
    np.testing.assert_array_equal(r.valve_v, np.hstack([applied, volts[:, 1:]]))
    np.testing.assert_array_equal(np.flatnonzero(r.latched), np.arange(120, 160))
    assert r.commanded == robot.valve_names[1:]
    lost = {loss.channel for loss in r.losses}
    assert not {"tilt/flow_a", "tilt/flow_b"} & lost
    said = f"no {robot.valve_names[1]} in /valve_state: its voltage is what /valve_command tells"
    assert said in r.notes
    # Rest of the told one is no latch although the other moves.
    volts[200:260, 0] = 0.0
    applied[200:260] = 0.0
    columns["/valve_command"] = (robot.valve_names, {"effort": volts})
    columns["/valve_state"] = (robot.valve_names[:1], {"effort": applied})
    again = read_recording(write_bag(columns, name="again"), robot)
    np.testing.assert_array_equal(np.flatnonzero(again.latched), np.arange(120, 160))


def test_a_valve_that_no_topic_tells_is_not_said_to_have_its_command(
    write_bag, run_columns, robot
) -> None:
    columns = run_columns(N)
    del columns["/valve_command"]
    names, fields = columns["/valve_state"]
    columns["/valve_state"] = names[:1], {"effort": fields["effort"][:, :1]}
    bag = write_bag(columns)
    r = read_recording(bag, robot)
    assert r.commanded == robot.valve_names[1:]
    assert not [note for note in r.notes if "/valve_command" in note]
    assert {loss.channel: loss.reason for loss in r.losses} == {
        f"tilt/flow_{s}": "no tilt_valve in /valve_state" for s in "ab"
    }
    assert inspect_bag(bag, robot).damage == [*r.notes] == []


def test_zero_volts_asked_for_or_delayed_are_no_latch() -> None:
    command = np.zeros((100, 2))
    command[50:] = 1.0
    applied = np.zeros((100, 2))
    applied[52:] = 1.0
    assert not latched_cycles(100, applied, command).any()
    assert not latched_cycles(100, applied, None).any()
    assert not latched_cycles(100, None, command).any()
    applied[:] = 0.0
    assert np.flatnonzero(latched_cycles(100, applied, command)).tolist() == list(range(50, 100))


def test_commands_that_a_converter_rounds_to_zero_are_no_latch() -> None:
    step = 20.0 / 4096.0
    command = 0.02 * np.sin(0.02 * np.arange(1000.0))[:, None]
    applied = step * np.round(command / step)
    still = np.abs(applied) == 0.0
    assert np.count_nonzero(np.abs(command[still]) > 1e-3) > 10
    assert not latched_cycles(1000, applied, command).any()
