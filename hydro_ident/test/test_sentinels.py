"""Numbers that stand for no reading, such as DBL_MAX of a driver, are none."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.writer import BagWriter
from hydro_ident.commands import inspect
from hydro_ident.inspecting.health import find_irregularities
from hydro_ident.inspecting.inspection import ranges_of
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import JOINT_STATE, TEMPERATURE

DBL_MAX, FLT_MAX = sys.float_info.max, 3.4028234663852886e38
N, LOST = 400, slice(100, 120)
#: Topic, field of the message, column, and the field of a recording with its column.
SIGNALS = [
    ("/joint_states", "position", 0, "q", 0),
    ("/chamber_pressures", "effort", 0, "p_a", 0),
    ("/chamber_pressures", "effort", 4, "supply", None),
    ("/valve_state", "effort", 1, "valve_v", 1),
    ("/valve_state", "position", 1, "spool", 1),
    ("/joint_reference", "velocity", 0, "qd_ref", 0),
    ("/tip_reference", "point", 2, "tip_ref", 2),
]


def _column(recording: Any, field: str, column: int | None) -> np.ndarray:
    values: np.ndarray = getattr(recording, field)
    return values if column is None else values[:, column]


@pytest.mark.parametrize("number", [DBL_MAX, -DBL_MAX, FLT_MAX, 1e20, math.inf])
@pytest.mark.parametrize(("topic", "field", "at", "name", "column"), SIGNALS)
def test_a_number_that_no_reading_can_be_is_missing(
    write_bag: Any,
    run_columns: Any,
    robot: Robot,
    topic: str,
    field: str,
    at: int,
    name: str,
    column: int | None,
    number: float,
) -> None:
    columns = run_columns(N)
    whole = _column(read_recording(write_bag(columns, name="whole"), robot), name, column)
    columns[topic][1][field] = columns[topic][1][field].copy()
    columns[topic][1][field][LOST, at] = number
    path = write_bag(columns)
    recording = read_recording(path, robot)
    expected = whole.copy()
    expected[LOST] = np.nan
    np.testing.assert_array_equal(_column(recording, name, column), expected)
    ranges = [(r.low, r.high, r.mean) for r in inspect_bag(path, robot).ranges]
    assert np.isfinite(ranges).all()
    assert ranges == [(r.low, r.high, r.mean) for r in ranges_of(recording)]


@pytest.mark.parametrize(
    ("topic", "field", "at", "signal"),
    [
        ("/joint_states", "position", 1, "tilt"),
        ("/chamber_pressures", "effort", 3, "tilt_cylinder/b"),
        ("/chamber_pressures", "effort", 4, "supply"),
    ],
)
def test_it_is_counted_as_what_is_not_finite(
    write_bag: Any, run_columns: Any, robot: Robot, topic: str, field: str, at: int, signal: str
) -> None:
    """And nothing else is said of it: neither a limit that was passed nor a full range."""
    columns = run_columns(N)
    values = columns[topic][1][field]
    values[LOST, at] = DBL_MAX
    values[LOST.stop, at] = math.inf
    path = write_bag(columns)
    found = [f for f in find_irregularities(read_recording(path, robot)) if f.signal == signal]
    assert [(f.kind, f.text) for f in found] == [
        ("not_finite", "21 samples are not finite or beyond any physical size")
    ]
    assert [f for f in inspect_bag(path, robot).findings if f.signal == signal] == found


def test_the_command_tells_a_bag_with_such_numbers(
    write_bag: Any, run_columns: Any, tmp_path: Path
) -> None:
    columns = run_columns(N)
    for topic, field, at, *_ in SIGNALS:
        columns[topic][1][field][LOST, at] = DBL_MAX
    file = tmp_path / "told.json"
    assert inspect.main([str(write_bag(columns)), "--robot", "xs031", "--json", str(file)]) == 0
    assert json.loads(file.read_text())["cycles"] == N


def test_an_oil_temperature_may_be_one(tmp_path: Path, run_columns: Any, robot: Robot) -> None:
    names, fields = run_columns(N)["/joint_states"]
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/joint_states", JOINT_STATE)
        writer.add_topic("/oil_temperature", TEMPERATURE)
        for k in range(N):
            position = {"position": fields["position"][k]}
            writer.write_stamped("/joint_states", 10**18 + 10**7 * k, position, names=names)
            told = {"temperature": DBL_MAX if k in range(*LOST.indices(N)) else 40.0}
            writer.write_stamped("/oil_temperature", 10**18 + 10**7 * k, told)
    temperature = read_recording(tmp_path / "bag", robot).temperature_c
    assert temperature is not None
    assert np.isnan(temperature[LOST]).all()
    assert np.nansum(temperature) == 40.0 * (N - 20)
    (oil,) = [r for r in inspect_bag(tmp_path / "bag", robot).ranges if "oil" in r.signal]
    assert (oil.low, oil.high, oil.mean) == (40.0, 40.0, 40.0)


@pytest.mark.parametrize(
    ("topic", "field", "factor"),
    [
        ("/joint_states", "position", 1e6),  # urad for rad, um for m
        ("/joint_states", "position", 2.0**24 / (2.0 * math.pi)),  # counts of an encoder
        ("/valve_state", "effort", 1e6),  # uV for V
        ("/chamber_pressures", "effort", 1e3),  # mPa for Pa
    ],
)
def test_readings_in_a_wrong_unit_are_readings(
    write_bag: Any, run_columns: Any, robot: Robot, topic: str, field: str, factor: float
) -> None:
    """What tells that the unit is wrong has to see them."""
    columns = run_columns(N)
    names = {"/joint_states": "q", "/valve_state": "valve_v", "/chamber_pressures": "p_a"}
    columns[topic][1][field] = columns[topic][1][field] * factor
    recording = read_recording(write_bag(columns), robot)
    assert np.isfinite(getattr(recording, names[topic])).all()
