"""Forces read after the positions: friction is then off, and that is said."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.identification import Identification, identify
from hydro_model.effects.readings import delayed
from hydro_model.hydraulics.cylinder import lever, piston_force
from hydro_model.multibody.rigid_body import inverse_dynamics
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


def _swinging(time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A motion of both joints with its derivatives, (N, 2) each."""
    q, qd, qdd = np.tile([0.55, -1.2], (time_s.size, 1)), 0.0, 0.0
    for size, hz, phase in (
        (0.25, (0.13, 0.17), (0, 1)),
        (0.1, (0.31, 0.43), (2, 0.5)),
        (0.03, (0.9, 0.7), (1, 3)),
    ):
        turn = 2.0 * np.pi * np.array(hz)
        angle = turn * time_s[:, None] + np.array(phase)
        q = q + size * np.sin(angle)
        qd = qd + size * turn * np.cos(angle)
        qdd = qdd - size * turn**2 * np.sin(angle)
    return q, np.asarray(qd), np.asarray(qdd)


def _without_friction(run: Any, step_s: float, lag_s: float) -> Recording:
    """Torques of a simulated crane whose joints have none, that of a time read `lag_s` later."""
    time_s = np.arange(0.0, 40.0, step_s)
    one, count = np.zeros(time_s.size, dtype=bool), time_s.size
    q = _swinging(time_s)[0]
    effort = inverse_dynamics(run.robot, *_swinging(time_s - lag_s))
    gone = ("p_a", "p_b", "supply", "tank", "valve_v", "command_v")
    stamps = np.round(1e9 * step_s * np.arange(count)).astype(np.int64)
    changes = {"stamp_ns": stamps, "period_s": step_s, "q": q, "effort": effort, "latched": one}
    return run.recording(**changes, **dict.fromkeys(gone))


@pytest.mark.parametrize("lag_s", [-5.0e-3, 5.0e-3])
def test_a_friction_that_early_torques_bring_below_zero_is_held_there(
    crane_run: Any, lag_s: float
) -> None:
    """A command that is held over the cycle that follows is half a cycle early."""
    found = identify(load_robot("xs031"), [_without_friction(crane_run, 0.01, lag_s)])
    assert not [p for p in found.problems if "forces rejected" in p]
    assert found.inertial is not None
    base = found.inertial.model.base
    true = dict(zip(base.names, base.combination @ crane_run.robot.parameter_vector, strict=True))
    rows = {p.name: p for p in found.parameters}
    for name in ("lift_link.mcx", "lift_link.iyy", "tilt_link.mcx", "tilt_link.iyy"):
        assert rows[name].identifiable
        assert rows[name].value == pytest.approx(true[name], rel=0.005)
    when = "before" if lag_s < 0.0 else "after"
    for cylinder in found.given.cylinders:
        friction = rows[f"{cylinder.name}.viscous_friction"]
        assert friction.model_error
        assert (friction.value == 0.0) == (lag_s < 0.0)
        [note] = [n for n in found.notes if "as though read" in n and f" {friction.name} " in n]
        assert f"as though read 5 ms {when} the positions" in note
        # What it would be without is what it is: none, where the fit gives hundreds.
        assert float(note.split(" would be ")[1].split()[0]) == pytest.approx(0.0, abs=3.0)
    held = [n for n in found.notes if "held at 0: the fit gives -" in n]
    assert len(held) == (2 if lag_s < 0.0 else 0)
