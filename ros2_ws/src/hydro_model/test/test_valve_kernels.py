"""Flows of the edges that a kernel writes into rows of signals, against the readable law."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_model.effects import signals as sig
from hydro_model.effects.rows import set_valve_signal
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
PRESSURES = (sig.PRESSURE_A, sig.PRESSURE_B, sig.SUPPLY_PRESSURE, sig.TANK_PRESSURE)


def rows_and_signal() -> tuple[FloatArray, FloatArray]:
    """Pressures of either sign of difference, signals of either sign and none."""
    rng = np.random.default_rng(11)
    rows = rng.uniform(0.0, 1.0, (500, sig.SIGNAL_COUNT))
    rows[:, PRESSURES] = rng.uniform(-1e5, 2.2e7, (500, 4))
    u = rng.uniform(-1.0, 1.0, 500)
    u[:20] = 0.0
    return rows, u


def expected(rows: FloatArray, u: FloatArray, cylinder: int) -> FloatArray:
    valve = ROBOT.valve_of(ROBOT.cylinders[cylinder].name)
    return np.stack(edge_flows(valve, u, *(rows[:, c] for c in PRESSURES)))


@pytest.mark.parametrize("cylinder", [0, 1])
def test_the_flows_written_are_those_of_the_law(cylinder: int) -> None:
    rows, u = rows_and_signal()
    before = rows.copy()
    set_valve_signal(rows, ROBOT, cylinder, u)
    written = (sig.VALVE_FLOW_A, sig.VALVE_FLOW_B)
    np.testing.assert_allclose(rows[:, written].T, expected(rows, u, cylinder), rtol=1e-12)
    np.testing.assert_array_equal(rows[:, sig.VALVE_SIGNAL], u)
    others = np.setdiff1d(np.arange(sig.SIGNAL_COUNT), (*written, sig.VALVE_SIGNAL))
    np.testing.assert_array_equal(rows[:, others], before[:, others])


@pytest.mark.parametrize("column", [*PRESSURES, sig.VALVE_SIGNAL])
def test_what_is_unknown_leaves_the_flows_unknown_that_the_law_leaves_so(column: int) -> None:
    rows, u = rows_and_signal()
    if column == sig.VALVE_SIGNAL:
        u[100:200] = np.nan
    else:
        rows[100:200, column] = np.nan
    set_valve_signal(rows, ROBOT, 0, u)
    written = rows[:, (sig.VALVE_FLOW_A, sig.VALVE_FLOW_B)].T
    np.testing.assert_array_equal(np.isnan(written), np.isnan(expected(rows, u, 0)))
    assert np.isnan(written[:, 100:200]).any()
    assert not np.isnan(written[:, 200:]).any()
