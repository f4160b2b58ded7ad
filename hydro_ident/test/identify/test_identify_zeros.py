"""Zeros of pressure transducers that are off: intervals of the forces' parameters know of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.estimate.force_rows import force_model, force_rows, pressed_joints
from hydro_ident.estimate.inertial import InertialFit, fit_inertial
from hydro_ident.estimate.moments import Moments
from hydro_ident.estimate.traces import Trace, traces_of
from hydro_ident.estimate.zeros import constant_rows, with_zeros
from hydro_ident.identification import identify
from hydro_ident.transducers import zero_pa
from hydro_model.base_parameters import base_map
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot


@pytest.fixture(scope="module")
def noise(clean: Any) -> FloatArray:
    """Of both pressures of every cylinder, Pa."""
    return np.random.default_rng(3).normal(0.0, 2e3, (2, *clean.p_a.shape))


def _recorded(clean: Any, noise: FloatArray, zeros: FloatArray) -> Any:
    """That run with some noise and zeros of (2, cylinders) Pa."""
    p_a, p_b = (p + n + z for p, n, z in zip((clean.p_a, clean.p_b), noise, zeros, strict=True))
    return clean.recording(p_a=p_a, p_b=p_b)


def _fitted(recorded: Any) -> tuple[InertialFit, Trace]:
    (trace,) = traces_of([recorded])
    fit = fit_inertial(force_model(load_robot("xs031")), [trace])
    assert fit is not None
    return fit, trace


def test_intervals_have_what_zeros_move_the_parameters_by(
    clean: Any, noise: FloatArray, robot: Robot
) -> None:
    """Each zero off by its deviation, one by one, the parameters move by what is stated."""
    fit, trace = _fitted(_recorded(clean, noise, np.zeros((2, 2))))
    rows = force_rows(fit.model, trace, FilterSettings())
    assert rows is not None
    wide = constant_rows(fit.model, rows)
    moments = Moments.like(wide, "run")
    moments.add(wide)
    told = with_zeros(fit, [moments], zero_pa(robot))
    assert np.array_equal(told.fit.theta, fit.fit.theta)
    one_by_one = zero_pa(robot) * np.eye(4).reshape(4, 2, 2)
    others = [_fitted(_recorded(clean, noise, zeros))[0].fit.theta for zeros in one_by_one]
    moved = np.array(others) - fit.fit.theta
    known = np.flatnonzero(fit.identifiable)
    expected = (moved.T @ moved)[np.ix_(known, known)]
    stated = (told.fit.covariance - fit.fit.covariance)[np.ix_(known, known)]
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert stated / size == pytest.approx(expected / size, abs=0.02)
    # Many times what noise alone leaves of the moments that weigh on the cylinders.
    moment = fit.model.names.index("lift_link.mcx")
    assert told.fit.std[moment] > 5.0 * fit.fit.std[moment]
    assert np.all(told.fit.dof >= fit.fit.dof)


def test_measured_torques_have_no_zeros_of_pressures() -> None:
    assert pressed_joints(force_model(load_robot("xs031"))) == [0, 1]
    assert pressed_joints(force_model(load_robot("xs031"), torque=True)) == []


@pytest.mark.needs("clarabel")
def test_usual_zeros_leave_the_truth_in_the_intervals(
    clean: Any, noise: FloatArray, robot: Robot
) -> None:
    truth = base_map(clean.robot).combination @ clean.robot.parameter_vector
    off = zero_pa(robot) * np.array([[1.0, -0.9], [-0.9, 1.0]])
    found = identify(load_robot("xs031"), [_recorded(clean, noise, off)])
    assert found.robot is not None
    assert found.robot.base_covariance is not None
    rows = {p.name: p for p in found.parameters}
    for i, base in enumerate(found.robot.base_parameters):
        row = rows[base.name]
        if row.ci95 is None or not row.identifiable:
            continue
        low, high = row.ci95
        assert low <= truth[i] <= high, base.name
        # One covariance: what is printed is what the model file has.
        assert row.std == pytest.approx(found.robot.base_covariance[i, i] ** 0.5)
