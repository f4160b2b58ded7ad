"""Barrels and rods in a fit: recovered where they matter, held and said where they do not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.estimate.forces.closed_chain import expected_sizes
from hydro_ident.estimate.forces.inertial import InertialFit, fit_inertial, force_model
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.identify.identified_robot import identified_robot
from hydro_ident.identify.model_file import write_model
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.multibody.base_parameters import base_map
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import CylinderPart, FloatArray, Robot
from hydro_model.robot_files import load_robot

H = 0.002
FRICTION = (3.2e4, 4.1e4)
#: White noise on the pistons' forces, N: what is left of pressure noise.
NOISE_N = 20.0


def heavier(robot: Robot, factor: float, further: float = 1.0) -> Robot:
    def part(given: CylinderPart | None) -> CylinderPart:
        assert given is not None
        mass, inertia = factor * given.mass_kg, factor * given.inertia_com_kg_m2
        return CylinderPart(mass, further * given.com_from_pin_m, inertia)

    parts = [replace(c, barrel=part(c.barrel), rod=part(c.rod)) for c in robot.cylinders]
    return replace(robot, cylinders=tuple(parts))


def fitted(
    truth: Robot, given: Robot, *, fast: bool = False, missing_n: float = 0.0
) -> InertialFit:
    """Fit to positions and forces of a motion; `missing_n` is Coulomb friction left out of it."""
    time = np.arange(0.0, 60.0, H)
    quick, small = ((0.9, 1.1), (0.02, 0.03)) if fast else ((0.31, 0.37), (0.015, 0.02))
    size = np.array([[0.30, 0.06, small[0]], [0.45, 0.08, small[1]]])
    speed = 2.0 * np.pi * np.array([[0.05, 0.13, quick[0]], [0.07, 0.17, quick[1]]])
    angle = time[:, None, None] * speed + np.array([0.0, 1.0, 2.0])
    q = np.array([0.55, -1.25]) + np.sum(size * np.sin(angle), axis=2)
    qd = np.sum(size * speed * np.cos(angle), axis=2)
    qdd = -np.sum(size * speed**2 * np.sin(angle), axis=2)
    trace = _trace(truth, time, (q, qd, qdd), missing_n)
    found = fit_inertial(force_model(given), [trace])
    assert found is not None
    return found


def _trace(truth: Robot, time: FloatArray, moved: Sequence[FloatArray], missing_n: float) -> Trace:
    q, qd, _ = moved
    rng = np.random.default_rng(4)
    torque = inverse_dynamics(truth, *moved)
    p_a, p_b = np.empty_like(q), np.full_like(q, 5e6)
    strokes = np.empty_like(q)
    for i, c in enumerate(truth.cylinders):
        arm = lever(c, q[:, i])
        rub = FRICTION[i] * arm * qd[:, i] + missing_n * np.sign(qd[:, i])
        force = torque[:, i] / arm + rub + rng.normal(0.0, NOISE_N, time.size)
        p_a[:, i] = (force + p_b[:, i] * c.area_b_m2) / c.area_a_m2
        strokes[:, i] = stroke(c, q[:, i])
    nothing, rail = np.full_like(q, np.nan), np.full(time.size, 19e6)
    return Trace("run#0", H, time, q, strokes, p_a, p_b, rail, 0.05 * rail, nothing, nothing)


@pytest.mark.parametrize(
    "known", [True, False], ids=["about right in the file", "too light there"]
)
def test_parts_that_matter_are_recovered(known: bool) -> None:
    """Ten times the mass; the file says a seventh less, or knows nothing of it."""
    truth = heavier(load_robot("xs031"), 10.0, 1.1)
    given = heavier(load_robot("xs031"), 8.5 if known else 1.0)
    found = fitted(truth, given, fast=True)
    base = base_map(truth)
    wanted = base.combination @ truth.parameter_vector
    names = list(base.names)
    for name in ("barrel.mcx", "barrel.izz", "rod.mcx"):
        i = names.index(f"tilt_cylinder_{name}")
        assert found.identifiable[i], name
        assert found.fit.theta[i] == pytest.approx(wanted[i], rel=0.1 if known else 0.15), name
    # The lift cylinder hardly turns: little shows its parts, and it is said.
    held = {names[part.index] for part in found.held}
    assert "lift_cylinder_barrel.izz" in held
    assert all(name.startswith("lift_cylinder") for name in held)
    assert not found.missing


def test_parts_of_the_crane_are_below_detection() -> None:
    robot = load_robot("xs031")
    found = fitted(robot, robot)
    names = found.model.base.names
    assert [names[part.index] for part in found.held] == list(names[6:])
    assert all("below detection" in part.reason for part in found.held)
    assert all(found.identifiable[:6])
    assert not found.missing
    wanted = found.model.base.combination @ robot.parameter_vector
    assert np.array_equal(found.fit.theta[6:12], wanted[6:])
    assert np.allclose(found.fit.theta[:6], wanted[:6], rtol=2e-3, atol=0.5)


def test_what_the_model_lacks_does_not_pass_for_parts() -> None:
    robot = heavier(load_robot("xs031"), 3.0)
    found = fitted(robot, robot, missing_n=2000.0)
    assert len(found.held) == 6


def test_an_identified_robot_counts_its_parts_once(tmp_path: Path) -> None:
    """Held values are carried as base parameters; masses are in the links' already."""
    robot = load_robot("xs031")
    identified = identified_robot(robot, fitted(robot, robot), None)
    names = list(robot.part_names)
    carried = dict(zip(names, identified.part_parameters.ravel(), strict=True))
    assert carried["tilt_cylinder_rod.mass"] == 0.0
    assert carried["tilt_cylinder_rod.izz"] == 0.0
    both = [carried[f"tilt_cylinder_barrel.{p}"] for p in ("mcx", "izz")]
    assert both == pytest.approx([6.09, 3.0315 + 1.86175])
    assert identified.cylinders[1].rod == robot.cylinders[1].rod
    q, qd, qdd = np.random.default_rng(2).uniform(-0.5, 0.5, size=(3, 20, 2))
    q = q + np.array([0.5, -1.3])
    torque = inverse_dynamics(robot, q, qd, qdd)
    assert np.allclose(inverse_dynamics(identified, q, qd, qdd), torque, rtol=0, atol=20.0)
    write_model(identified, tmp_path / "model.yaml")
    read = load_robot(tmp_path / "model.yaml")
    assert np.array_equal(
        inverse_dynamics(read, q, qd, qdd), inverse_dynamics(identified, q, qd, qdd)
    )


def test_without_parts_in_the_file_steel_says_what_to_expect() -> None:
    robot = load_robot("xs031")
    bare = replace(
        robot, cylinders=tuple(replace(c, barrel=None, rod=None) for c in robot.cylinders)
    )
    base = base_map(robot)
    ratio = expected_sizes(bare, base)[6:] / expected_sizes(robot, base)[6:]
    assert np.all((ratio > 0.3) & (ratio < 3.0))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_part_that_is_said_to_be_nothing_is_held_without_a_warning() -> None:
    """A double rod's ring has no rod of its own: a size of 0, of which nothing is a share."""
    robot = load_robot("xs031")
    ring = [replace(c, rod_m=0.0, barrel=None, rod=None) for c in robot.cylinders]
    found = fitted(robot, replace(robot, cylinders=tuple(ring)))
    names = found.model.base.names
    held = {names[part.index] for part in found.held}
    assert {name for name in names[6:] if "_rod." in name} <= held
