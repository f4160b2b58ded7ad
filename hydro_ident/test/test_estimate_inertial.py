"""The force regression: exact in algebra, and honest about motion that does not excite.

The recordings here are made with hydro_model's own equations: they test the estimators'
algebra, not the physics, which has oracles of its own in hydro_model's tests.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.estimate.forces.inertial import (
    Motion,
    fit_inertial,
    force_columns,
    force_model,
    measured_force,
)
from hydro_ident.estimate.forces.standstill import held_still, rests_of, still_joints
from hydro_ident.estimate.signals.derivatives import FilterSettings, kept_samples
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.least_squares import Rows, weighted_least_squares
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import Robot

H = 0.002
FRICTION = np.array([3.9e4, 7.7e4])


def _motion(time: np.ndarray, moving: tuple[float, float] = (1.0, 1.0)) -> Motion:
    """Two harmonics per joint with their exact derivatives."""
    q = np.array([0.8, -1.2]) * np.ones((time.size, 2))
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    for joint, terms in enumerate((((0.3, 0.9), (0.05, 3.1)), ((0.4, 1.3), (0.06, 4.2)))):
        for size, w in terms:
            a = size * moving[joint]
            q[:, joint] += a * np.sin(w * time)
            qd[:, joint] += a * w * np.cos(w * time)
            qdd[:, joint] -= a * w * w * np.sin(w * time)
    return Motion(q, qd, qdd)


def _trace(robot: Robot, moved: Motion, time: np.ndarray) -> Trace:
    """Pressures that give exactly the forces of the motion with viscous friction."""
    torque = inverse_dynamics(robot, moved.q, moved.qd, moved.qdd)
    count, cylinders = moved.q.shape[0], len(robot.cylinders)
    p_a, p_b = np.zeros((count, cylinders)), np.full((count, cylinders), 2.0e6)
    strokes = np.zeros((count, cylinders))
    for i, cylinder in enumerate(robot.cylinders):
        arm = lever(cylinder, moved.q[:, i])
        force = torque[:, i] / arm + FRICTION[i] * arm * moved.qd[:, i]
        p_a[:, i] = (force + p_b[:, i] * cylinder.area_b_m2) / cylinder.area_a_m2
        strokes[:, i] = stroke(cylinder, moved.q[:, i])
    nothing, rail = np.full((count, cylinders), np.nan), np.full(count, 19e6)
    return Trace(
        "exact#0", H, time, moved.q, strokes, p_a, p_b, rail, 0.05 * rail, nothing, nothing
    )


def _truth(robot: Robot) -> np.ndarray:
    base = force_model(robot).base
    return np.concatenate([base.combination @ robot.parameter_vector, FRICTION])


def test_exact_derivatives_give_the_parameters_to_1e6(robot: Robot) -> None:
    time = np.arange(0.0, 20.0, 0.02)
    moved = _motion(time)
    model, trace = force_model(robot), _trace(robot, moved, time)
    rows = Rows(measured_force(model, trace), force_columns(model, trace, moved), time)
    assert np.allclose(weighted_least_squares([rows]).theta, _truth(robot), rtol=1e-6)


def test_names_follow_the_contract(robot: Robot) -> None:
    model = force_model(robot)
    assert model.channels == ("lift/force", "tilt/force")
    assert model.names == (
        *("lift_link.mcx", "lift_link.mcz", "lift_link.iyy"),
        *("tilt_link.mcx", "tilt_link.mcz", "tilt_link.iyy"),
        *("lift_cylinder_barrel.mcx", "lift_cylinder_barrel.izz", "lift_cylinder_rod.mcx"),
        *("tilt_cylinder_barrel.mcx", "tilt_cylinder_barrel.izz", "tilt_cylinder_rod.mcx"),
        *("lift_cylinder.viscous_friction", "tilt_cylinder.viscous_friction"),
    )


def test_sampled_positions_give_the_parameters_to_1e3(robot: Robot) -> None:
    time = np.arange(0.0, 24.0, H)
    fit = fit_inertial(force_model(robot), [_trace(robot, _motion(time), time)])
    assert fit is not None
    assert not fit.missing
    assert np.allclose(fit.fit.theta, _truth(robot), rtol=1e-3, atol=0.01)


@pytest.mark.parametrize(
    ("moving", "still", "lost", "kept"),
    [
        ((1.0, 0.0), (1,), "tilt_cylinder.viscous_friction", "lift_cylinder.viscous_friction"),
        ((0.0, 1.0), (0,), "lift_cylinder.viscous_friction", "tilt_cylinder.viscous_friction"),
    ],
)
def test_a_stuck_joint_names_the_parameters_it_hides(
    robot: Robot, moving: tuple[float, float], still: tuple[int, ...], lost: str, kept: str
) -> None:
    time = np.arange(0.0, 24.0, H)
    moved = _motion(time, moving)
    noise = np.random.default_rng(0).normal(0.0, 3e-6, moved.q.shape)
    trace = _trace(robot, moved, time)
    fit = fit_inertial(force_model(robot), [replace(trace, q=trace.q + noise)])
    assert fit is not None
    assert fit.still == still
    assert lost in fit.missing
    assert kept not in fit.missing


@pytest.mark.parametrize(
    ("bits", "travel", "still"),
    [(12, 0.28, False), (12, 0.04, True), (20, 0.011, False), (6, 0.2, True)],
)
def test_a_joint_that_a_coarse_encoder_sees_swing_moves(
    robot: Robot, bits: int, travel: float, still: bool
) -> None:
    coarse = replace(robot, sensors=replace(robot.sensors, encoder_counts_per_rev=1 << bits))
    time = np.arange(0.0, 8.0, H)
    trace = _trace(robot, _motion(time), time)
    count = 2.0 * np.pi / (1 << bits)
    swing = -1.2 + 0.5 * travel * np.sin(time)
    q = np.column_stack([trace.q[:, 0], swing if bits == 20 else count * np.round(swing / count)])
    seen = SignalSurvey.of(coarse, [replace(trace, q=q)])
    assert (1 in still_joints(coarse, seen)) == still


@pytest.mark.parametrize("bits", [15, 20])
@pytest.mark.parametrize("swings", [0.0, 0.25, 8.0])
@pytest.mark.parametrize("drift", [0.0, 5e-3])
def test_what_shows_its_encoders_noise_alone_is_held(
    robot: Robot, bits: int, swings: float, drift: float
) -> None:
    """By counts, coarse or fine, if it creeps or not; what swings is used as it was read."""
    count, time = 2.0 * np.pi / (1 << bits), np.arange(0.0, 24.0, H)
    trace = _trace(robot, _motion(time, (1.0, 0.0)), time)
    noise = np.random.default_rng(2).normal(0.0, 0.5, trace.q.shape)
    swing = count * swings * np.sin(2.0 * np.pi * 5.0 * time) + drift * time / time[-1]
    at = trace.q + swing[:, None] * [0.0, 1.0]
    read = replace(trace, q=count * np.round(at / count + noise))
    seen = SignalSurvey.of(robot, [read])
    assert still_joints(robot, seen) == (1,)
    q = held_still(read.q, rests_of(seen, (1,)))
    assert np.array_equal(q[:, 0], read.q[:, 0])
    if swings > 1.0:
        assert np.array_equal(q, read.q)
    else:
        assert np.all(q[:, 1] == read.q[:, 1].mean())


def test_a_parked_joint_that_swings_on_its_oil_spoils_no_other(robot: Robot) -> None:
    """By a milliradian: inertia is felt as it is, and its own friction stays hidden."""
    time = np.arange(0.0, 24.0, H)
    moved, w = _motion(time, (1.0, 0.0)), 2.0 * np.pi * 5.0
    moved.q[:, 1] += 1.0e-3 * np.sin(w * time)
    moved.qd[:, 1] += 1.0e-3 * w * np.cos(w * time)
    moved.qdd[:, 1] -= 1.0e-3 * w * w * np.sin(w * time)
    trace = _trace(robot, moved, time)
    noise = np.random.default_rng(0).normal(0.0, 3e-6, moved.q.shape)
    fit = fit_inertial(force_model(robot), [replace(trace, q=trace.q + noise)])
    assert fit is not None
    assert fit.still == (1,)
    assert "tilt_cylinder.viscous_friction" in fit.missing
    at = fit.model.names.index("lift_cylinder.viscous_friction")
    assert fit.fit.theta[at] == pytest.approx(FRICTION[0], rel=1e-3)
    # Without the swing's inertia, kilonewtons were left.
    assert fit.fit.channel_std[0] < 30.0


def test_noise_of_a_joint_that_creeps_does_not_pass_for_motion(robot: Robot) -> None:
    """Its drift is none that inertia would tell of."""
    time = np.arange(0.0, 24.0, H)
    moved = _motion(time, (1.0, 0.0))
    moved.q[:, 1] += 3.0e-3 * time / time[-1]
    noise = np.random.default_rng(0).normal(0.0, 3e-6, moved.q.shape)
    trace = _trace(robot, moved, time)
    fit = fit_inertial(force_model(robot), [replace(trace, q=trace.q + noise)])
    assert fit is not None
    assert fit.still == (1,)
    for at, name in enumerate(fit.model.names):
        if name.endswith("iyy"):
            off = abs(fit.fit.theta[at] - _truth(robot)[at])
            assert not fit.identifiable[at] or off < 0.05 * _truth(robot)[at], name


def test_where_nothing_moves_everything_is_held(robot: Robot) -> None:
    """Nothing tells a machine that only sways from one that stands."""
    time = np.arange(0.0, 24.0, H)
    moved = _motion(time, (0.0, 0.0))
    moved.q[:] += 1.0e-3 * np.sin(2.0 * np.pi * 5.0 * time)[:, None]
    fit = fit_inertial(force_model(robot), [_trace(robot, moved, time)])
    assert fit is not None
    assert fit.still == (0, 1)
    held = {fit.model.names[part.index] for part in fit.held}
    assert set(fit.model.names) == {*fit.missing, *held}


def test_no_motion_at_all_leaves_every_friction_and_inertia_unknown(robot: Robot) -> None:
    time = np.arange(0.0, 24.0, H)
    fit = fit_inertial(force_model(robot), [_trace(robot, _motion(time, (0.0, 0.0)), time)])
    assert fit is not None
    assert fit.still == (0, 1)
    held = {fit.model.names[part.index] for part in fit.held}
    assert set(fit.model.names) == {*fit.missing, *held}
    assert held == set(fit.model.base.names[6:])


def test_one_lost_chamber_leaves_the_other_joints_force(robot: Robot) -> None:
    time = np.arange(0.0, 24.0, H)
    trace = _trace(robot, _motion(time), time)
    trace.p_b[:, 1] = np.nan
    fit = fit_inertial(force_model(robot), [trace])
    assert fit is not None
    assert "tilt_cylinder.viscous_friction" in fit.missing
    assert fit.fit.rows == kept_samples(time.size, H, FilterSettings()).size


def test_measured_joint_torques_need_no_cylinder(robot: Robot) -> None:
    time = np.arange(0.0, 24.0, H)
    moved = _motion(time)
    trace = _trace(robot, moved, time)
    arm = np.stack([lever(c, moved.q[:, i]) for i, c in enumerate(robot.cylinders)], axis=1)
    torque = inverse_dynamics(robot, moved.q, moved.qd, moved.qdd)
    torque += FRICTION * arm**2 * moved.qd
    nothing = np.full_like(torque, np.nan)
    dry = replace(trace, p_a=nothing, p_b=nothing, joint_torque=torque)
    model = force_model(robot, torque=True)
    fit = fit_inertial(model, [dry])
    assert fit is not None
    assert model.channels == ("lift/torque", "tilt/torque")
    assert np.allclose(fit.fit.theta, _truth(robot), rtol=1e-3, atol=0.01)


def test_a_trace_shorter_than_the_filters_edges_gives_nothing(robot: Robot) -> None:
    time = np.arange(0.0, 0.5, H)
    fit = fit_inertial(force_model(robot), [_trace(robot, _motion(time), time)], FilterSettings())
    assert fit is None
