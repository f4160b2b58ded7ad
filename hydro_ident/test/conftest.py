"""Bags for the tests of this folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.bag.cdr import JOINT_STATE, POINT_STAMPED
from hydro_ident.bag.writer import BagWriter
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 2_000_000

#: Topic -> (names or None, field -> (N, k) array); rows of NaN are not written.
Columns = Mapping[str, tuple[tuple[str, ...], Mapping[str, np.ndarray]]]
WriteBag = Callable[..., Path]


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot("xs031")


@pytest.fixture
def write_bag(tmp_path: Path) -> WriteBag:
    """Writes columns by the project's writer; returns the bag's directory."""

    def write(
        columns: Columns,
        *,
        name: str = "bag",
        stamps: np.ndarray | None = None,
        repeat: Mapping[str, int] | None = None,
        **options: object,
    ) -> Path:
        count = max(len(next(iter(fields.values()))) for _, fields in columns.values())
        if stamps is None:
            stamps = START_NS + PERIOD_NS * np.arange(count)
        with BagWriter(tmp_path / name, **options) as writer:  # type: ignore[arg-type]
            for topic, (names, _) in columns.items():
                writer.add_topic(topic, JOINT_STATE if names else POINT_STAMPED)
            for k in range(count):
                for topic, (names, fields) in columns.items():
                    values = {f: v[k] for f, v in fields.items() if k < len(v)}
                    if not values or np.isnan(next(iter(values.values()))).any():
                        continue
                    for _ in range((repeat or {}).get(topic, 0) + 1 if k == 0 else 1):
                        writer.write_stamped(topic, int(stamps[k]), values, names=names)
        return tmp_path / name

    return write


@pytest.fixture
def run_columns(robot: Robot) -> Callable[[int], dict[str, tuple[tuple[str, ...], dict]]]:
    """A plausible run of the reference crane, absolute pressures, every cycle topic."""

    def columns(count: int) -> dict[str, tuple[tuple[str, ...], dict]]:
        rng = np.random.default_rng(3)
        t = np.arange(count)[:, None] * 2e-3
        q = np.array([0.8, -1.2]) + 0.2 * np.sin(t * [3.0, 4.0])
        pressure = 5e6 + 1e4 * rng.normal(size=(count, len(robot.pressure_names)))
        volts = np.clip(rng.normal(size=(count, 2)), -9.0, 9.0)
        tip = np.column_stack([2.0 + 0.1 * np.sin(t), 0.0 * t, 0.1 * t])
        return {
            "/joint_states": (robot.joint_names, {"position": q, "velocity": 0.0 * q}),
            "/chamber_pressures": (robot.pressure_names, {"effort": pressure}),
            "/valve_command": (robot.valve_names, {"effort": volts}),
            "/valve_state": (robot.valve_names, {"effort": volts, "position": volts / 10}),
            "/joint_reference": (
                robot.joint_names,
                {"position": q + 0.01, "velocity": 0.5 * q, "effort": 1e4 * q},
            ),
            "/tip_reference": ((), {"point": tip}),
        }

    return columns
