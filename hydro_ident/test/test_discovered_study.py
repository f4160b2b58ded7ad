"""The study of what discovered physics is worth: its machines, bags and figures."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_ident.bag.recording import read_recording
from hydro_ident.errors import IdentError
from hydro_ident.identify.controller_file import controller_text
from hydro_ident.study import discovered
from hydro_ident.study.closed_loop import run_closed_loop
from hydro_ident.study.discovered_summary import summary_lines, summary_of
from hydro_ident.study.force_margin import Motion, force_margin, motion_along
from hydro_ident.study.machine_bags import write_bag
from hydro_model.motion.paths import TipPath, load_path
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")


@pytest.fixture(scope="module")
def motion() -> Motion:
    path = load_path("xs031/parallelogram")
    assert isinstance(path, TipPath)
    return motion_along(ROBOT, path)


def test_the_margin_follows_the_machine(motion: Motion) -> None:
    truth = random_truth(ROBOT, 101)
    margin = force_margin(ROBOT, truth, motion)
    assert 0.3 < margin < 0.6
    rubbing = tuple(
        replace(c, coulomb_friction_n=c.coulomb_friction_n + 5e3, static_friction_n=1e4)
        for c in truth.cylinders
    )
    # 5 kN of some 50 to 95 kN that supply and areas give.
    loss = margin - force_margin(ROBOT, replace(truth, cylinders=rubbing), motion)
    assert 0.04 < loss < 0.15
    weak = replace(truth.supply, pressure_pa=0.5 * truth.supply.pressure_pa)
    assert force_margin(ROBOT, replace(truth, supply=weak), motion) < margin - 0.3


def test_machines_without_margin_are_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    margins = {2000: 0.3, 2001: 0.09, 2002: 0.1, 2003: -0.2, 2004: 0.5}
    monkeypatch.setattr(discovered, "margin_of", lambda _robot, _motion, seed: margins[seed])
    path = load_path("xs031/parallelogram")
    assert isinstance(path, TipPath)
    chosen = list(discovered.machines(ROBOT, path, 2, 3))
    assert chosen == [(2000, 0.3), (2002, 0.1), (2004, 0.5)]


def test_a_run_reads_back_from_its_bag(tmp_path: Path) -> None:
    rig = RigCore(ROBOT, random_truth(ROBOT, 101), seed=1, tip_m=(2.0, 0.0, -1.2))
    run = run_closed_loop(rig, ControllerCore(ROBOT, Gains()), 0.5)
    write_bag(tmp_path / "run", ROBOT, run)
    read = read_recording(tmp_path / "run", ROBOT)
    assert read.period_s == pytest.approx(0.002)
    assert read.p_a is not None
    assert read.supply is not None
    assert read.valve_v is not None
    assert np.array_equal(read.q, run.q_read)
    assert np.abs(read.p_a - run.pressure_read[:, [0, 2]]).max() < 1e-6
    assert np.abs(read.supply - run.pressure_read[:, -2]).max() < 1e-6
    assert np.array_equal(read.valve_v, run.voltage_v)
    # What is recorded is what sensors show, not the truth.
    assert np.abs(run.q_read - run.q).max() > 0.0


def test_the_gains_are_those_of_the_controller_file(tmp_path: Path) -> None:
    gains = Gains(k_p_1_s=13.0, k_x_m=0.001)
    file = tmp_path / "controller.yaml"
    file.write_text(controller_text(tmp_path / "model.yaml", gains))
    assert asdict(discovered.gains_of(file)) == asdict(gains)


def test_ablation_takes_a_name_out_everywhere() -> None:
    both = [EffectSpec("coulomb_friction", f"{j}_cylinder", {"force": 1e3}) for j in "ab"]
    other = EffectSpec("valve_null_bias", "a_valve", {"bias": 0.001})
    robot = replace(ROBOT, effects=(*both, other))
    assert discovered.without(robot, "coulomb_friction").effects == (other,)


def _row(max_error_mm: float, speed_m_s: float = 0.72) -> dict[str, float]:
    return {
        "rmse_mm": 0.4 * max_error_mm,
        "max_error_mm": max_error_mm,
        "max_speed_m_s": speed_m_s,
        "rho_s": 1e-3 * max_error_mm / speed_m_s,
        "reference_speed_m_s": 0.72,
    }


def _plant(identified: float, found: float, **left_out: float) -> dict[str, Any]:
    rows = {"nominal": _row(12.0), "identified": _row(identified), "discovered": _row(found)}
    return {"rows": rows, "without": {n: _row(e) for n, e in left_out.items()}}


def test_the_summary_is_of_pairs_on_the_same_machine() -> None:
    plants = [
        _plant(6.0, 2.0, coulomb_friction=4.0),
        _plant(9.0, 3.0, coulomb_friction=9.0, valve_deadband=3.3),
        _plant(4.0, 4.0, coulomb_friction=4.0),
    ]
    plants[2]["rows"]["discovered"]["max_speed_m_s"] = 0.9
    summary = summary_of(plants)
    assert summary["max_error_ratio"] == {"median": 3.0, "least": 1.0}
    found = summary["rows"]["discovered"]
    assert found["median_rho_s"] == pytest.approx(3e-3 / 0.72)
    assert found["worst_rho_s"] == pytest.approx(4e-3 / 0.72)
    assert found["void"] == 1
    assert summary["ablation"]["coulomb_friction"]["machines"] == 3
    assert summary["ablation"]["coulomb_friction"]["median_max_error_ratio"] == 2.0
    assert summary["ablation"]["valve_deadband"]["median_max_error_mm"] == pytest.approx(0.3)
    text = "\n".join(summary_lines({"summary": summary}))
    assert "| median rho, s | <= 0.0060 (aim 0.0050) | 0.0042 | met |" in text
    assert text.index("| coulomb_friction") < text.index("| valve_deadband")


def test_a_result_of_other_machines_is_not_gone_on_with(tmp_path: Path) -> None:
    file = tmp_path / "out.json"
    file.write_text(json.dumps({"schema": discovered.SCHEMA, "seed": 3, "plants": []}))
    assert discovered._earlier(file, 3) == []
    with pytest.raises(IdentError, match="seed 4"):
        discovered._earlier(file, 4)
