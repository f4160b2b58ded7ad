"""Numbers of a log that stand for no reading, such as DBL_MAX of a logger, are none."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.bag.recording import read_recording
from hydro_ident.logs.convert import Conversion, convert
from hydro_ident.logs.file import read_log
from hydro_ident.logs.map import read_map
from hydro_model.robot import Robot

COUNT = 400
MAP = {
    "schema": "hydro_ident/log_map/1",
    "robot": "xs031",
    "time": {"signal": "t", "unit": "ms"},
    "joints": {
        "lift": {"signal": "q1", "unit": "deg", "wrap": 360},
        "tilt": {"signal": "q2", "unit": "deg", "sign": -1},
    },
    "pressures": {
        "supply": {"signal": "ps", "unit": "MPa", "reference": "gauge"},
        "tank": {"signal": "pt", "unit": "bar", "reference": "gauge"},
    },
    "valves": {"lift_valve": {"signal": "u1"}},
    "oil_temperature": {"signal": "T"},
}
SIGNALS = {
    "q1": "joints, lift",
    "q2": "joints, tilt",
    "ps": "pressures, supply",
    "u1": "valves, lift_valve",
    "T": "oil_temperature",
}


def _convert(folder: Path, lost: dict[str, float]) -> Conversion:
    t = np.arange(COUNT) * 1.0
    columns = {
        "t": t,
        "q1": (359.0 + 0.05 * t) % 360.0,
        "q2": 60.0 + 5.0 * np.cos(0.01 * t),
        "ps": 19.0 + 0.1 * np.sin(t),
        "pt": 2.0 + 0.01 * np.cos(t),
        "u1": np.sin(0.02 * t),
        "T": 41.5 + 0.001 * t,
    }
    for name, number in lost.items():
        columns[name][100:120] = number
    table = np.column_stack(list(columns.values())).tolist()
    rows = [",".join(columns), *(",".join(map(repr, row)) for row in table)]
    (folder / "log.csv").write_text("\n".join(rows) + "\n")
    (folder / "map.yaml").write_text(yaml.safe_dump(MAP))
    mapping = read_map(folder / "map.yaml")
    log = read_log(folder / "log.csv")
    return convert(log, mapping, folder / "bag", {})


@pytest.mark.parametrize("number", [sys.float_info.max, -sys.float_info.max, 1e20])
@pytest.mark.parametrize("signal", SIGNALS)
def test_a_number_that_no_reading_can_be_is_left_out_and_said(
    tmp_path: Path, robot: Robot, signal: str, number: float
) -> None:
    """Angles that go on behind it are unwrapped as if it were not there."""
    for name in ("whole", "lost"):
        (tmp_path / name).mkdir()
    whole = _convert(tmp_path / "whole", {})
    lost = _convert(tmp_path / "lost", {signal: number})
    said = f"{SIGNALS[signal]}: 20 samples beyond any physical size left out"
    assert [r for r in lost.remarks if r not in whole.remarks] == [said]
    assert lost.warnings == whole.warnings == ()
    one, other = (read_recording(tmp_path / n / "bag", robot) for n in ("whole", "lost"))
    for field in ("q", "supply", "valve_v"):
        values, expected = getattr(other, field), getattr(one, field)
        gone = np.isnan(values) & ~np.isnan(expected)
        assert not gone[:100].any()
        assert not gone[120:].any()
        np.testing.assert_allclose(values[~gone], expected[~gone], rtol=0.0, atol=1e-12)
    assert one.temperature_c is not None
    assert other.temperature_c is not None
    assert len(one.temperature_c) - len(other.temperature_c) == (20 if signal == "T" else 0)
