"""Recordings of one machine that no common model fits: none of them decides alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import map_columns
from hydro_ident.estimate.signals.derivatives import FilterSettings, motion
from hydro_ident.identify.identification import Identification, identify
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.needs("clarabel")

LOAD_KG, COULOMB_N, STICTION_N = 100.0, 3000.0, np.array([2500.0, -2500.0])
STEP_S = 0.002


def _pushed(run: Any, force: np.ndarray) -> Recording:
    """The run with other piston forces (N, 2), without valves: flows are of no matter here."""
    areas = np.array([c.area_a_m2 for c in run.robot.cylinders])
    return run.recording(p_a=run.p_a + force / areas, valve_v=None, command_v=None)


def _part(recording: Recording, name: str, begin: int, end: int) -> Recording:
    return replace(map_columns(recording, lambda v: v[begin:end]), path=Path(name))


def _over_levers(torque: np.ndarray, run: Any) -> np.ndarray:
    pairs = enumerate(run.robot.cylinders)
    return np.stack([torque[:, i] / lever(c, run.q[:, i]) for i, c in pairs], axis=1)


def _mass_moment(found: Identification) -> tuple[float, float]:
    row = next(p for p in found.parameters if p.name == "tilt_link.mcx")
    return row.value, row.std


def _true_moment(robot: Robot) -> float:
    base = base_map(robot)
    values: np.ndarray = base.combination @ robot.parameter_vector
    return float(values[base.names.index("tilt_link.mcx")])


@pytest.mark.parametrize("load_kg", [0.0, LOAD_KG])
def test_another_load_in_one_recording_is_a_problem(
    crane_run: Any, make_run: tuple[Callable[..., Robot], Any], load_kg: float
) -> None:
    true_crane, _ = make_run
    moved, half = motion(crane_run.q, STEP_S, FilterSettings()), len(crane_run.q) // 2
    loaded, empty = (inverse_dynamics(true_crane(kg), *moved) for kg in (load_kg, 0.0))
    other = _pushed(crane_run, _over_levers(loaded - empty, crane_run))
    same = _pushed(crane_run, np.zeros_like(crane_run.q))
    bags = [_part(same, "empty", 0, half), _part(other, "loaded", half, 2 * half)]
    found = identify(load_robot("xs031"), bags)
    told = [p for p in found.problems if "different loads" in p]
    value, std = _mass_moment(found)
    low, high = (_true_moment(true_crane(kg)) for kg in (0.0, load_kg))
    if not load_kg:
        assert not told
        assert value == pytest.approx(low, abs=3.0 * std)
        return
    [problem] = told
    assert f"beside empty, loaded +{LOAD_KG:.0f} +- " in problem
    # Neither bag's alone, and the interval knows of both.
    assert low + 0.1 * (high - low) < value < high - 0.1 * (high - low)
    assert abs(value - low) < 3.0 * std
    assert abs(value - high) < 3.0 * std


def test_a_bag_at_rest_does_not_outweigh_one_in_motion(crane_run: Any) -> None:
    """Friction that the file does not list: at rest it is a force like any other."""
    run, count = crane_run, 5000
    _, speed, _ = motion(run.q, STEP_S, FilterSettings(differentiation_hz=10.0))
    arms = np.stack([lever(c, run.q[:, i]) for i, c in enumerate(run.robot.cylinders)], axis=1)
    moving = _pushed(run, COULOMB_N * np.tanh(arms * speed / 0.003))
    here = np.tile([0.9, -0.7], (count, 1))
    rest = replace(run, q=here)
    torque = inverse_dynamics(run.robot, here, np.zeros_like(here), np.zeros_like(here))
    force = _over_levers(torque, rest) + STICTION_N
    ratio = [c.area_b_m2 / c.area_a_m2 for c in run.robot.cylinders]
    areas = [c.area_a_m2 for c in run.robot.cylinders]
    rng, p_b = np.random.default_rng(5), np.full((count, 2), 4.0e6)
    q = here + rng.normal(0.0, 3e-6, here.shape)
    p_a = force / areas + p_b * ratio
    noise = rng.normal(0.0, 4e3, (2, count, 2))
    static = _part(moving, "static", 0, count)
    static = replace(static, q=q, p_a=p_a + noise[0], p_b=p_b + noise[1])
    found = identify(load_robot("xs031"), [moving, static])
    value, std = _mass_moment(found)
    assert value == pytest.approx(_true_moment(run.robot), abs=3.0 * std)
