"""What the tests of hydraulics share: chambers that are integrated apart from the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.flows.hydraulics import HydraulicFit, fit_hydraulics
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.robot import Robot

H = 0.002
EDGES = {"c_pa": 7.2e-7, "c_at": 6.9e-7, "c_pb": 7.5e-7, "c_bt": 8.3e-7}
BULK = 7.3e8
SUPPLY, TANK = 18.0e6, 0.8e6


def _steady(t: float) -> float:
    return SUPPLY


def _falling(t: float) -> float:
    return SUPPLY - 1.5e6 * (1.0 - np.cos(3.0 * t))


def _chamber(
    side: str,
    robot: Robot,
    time: np.ndarray,
    u: np.ndarray,
    delay: float,
    supply: Callable[[float], float] = _steady,
    leakage: float = 0.0,
) -> np.ndarray:
    """Pressure of one chamber on a piston that moves as x = 0.3 + 0.1 sin: written out anew."""
    cylinder = robot.cylinders[0]
    area = np.pi / 4 * (cylinder.bore_m**2 - (cylinder.rod_m**2 if side == "b" else 0.0))

    def rate(t: float, p: float, command: float) -> float:
        x, v = 0.3 + 0.1 * np.sin(2.0 * t), 0.2 * np.cos(2.0 * t)
        if side == "a":
            edge = EDGES["c_pa"] if command > 0 else EDGES["c_at"]
            drop = supply(t) - p if command > 0 else p - TANK
            volume, swept = area * x, area * v
        else:
            edge = EDGES["c_bt"] if command > 0 else EDGES["c_pb"]
            drop = p - TANK if command > 0 else supply(t) - p
            command = -command
            volume, swept = area * (cylinder.stroke_m - x), -area * v
        flow = edge * command * np.sign(drop) * np.sqrt(abs(drop))
        return BULK / volume * (flow - swept - leakage * p)

    pressure, p = [9.0e6], 9.0e6
    step = float(time[1] - time[0])
    for k, t in enumerate(time[:-1]):
        # From switch to switch: the signal is constant in between, so Runge-Kutta keeps order 4.
        for begin, length, command in (
            (t, delay, u[max(k - 1, 0)]),
            (t + delay, step - delay, u[k]),
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


def _run(robot: Robot, seconds: float = 6.0, **laws: object) -> Trace:
    time = np.arange(0.0, seconds, H)
    u = _signal(robot, time)
    p_a, p_b = (_chamber(side, robot, time, u, 0.001, **laws) for side in "ab")  # type: ignore[arg-type]
    return _trace(robot, u, time, p_a, p_b)


@dataclass(frozen=True)
class Bench:
    """Chambers integrated apart from the model, and their fits."""

    H: float = H
    EDGES: dict[str, float] = field(default_factory=lambda: dict(EDGES))
    BULK: float = BULK
    chamber: Callable[..., Any] = _chamber
    signal: Callable[..., Any] = _signal
    trace: Callable[..., Any] = _trace
    fit: Callable[..., Any] = _fit
    run: Callable[..., Any] = _run
    falling: Callable[[float], float] = _falling


@pytest.fixture(scope="session")
def bench() -> Bench:
    """What the tests of hydraulics share."""
    return Bench()
