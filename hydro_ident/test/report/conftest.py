"""The report of a simulated run of the reference crane, which several files look at."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.identification import Identification, identify
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot_files import load_robot

ORIGIN = {
    "command": "identify 'a & b' --robot <robot>",
    "version": "0.1.0",
    "robot": "<robot>",
    "bags": [{"name": "run<b>1</b>&.mcap", "sha256": "0" * 64}],
    "validation": [],
    "robot_files": [{"name": "xs031.urdf", "sha256": "1" * 64}],
    "compared": [],
}


@pytest.fixture(scope="session")
def found(crane_run: Any) -> Identification:
    robot, count = load_robot("xs031"), len(crane_run.q)
    rail = np.ones(count)
    recording = Recording(
        path=Path("run"), robot=robot, stamp_ns=10**18 + np.arange(count) * 2_000_000,
        period_s=0.002, q=crane_run.q, stroke=None, effort=None, p_a=crane_run.p_a,
        p_b=crane_run.p_b, supply=robot.supply_pressure_pa * rail,
        tank=robot.tank_pressure_pa * rail, valve_v=crane_run.voltage,
        valve_source="/valve_state", command_v=crane_run.voltage, spool=None,
        latched=np.zeros(count, dtype=bool), q_ref=None, qd_ref=None, force_ref=None,
        tip_ref=np.asarray(tip_position(robot, crane_run.q)) + np.array([0.003, 0.0, 0.0]),
        temperature_stamp_ns=None, temperature_c=None, losses=(), gaps=(), duplicates={},
        notes=(), metadata={},
    )  # fmt: skip
    return identify(robot, [recording])


@pytest.fixture(scope="session")
def page_of() -> Callable[[Identification], str]:
    """The report of a result, whose sources have names that would break a page."""
    from hydro_ident.report.identification_report import report_html

    return lambda result: report_html(result, ORIGIN)


@pytest.fixture(scope="session")
def report(found: Identification, page_of: Callable[[Identification], str]) -> str:
    return page_of(found)
