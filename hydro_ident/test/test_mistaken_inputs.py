"""Recordings whose time or voltages look like another unit are told; slow logs are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import recording_of
from hydro_ident.inspecting.health import find_irregularities

N = 1500
START = np.array([0.8, -1.2])


@pytest.mark.parametrize(
    ("volts", "way", "told"),
    [(1e-3, 1.0, True), (0.1, 1.0, False), (0.0, 1.0, False), (1e-3, 0.05, False)],
    ids=["mV", "V", "none", "creeping"],
)
def test_valves_that_are_as_good_as_closed_move_no_arm(
    volts: float, way: float, told: bool, write_bag, run_columns, robot
) -> None:
    """V read as mV; at 0 V throughout somebody else moves it, by null biases it creeps."""
    columns = run_columns(N)
    for topic in ("/valve_state", "/valve_command"):
        names, fields = columns[topic]
        columns[topic] = (names, {"effort": volts * fields["effort"]})
    fields = columns["/joint_states"][1]
    fields["position"] = START + way * (fields["position"] - START)
    recording = recording_of(read_bag(write_bag(columns)), robot)
    found = [f.text for f in find_irregularities(recording) if f.signal == "valves"]
    assert [" mV although lift, tilt moved: is the unit V" in text for text in found] == [1] * told


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (1000.0, "500 Hz, sensors.rate_hz of the robot file, found 0.5 Hz: is the unit of time"),
        (0.001, "seconds read as milliseconds?"),
        (25.0, ""),
        (0.25, ""),
    ],
)
def test_a_rate_that_is_none_of_the_machines_is_worth_a_look(
    times: float, said: str, write_bag, run_columns, robot
) -> None:
    """A log at 20 Hz or at 2 kHz of a machine of 500 Hz is one."""
    recording = recording_of(read_bag(write_bag(run_columns(N))), robot)
    since = recording.stamp_ns - recording.stamp_ns[0]
    stamps = recording.stamp_ns[0] + np.rint(since * times).astype(np.int64)
    other = replace(recording, stamp_ns=stamps, period_s=times * recording.period_s)
    found = [f for f in find_irregularities(other) if (f.signal, f.kind) == ("cycles", "unit")]
    assert [said in f.text and not f.harmless for f in found] == [True] * bool(said)
