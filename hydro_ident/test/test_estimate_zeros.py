"""Zeros of pressure transducers that are off, and what the forces' covariance has of them."""

from __future__ import annotations

import numpy as np

from hydro_ident.estimate.forces.force_rows import (
    ForceModel,
    force_model,
    force_rows,
    pressed_joints,
)
from hydro_ident.estimate.forces.inertial import fit_inertial
from hydro_ident.estimate.forces.zeros import constant_rows, with_zeros
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.estimate.statistics.moments import LAGS, Moments
from hydro_ident.estimate.statistics.rows import Rows
from hydro_ident.transducers import zero_pa
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

H, FRICTION, NOISE_N = 0.002, np.array([3.9e4, 7.7e4]), 15.0


def _trace(robot: Robot, zeros: FloatArray) -> Trace:
    """Pressures of a motion along sines with some noise, off by zeros of (2, cylinders) Pa."""
    time = np.arange(0.0, 40.0, H)
    size = np.array([[0.30, 0.06, 0.015], [0.45, 0.08, 0.02]])
    speed = 2.0 * np.pi * np.array([[0.05, 0.13, 0.31], [0.07, 0.17, 0.37]])
    angle = time[:, None, None] * speed + np.array([0.0, 1.0, 2.0])
    q = np.array([0.55, -1.25]) + np.sum(size * np.sin(angle), axis=2)
    qd = np.sum(size * speed * np.cos(angle), axis=2)
    qdd = -np.sum(size * speed**2 * np.sin(angle), axis=2)
    torque, rng = inverse_dynamics(robot, q, qd, qdd), np.random.default_rng(4)
    p_a, p_b, strokes = np.empty_like(q), np.full_like(q, 5e6), np.empty_like(q)
    for i, c in enumerate(robot.cylinders):
        arm = lever(c, q[:, i])
        force = torque[:, i] / arm + FRICTION[i] * arm * qd[:, i]
        force += rng.normal(0.0, NOISE_N, time.size)
        p_a[:, i] = (force + p_b[:, i] * c.area_b_m2) / c.area_a_m2
        strokes[:, i] = stroke(c, q[:, i])
    nothing, rail = np.full_like(q, np.nan), np.full(time.size, 19e6)
    return Trace(
        "run#0", H, time, q, strokes, p_a + zeros[0], p_b + zeros[1], rail, 0.05 * rail,
        nothing, nothing,
    )  # fmt: skip


def _rows(model: ForceModel, trace: Trace) -> Rows:
    """All but the first, which have not all their predecessors and do not count."""
    rows = force_rows(model, trace, FilterSettings())
    assert rows is not None
    return rows.take(np.arange(len(rows.y)) >= LAGS)


def test_intervals_have_what_zeros_move_the_parameters_by(robot: Robot) -> None:
    """Each zero off by its deviation, under weights that stay: through the filters and all."""
    model, trace = force_model(robot, parts=False), _trace(robot, np.zeros((2, 2)))
    fit, rows = fit_inertial(model, [trace]), _rows(model, trace)
    assert fit is not None
    whole = force_rows(model, trace, FilterSettings())
    assert whole is not None
    wide = constant_rows(model, whole)
    moments = Moments.like(wide, "run")
    moments.add(wide)
    told = with_zeros(fit, [moments], zero_pa(robot))
    assert np.array_equal(told.fit.theta, fit.fit.theta)
    weight = 1.0 / np.sqrt(np.mean((rows.y - rows.x @ fit.fit.theta) ** 2, axis=0))
    x = (rows.x * weight[:, None]).reshape(-1, len(model.names))
    moved = []
    for zeros in zero_pa(robot) * np.eye(4).reshape(4, 2, 2):
        off = _rows(model, _trace(robot, zeros)).y - rows.y
        moved.append(np.linalg.lstsq(x, (off * weight).ravel(), rcond=None)[0])
    expected, stated = np.transpose(moved) @ moved, told.fit.covariance - fit.fit.covariance
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        stated / np.outer(size, size), expected / np.outer(size, size), atol=1e-5
    )
    # Many times what noise alone leaves of the moment that weighs on the cylinders.
    moment = model.names.index("lift_link.mcx")
    assert told.fit.std[moment] > 5.0 * fit.fit.std[moment]
    assert np.all(told.fit.dof >= fit.fit.dof)


def test_measured_torques_have_no_zeros_of_pressures() -> None:
    assert pressed_joints(force_model(load_robot("xs031"))) == [0, 1]
    assert pressed_joints(force_model(load_robot("xs031"), torque=True)) == []
