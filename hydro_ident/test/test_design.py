"""Parts of the experiment design against independent computations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.design.fourier import FourierDesign, Spectrum, start_blocks
from hydro_ident.design.information import (
    ForceInformation,
    Residual,
    moments,
    required_forces,
    sandwich,
)
from hydro_ident.design.limits import force_range, middle
from hydro_ident.design.poses import static_poses
from hydro_ident.design.prediction import predict
from hydro_ident.design.pressures import required_hydraulics
from hydro_ident.design.program import Program, sampled
from hydro_ident.errors import IdentError
from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.experiment import LIMITS, design_excitation
from hydro_model.paths_segments import Fourier
from hydro_model.robot import FloatArray, Robot
from hydro_model.simulate import simulate


def _noise(rng: np.random.Generator, count: int, rho: float) -> FloatArray:
    drive = rng.standard_normal((count, 2)) * np.sqrt(1.0 - rho**2)
    drive[0] /= np.sqrt(1.0 - rho**2)
    noise = np.empty_like(drive)
    noise[0] = drive[0]
    for k in range(1, count):
        noise[k] = rho * noise[k - 1] + drive[k]
    return noise


def _sway(robot: Robot, duration_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    block = Fourier(
        middle(robot),
        np.array([[0.15, 0.03, 0.02], [0.05, -0.1, 0.03]]),
        np.array([[0.0, 0.05, -0.02], [0.08, 0.02, 0.0]]),
        0.2,
        1.0,
        duration_s,
    )
    times = np.arange(0.0, duration_s, 0.002)
    q, qd, qdd = (np.array(c) for c in zip(*(block.sample(t) for t in times), strict=True))
    return q, qd, qdd


def test_moments_are_the_double_sum() -> None:
    x = np.random.default_rng(0).standard_normal((40, 2, 3))
    bread, middle_part = moments(x, 0.1, 0.35)
    lag = np.abs(np.subtract.outer(np.arange(40), np.arange(40)))
    weight = np.exp(-0.1 * lag / 0.35)
    expected = np.einsum("tkp,ts,skq->pq", x, weight, x)
    assert middle_part == pytest.approx(expected, rel=1e-10)
    assert bread == pytest.approx(np.einsum("tkp,tkq->pq", x, x), rel=1e-12)


def test_predicted_errors_are_those_of_repeated_fits(robot: Robot) -> None:
    """300 recordings with AR(1) residuals of the stated size, fitted by least squares."""
    residual = Residual()
    information = ForceInformation(robot, residual)
    rows, step = information.filtered(*_sway(robot, 20.0), 0.002, FilterSettings())
    size = rows.shape[2]
    flat = rows.reshape(-1, size)
    expected = np.sqrt(np.diag(sandwich(*moments(rows, step, residual.correlation_s))))
    rng = np.random.default_rng(3)
    rho = np.exp(-step / residual.correlation_s)
    solver = np.linalg.pinv(flat)
    draws = np.array([solver @ _noise(rng, len(rows), rho).ravel() for _ in range(300)])
    assert draws.std(axis=0) == pytest.approx(expected, rel=0.2)


def test_required_pressures_and_signals_reproduce_the_motion(robot: Robot) -> None:
    q, qd, qdd = _sway(robot, 6.0)
    force = required_forces(robot, q, qd, qdd)
    found = required_hydraulics(robot, 0.002, q, qd, force)
    a1, a2 = (
        np.array([getattr(c, k) for c in robot.cylinders]) for k in ("area_a_m2", "area_b_m2")
    )
    assert found.p_a * a1 - found.p_b * a2 == pytest.approx(force, rel=1e-9)
    rated = np.array([valve.rated_voltage_v for valve in robot.valves])
    start = np.column_stack([found.p_a[0], found.p_b[0]])
    times = 0.002 * np.arange(len(q))
    rolled = simulate(robot, times, found.signal * rated, q[0], p0=start)
    # Open loop: what is left is the hold between samples, and it drifts.
    assert np.abs(rolled.q - q).max() < 0.01


def test_the_optimiser_lowers_its_criterion_alike_every_time(robot: Robot) -> None:
    information = ForceInformation(robot, Residual())
    spectrum = Spectrum(2, 3, 0.2, 5.0, 1.0)
    poses = static_poses(information, LIMITS, 2, 0)
    x = information.columns(poses, np.zeros_like(poses), np.zeros_like(poses))
    bread = np.einsum("tkp,tkq->pq", x, x) + np.diag([1e-3] * x.shape[2])
    problem = FourierDesign(information, LIMITS, spectrum, (bread, bread))
    start = start_blocks(robot, spectrum, poses, 0)
    better = problem.improved(start, 8)
    assert problem.value(better) < problem.value(start) - 0.3
    again = problem.improved(start, 8)
    assert np.array_equal(better.sine, again.sine)


def test_a_program_refuses_what_does_not_fit(robot: Robot) -> None:
    program = Program(robot, LIMITS, middle(robot))
    before = program.duration_s
    assert not program.add(
        {"kind": "cruise", "to": [0.9, -1.3], "duration_s": 0.1, "ramp_s": 0.05}
    )
    assert program.duration_s == before
    program.move(np.array([0.9, -1.3]))
    assert program.at == pytest.approx([0.9, -1.3])
    q, _, _ = sampled(program.all_segments())
    assert q[-1] == pytest.approx([0.9, -1.3])
    with pytest.raises(IdentError, match="no motion fits"):
        program.move(np.array([1.9, -1.3]))


def test_force_range_is_what_supply_and_tank_give(robot: Robot) -> None:
    low, high = force_range(robot, robot.cylinders[0])
    a1, a2 = robot.cylinders[0].area_a_m2, robot.cylinders[0].area_b_m2
    assert high == pytest.approx(19e6 * a1 - 1e6 * a2)
    assert low == pytest.approx(1e6 * a1 - 19e6 * a2)


def test_what_the_motion_does_not_reach_is_undetermined(robot: Robot) -> None:
    q, qd, qdd = _sway(robot, 8.0)
    q[:, 1], qd[:, 1], qdd[:, 1] = -1.2, 0.0, 0.0
    told = {p.name: p for p in predict(robot, (q, qd, qdd), Residual(), 0.002).parameters}
    assert np.isinf(told["tilt_cylinder.viscous_friction"].std)
    assert np.isfinite(told["lift_cylinder.viscous_friction"].std)


def test_a_spatial_robot_of_three_joints(robot: Robot, tmp_path: Path) -> None:
    """A slewing column under the crane: another axis, gravity along it, a third cylinder."""
    slew = replace(
        robot.joints[0],
        name="slew",
        parent_link="ground",
        child_link="column",
        translation_m=np.zeros(3),
        rotation=np.eye(3),
        axis=np.array([0.0, 0.0, 1.0]),
        lower=-1.0,
        upper=1.0,
    )
    lift = replace(robot.joints[0], parent_link="column")
    # Pins at right angles in the middle of the range.
    swing = replace(
        robot.cylinders[0], name="slew_cylinder", joint="slew", q0_rad=1.5, l2_m=0.3, x0_m=0.78
    )
    column = np.array([200.0, 10.0, 0.0, 80.0, 60.0, 0.0, -5.0, 60.0, 0.0, 30.0])
    spatial = replace(
        robot,
        name="slewing",
        joints=(slew, lift, *robot.joints[1:]),
        link_inertia=np.vstack([column, robot.link_inertia]),
        cylinders=(swing, *robot.cylinders),
        valves=(
            replace(robot.valves[0], name="slew_valve", cylinder="slew_cylinder"),
            *robot.valves,
        ),
    )
    start = np.array([0.0, 0.8, -1.3])
    design = design_excitation(spatial, start, 30.0, tmp_path)
    assert design.path.duration_s == pytest.approx(30.0, rel=0.2)
    assert np.all(design.check.upper - design.check.lower > 0.2)
    assert all(np.isfinite(p.std) for p in design.prediction.parameters)
