"""Chamber balances: an independent integration of eqs. 10 to 12 gives back what went in."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_ident.estimate.chambers import WindowSettings, chamber_rows, chambers_of
from hydro_ident.estimate.hydraulics import HydraulicFit, fit_hydraulics
from hydro_ident.estimate.traces import Trace
from hydro_model.robot import Robot

H = 0.002
EDGES = {"c_pa": 7.2e-7, "c_at": 6.9e-7, "c_pb": 7.5e-7, "c_bt": 8.3e-7}
BULK = 7.3e8
SUPPLY, TANK = 18.0e6, 0.8e6


def _chamber(side: str, robot: Robot, time: np.ndarray, u: np.ndarray, delay: float) -> np.ndarray:
    """Pressure of one chamber on a piston that moves as x = 0.3 + 0.1 sin: written out anew."""
    cylinder = robot.cylinders[0]
    area = np.pi / 4 * (cylinder.bore_m**2 - (cylinder.rod_m**2 if side == "b" else 0.0))

    def rate(t: float, p: float, command: float) -> float:
        x, v = 0.3 + 0.1 * np.sin(2.0 * t), 0.2 * np.cos(2.0 * t)
        if side == "a":
            edge = EDGES["c_pa"] if command > 0 else EDGES["c_at"]
            drop = SUPPLY - p if command > 0 else p - TANK
            volume, swept = area * x, area * v
        else:
            edge = EDGES["c_bt"] if command > 0 else EDGES["c_pb"]
            drop = p - TANK if command > 0 else SUPPLY - p
            command = -command
            volume, swept = area * (cylinder.stroke_m - x), -area * v
        flow = edge * command * np.sign(drop) * np.sqrt(abs(drop))
        return BULK / volume * (flow - swept)

    pressure, p = [9.0e6], 9.0e6
    for k, t in enumerate(time[:-1]):
        # From switch to switch: the signal is constant in between, so Runge-Kutta keeps order 4.
        for begin, length, command in (
            (t, delay, u[max(k - 1, 0)]),
            (t + delay, H - delay, u[k]),
        ):
            k1 = rate(begin, p, command)
            k2 = rate(begin + length / 2, p + length / 2 * k1, command)
            k3 = rate(begin + length / 2, p + length / 2 * k2, command)
            k4 = rate(begin + length, p + length * k3, command)
            p += length / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        pressure.append(p)
    return np.array(pressure)


def _signal(robot: Robot, time: np.ndarray) -> np.ndarray:
    """About the flow that the piston's motion takes, with steps and a ripple on it."""
    wanted = robot.cylinders[0].area_a_m2 * 0.2 * np.cos(2.0 * time) / (7.5e-7 * 3000.0)
    ripple = 0.06 * np.sign(np.sin(31.0 * time)) + 0.05 * np.sin(17.0 * time)
    return wanted + ripple


def _trace(
    robot: Robot, u: np.ndarray, time: np.ndarray, p_a: np.ndarray, p_b: np.ndarray
) -> Trace:
    count, nan = time.size, np.full((time.size, 2), np.nan)
    columns = [nan.copy() for _ in range(4)]
    columns[0][:, 0] = 0.3 + 0.1 * np.sin(2.0 * time)
    for column, values in zip(columns[1:], (p_a, p_b, u), strict=True):
        column[:, 0] = values
    return Trace(
        "synthetic",
        H,
        time,
        nan,
        columns[0],
        columns[1],
        columns[2],
        np.full(count, SUPPLY),
        np.full(count, TANK),
        columns[3],
        nan,
    )


def _fit(robot: Robot, delay: float, seconds: float = 6.0, **changes: np.ndarray) -> HydraulicFit:
    time = np.arange(0.0, seconds, H)
    u = _signal(robot, time)
    pressures = {side: _chamber(side, robot, time, u, delay) for side in "ab"}
    trace = _trace(robot, u, time, pressures["a"], pressures["b"])
    for name, values in changes.items():
        getattr(trace, name)[:, 0] = values
    fit = fit_hydraulics(robot, [trace])
    assert fit is not None
    return fit


@pytest.mark.parametrize("delay", [0.0, 0.0007, 0.002])
def test_edges_bulk_modulus_and_delay_come_back(robot: Robot, delay: float) -> None:
    fit = _fit(robot, delay)
    (lift,) = fit.cylinders
    assert lift.rejected == ""
    assert fit.delay_s == pytest.approx(delay, abs=2e-5)
    assert lift.bulk_modulus()[0] == pytest.approx(BULK, rel=5e-4)
    for name, value in EDGES.items():
        assert lift.value(name)[0] == pytest.approx(value, rel=1e-4)


def test_each_chamber_alone_gives_the_same_bulk_modulus(robot: Robot) -> None:
    (lift,) = _fit(robot, 0.001).cylinders
    for chamber in lift.chambers:
        assert 1.0 / chamber.fit.theta[0] == pytest.approx(BULK, rel=1e-3)


def test_windows_that_touch_a_latched_span_are_left_out(robot: Robot) -> None:
    time = np.arange(0.0, 2.0, H)
    u = _signal(robot, time)
    trace = _trace(robot, u, time, np.full(time.size, 9e6), np.full(time.size, 9e6))
    trace.valve_signal[400:600, 0] = np.nan
    rows = chamber_rows(chambers_of(robot)[0], trace, 0.001, WindowSettings())
    inside = (rows.time_s > 400 * H - 0.04) & (rows.time_s < 600 * H)
    assert rows.time_s.size > 70
    assert not inside.any()
    assert np.isfinite(rows.x).all()


def test_a_cylinder_with_one_chamber_is_rejected_and_said(robot: Robot) -> None:
    (lift,) = _fit(robot, 0.001, p_b=np.nan).cylinders
    assert lift.rejected == "only one of its two chambers was recorded"


def test_a_signal_of_one_sign_leaves_two_edges_unknown(robot: Robot) -> None:
    time = np.arange(0.0, 6.0, H)
    u = np.abs(_signal(robot, time)) + 0.01
    trace = _trace(
        robot, u, time, _chamber("a", robot, time, u, 0.0), _chamber("b", robot, time, u, 0.0)
    )
    fit = fit_hydraulics(robot, [trace])
    assert fit is not None
    assert "c_at" in fit.cylinders[0].rejected
    assert "c_pb" in fit.cylinders[0].rejected
    assert "cannot be told" in fit.cylinders[0].rejected


def test_a_valve_wired_the_wrong_way_round_is_rejected_not_replaced(robot: Robot) -> None:
    time = np.arange(0.0, 6.0, H)
    (lift,) = _fit(robot, 0.001, valve_signal=-_signal(robot, time)).cylinders
    assert "expected edge coefficients above 0" in lift.rejected


def test_no_pressures_no_hydraulics(robot: Robot) -> None:
    time = np.arange(0.0, 2.0, H)
    nothing = np.full(time.size, np.nan)
    assert fit_hydraulics(robot, [_trace(robot, nothing, time, nothing, nothing)]) is None
