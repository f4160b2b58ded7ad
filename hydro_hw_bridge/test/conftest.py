"""What the bridge's tests share: the reference robot, its codec, and readings to send."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.codec import Codec, Readings, Status
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

GOOD = Status(emergency_stop_ok=True, pump_on=True, enable_switch=True)


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot("xs031")


@pytest.fixture(scope="session")
def codec(robot: Robot) -> Codec:
    return Codec.load(None, None, robot)


@pytest.fixture(scope="session")
def readings() -> Callable[..., Readings]:
    """Readings of a cycle: `readings(counter, pump_on=False, spools=...)`."""

    def make(counter: int, **changes: Any) -> Readings:
        bits = {k: v for k, v in changes.items() if hasattr(GOOD, k)}
        values = {k: v for k, v in changes.items() if k not in bits}
        usual = Readings(
            counter=counter,
            status=replace(GOOD, **bits),
            positions=(0.3, -0.5),
            pressures_pa=(5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 1.0e6),
            spools=(0.1, -0.2),
            oil_temperature_c=40.0,
        )
        return replace(usual, **values)

    return make
