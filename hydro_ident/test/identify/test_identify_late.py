"""Forces read after the positions: friction is then off, and that is said."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.identify.identification import Identification, identify
from hydro_model.effects.readings import delayed
from hydro_model.hydraulics.cylinder import lever, piston_force
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")

STEP_S = 0.002


@pytest.fixture(scope="module")
def quick(make_run: tuple[Callable[..., Robot], Callable[..., Any]]) -> Any:
    """Quicker than the other runs, where acceleration is a small part of the forces."""
    true_crane, simulated_run = make_run
    return simulated_run(true_crane(), 14.0, pace=1.5)


def _told(found: Identification) -> dict[str, str]:
    """Notes of late forces by the friction that is off."""
    notes = [n for n in found.notes if "as though read" in n]
    names = [p.name for p in found.parameters if p.name.endswith("viscous_friction")]
    return {name: note for name in names for note in notes if f" {name} would" in note}


def _read(note: str) -> tuple[str, float]:
    """Of a note: channels, and how late they are in ms."""
    found = re.match(r"forces of (.+) are as though read (\S+) ms after the positions", note)
    assert found is not None
    return found[1], float(found[2])


@pytest.mark.parametrize("lag_s", [0.0, 1.0e-3])
def test_late_pressures_are_said_where_they_move_friction(quick: Any, lag_s: float) -> None:
    late = [delayed(p, lag_s, STEP_S) for p in (quick.p_a, quick.p_b)]
    found = identify(load_robot("xs031"), [replace(quick, p_a=late[0], p_b=late[1]).recording()])
    rows, told = {p.name: p for p in found.parameters}, _told(found)
    for cylinder in quick.robot.cylinders:
        row = rows[f"{cylinder.name}.viscous_friction"]
        assert row.ci95 is not None
        inside = row.ci95[0] <= cylinder.viscous_friction <= row.ci95[1]
        assert inside or row.name in told
        assert row.model_error or row.name not in told
    assert ("lift_cylinder.viscous_friction" in told) == bool(lag_s)
    for name, note in told.items():
        channels, late_ms = _read(note)
        assert channels == f"{name.split('_')[0]}/force"
        assert late_ms == pytest.approx(1e3 * lag_s, rel=0.02)


def test_late_torques_are_said_where_they_move_friction(quick: Any) -> None:
    torque = np.column_stack(
        [
            lever(c, quick.q[:, i]) * piston_force(c, quick.p_a[:, i], quick.p_b[:, i])
            for i, c in enumerate(quick.robot.cylinders)
        ]
    )
    dry = {"p_a": None, "p_b": None, "effort": delayed(torque, 1.6e-3, STEP_S)}
    found = identify(load_robot("xs031"), [quick.recording(**dry)])
    note = _told(found)["lift_cylinder.viscous_friction"]
    channels, late_ms = _read(note)
    assert channels == "lift/torque, tilt/torque"
    assert late_ms == pytest.approx(1.6, rel=0.02)
    # What it would be without is what it is.
    would = float(note.split(" would be ")[1].split()[0])
    assert would == pytest.approx(quick.robot.cylinders[0].viscous_friction, rel=0.002)
