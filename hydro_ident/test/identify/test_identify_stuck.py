"""A transducer that stands still within its scale while its joint moves, and a parked joint."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import traces_of
from hydro_ident.identify.identification import Identification, identify
from hydro_ident.identify.survey import Survey, stuck_notes
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import simulate

pytestmark = pytest.mark.needs("clarabel")


def test_a_transducer_that_stands_still_is_said(clean: Any, found: Identification) -> None:
    """It may measure so, vented: its equations stay, and a note has the likely cause."""
    still = np.where([True, False], 5.0e6, clean.p_b)
    stuck = identify(load_robot("xs031"), [clean.recording(p_b=still)])
    [note] = [n for n in stuck.notes if "throughout, though" in n]
    assert "lift_cylinder/b read 50 bar (gauge) throughout, though lift moved" in note
    assert "lift/force and lift/flow_b" in note
    assert not [n for n in found.notes if "throughout, though" in n]


def _said(run: Any, **channels: Any) -> list[str]:
    recording = run.recording(**channels)
    signals = SignalSurvey.of(load_robot("xs031"), traces_of([recording]))
    return stuck_notes([Survey("bag", recording, 18.0, signals)])


def test_a_pressure_that_was_read_at_rest_alone_is_not_called_stuck(clean: Any) -> None:
    p_b = clean.p_b.copy()
    p_b[:20, 0], p_b[20:, 0] = 5.0e6, np.nan
    assert _said(clean, p_b=p_b) == []


def test_a_stuck_transducer_is_said_beside_a_joint_without_angles(clean: Any) -> None:
    q, p_b = np.where([False, True], np.nan, clean.q), np.where([True, False], 5.0e6, clean.p_b)
    (note,) = _said(clean, p_b=p_b, q=q)
    assert note.startswith(
        "bag: lift_cylinder/b read 50 bar (gauge) throughout, though lift moved"
    )


def test_a_joint_that_swings_on_the_oil_behind_its_closed_valve_did_not_move(clean: Any) -> None:
    """What it tells of the other one is right, and its own force is not said to be too short."""
    voltage = clean.voltage * [1.0, 0.0]
    out = simulate(clean.robot, 0.002 * np.arange(len(voltage)), voltage, clean.q[0])
    run = replace(clean, q=out.q, p_a=out.p_a, p_b=out.p_b, voltage=voltage)
    found = identify(load_robot("xs031"), [run.recording()])
    assert found.verdict == "not_enough_data"
    assert "tilt_cylinder.viscous_friction: tilt did not move" in found.problems[0]
    assert not [n for n in found.notes if "nothing of it is fitted" in n]
    values = {p.name: p.value for p in found.parameters}
    true = clean.robot.cylinders[0].viscous_friction
    assert values["lift_cylinder.viscous_friction"] == pytest.approx(true, rel=2e-3)
