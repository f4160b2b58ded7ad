"""Parts of the experiment design against independent computations."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.design.experiment import LIMITS, design_excitation
from hydro_ident.design.fourier import FourierDesign, Spectrum, start_blocks
from hydro_ident.design.information import (
    ForceInformation,
    Residual,
    bare_trace,
    moments,
    required_forces,
    sandwich,
)
from hydro_ident.design.limits import force_range
from hydro_ident.design.poses import static_poses
from hydro_ident.design.prediction import cavitating, expected_trace, predict, predicted_json
from hydro_ident.design.pressures import _Chambers, required_hydraulics
from hydro_ident.design.program import Program, sampled
from hydro_ident.errors import IdentError
from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.flows.chambers import WindowSettings, chamber_rows, chambers_of
from hydro_ident.estimate.flows.hydraulics import fit_hydraulics
from hydro_ident.estimate.forces.inertial import fit_inertial, force_model, force_rows
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.parameters.parameters import parameter_list
from hydro_model.motion.paths_segments import Fourier
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import simulate


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
    motion = _sway(robot, 20.0)
    trace = bare_trace(robot, motion[0], 0.002)
    rows, step = information.filtered(*motion, trace, FilterSettings())
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


@pytest.mark.parametrize(("rod_share", "cavitates"), [(0.8666, True), (0.5, False)])
def test_a_chamber_that_is_emptied_faster_than_it_is_filled_is_told(
    robot: Robot, rod_share: float, cavitates: bool
) -> None:
    """Extending at 0.1 m/s, the load pulling with 10 kN; area ratios of 4:1 and 4:3."""
    lift, valve = robot.cylinders[0], robot.valves[0]
    chambers = _Chambers(robot, replace(lift, rod_m=rod_share * lift.bore_m), valve, 0.002)
    x = 0.1 + 0.1 * 0.002 * np.arange(1500)
    count = len(x)
    rows = chambers.run(x.tolist(), [0.1] * count, [-1e4] * count, [0.0] * count)
    assert rows[:, :2].min() >= robot.tank_pressure_pa
    assert (rows[:, 3].min() < -robot.atmospheric_pressure_pa) == cavitates
    if cavitates:
        # Where both edges' flows are the piston's: (ps - pa) a2^2 = (pb - pt) a1^2.
        ratio = chambers.a1 / chambers.a2
        p_s, p_t = robot.supply_pressure_pa, robot.tank_pressure_pa
        settled = (p_s + ratio**2 * (p_t - 1e4 / chambers.a2)) / (1.0 + ratio**3)
        assert rows[-1, 3] == pytest.approx(settled, rel=0.02)


def test_the_shipped_cranes_run_does_not_cavitate(robot: Robot) -> None:
    prediction = predict(robot, _sway(robot, 6.0), Residual(), 0.002)
    assert cavitating(robot, prediction) == ()
    np.testing.assert_array_less(-robot.atmospheric_pressure_pa, prediction.pressure_unheld_pa)
    starved = replace(prediction, pressure_unheld_pa=np.array([-1.4e6, 1e6]))
    assert cavitating(robot, starved) == ("lift_cylinder",)
    told = json.loads(predicted_json(robot, starved, Residual(), 6.0))["cylinders"]
    assert [one["cavitates"] for one in told] == [True, False]
    assert told[0]["pressure_unheld_pa"] == -1.4e6


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


@pytest.fixture
def listing(robot: Robot) -> Robot:
    """The crane with effects of every kind that is fitted."""
    listed = (
        EffectSpec("coulomb_friction", "xs031", {"force": 2500.0}),
        EffectSpec("pressure_dependent_friction", "tilt_cylinder", {"coefficient": 1e-4}),
        EffectSpec("internal_leakage", "xs031", {"coefficient": 5e-13}),
        EffectSpec("valve_null_bias", "lift_valve", {"bias": 0.01}),
        EffectSpec("dead_volume", "lift_cylinder", {"volume_a": 1e-3, "volume_b": 1e-3}),
    )
    return replace(robot, effects=listed)


def _known(row: Any) -> tuple[str, str, float | None]:
    return row.name, row.unit, row.datasheet


@pytest.mark.thorough
def test_listed_effects_are_predicted_by_the_names_of_identify(listing: Robot) -> None:
    motion, effects = _sway(listing, 12.0), ListedEffects.of(listing)
    _, trace = expected_trace(effects, motion, 0.002)
    model = force_model(listing, False, effects.force_names, effects.force_columns)
    inertial = fit_inertial(model, [trace])
    hydraulic = fit_hydraulics(listing, [trace], extra=effects.chamber_columns)
    rows = parameter_list(listing, inertial, hydraulic, effects.biases)
    parts = set(model.base.names[model.base.link_count :])
    found = [_known(row) for row in rows if row.name not in {*parts, "command_delay"}]
    told = predict(listing, motion, Residual(), 0.002).parameters
    assert sorted(_known(p) for p in told) == sorted(found)
    assert len(told) == 18 + 8
    assert all(np.isfinite(p.std) and p.std > 0.0 for p in told)


def test_effects_of_a_joint_without_cylinder_are_predicted_as_its_fit_finds_them() -> None:
    emps = load_robot("emps")
    times = np.arange(0.0, 20.0, 0.001)[:, None]
    rate = 2.0 * np.pi * np.array([0.3, 0.7])
    phase = times * rate
    q = 0.12 + 0.03 * np.sin(phase).sum(axis=1, keepdims=True)
    qd = 0.03 * (rate * np.cos(phase)).sum(axis=1, keepdims=True)
    qdd = -0.03 * (rate**2 * np.sin(phase)).sum(axis=1, keepdims=True)
    effects, residual = ListedEffects.of(emps), Residual()
    _, trace = expected_trace(effects, (q, qd, qdd), 0.001)
    model = force_model(emps, True, effects.force_names, effects.force_columns)
    # As recorded: the friction's columns come from positions, the torque is the model's own.
    rows = force_rows(model, replace(trace, joint_torque=qdd), FilterSettings())
    assert rows is not None
    scaled = rows.x / ForceInformation(emps, residual).channel_std[:, None]
    step = float(rows.time_s[1] - rows.time_s[0])
    errors = np.sqrt(np.diag(sandwich(*moments(scaled, step, residual.correlation_s))))
    told = predict(emps, (q, qd, qdd), residual, 0.001).parameters
    assert tuple(p.name for p in told) == model.names
    assert [p.std for p in told] == pytest.approx(errors, rel=0.1)
    assert told[1].datasheet == emps.joints[0].viscous_friction
    assert told[2].datasheet == 20.0


@pytest.mark.thorough
def test_expected_errors_of_leakage_are_those_of_repeated_fits(listing: Robot) -> None:
    """400 recordings of both chambers, fitted apart and combined by their information."""
    motion, residual, windows = _sway(listing, 20.0), Residual(), WindowSettings()
    effects = ListedEffects.of(listing)
    _, trace = expected_trace(effects, motion, 0.002)
    rng, thetas, information = np.random.default_rng(5), [], []
    for chamber in chambers_of(listing)[2:]:
        extra = effects.chamber_columns(chamber, trace)[1]
        x = chamber_rows(chamber, trace, listing.command_delay_s, windows, extra).x[:, 0]
        valve, size = chamber.valve, np.linalg.norm(x, axis=0)
        level = residual.flow_share * valve.c_pa * np.sqrt(0.5 * listing.supply_pressure_pa)
        rho = np.exp(-windows.hop_s / residual.correlation_s)
        solver = level * np.linalg.pinv(x / size)
        draws = np.array([solver @ _noise(rng, len(x), rho)[:, 0] for _ in range(400)])
        thetas.append(draws[:, 3] / size[3])
        information.append(1.0 / np.var(thetas[-1]))
    both = np.average(thetas, axis=0, weights=information)
    told = {p.name: p.std for p in predict(listing, motion, residual, 0.002).parameters}
    # The modulus, which the chambers share too, tells a little about the leakage.
    expected = told["tilt_cylinder.internal_leakage.coefficient"]
    assert expected == pytest.approx(both.std(), rel=0.25)


def test_friction_of_unknown_pressures_is_undetermined(listing: Robot) -> None:
    starved = replace(listing, supply_pressure_pa=0.0, valves=())
    starved = replace(starved, effects=listing.effects[:2])
    told = {p.name: p for p in predict(starved, _sway(listing, 8.0), Residual(), 0.002).parameters}
    assert np.isinf(told["tilt_cylinder.pressure_dependent_friction.coefficient"].std)
    assert np.isfinite(told["tilt_cylinder.coulomb_friction.force"].std)


@pytest.mark.thorough
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
