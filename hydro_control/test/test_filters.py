"""The real-time filters against closed forms and scipy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from hydro_control.gains import Gains
from hydro_control.state.axes import axes_of
from hydro_control.state.filters import Ewma, FilteredDifference, alpha_for, time_constant_s
from hydro_control.state.state import StateFilter
from hydro_model.robot_files import load_robot

DT = 0.002


def test_time_constant_of_the_papers_filter_is_49_ms() -> None:
    assert time_constant_s(0.04, DT) == pytest.approx(0.0490, abs=1e-4)
    assert 1.0 / (2.0 * math.pi * time_constant_s(0.04, DT)) == pytest.approx(3.25, abs=0.01)
    assert time_constant_s(1.0, DT) == 0.0
    for alpha in (0.04, 0.3, 0.9):
        assert alpha_for(time_constant_s(alpha, DT), DT) == pytest.approx(alpha)
    assert alpha_for(0.0, DT) == 1.0


@pytest.mark.parametrize("alpha", [0.04, 0.3, 1.0])
def test_average_equals_scipys_filter(alpha: float) -> None:
    z = np.random.default_rng(1).normal(size=(300, 2))
    average = Ewma(alpha)
    found = np.array([average.update(row) for row in z])
    start = (1.0 - alpha) * z[:1]
    expected, _ = lfilter([alpha], [1.0, alpha - 1.0], z, axis=0, zi=start)
    np.testing.assert_allclose(found, expected, atol=1e-13)


def test_average_of_a_step_is_the_closed_form() -> None:
    average = Ewma(0.3)
    average.update(np.zeros(1))
    steps = [float(average.update(np.ones(1))[0]) for _ in range(20)]
    np.testing.assert_allclose(steps, 1.0 - 0.7 ** np.arange(1, 21))


def test_lost_samples_fade_like_held_ones() -> None:
    held, lost = Ewma(0.3), Ewma(0.3)
    held.update(np.array([2.0]))
    lost.update(np.array([2.0]))
    for _ in range(3):
        expected = held.update(np.array([5.0]))
    np.testing.assert_allclose(lost.update(np.array([5.0]), steps=3), expected)


def test_difference_of_a_ramp_is_its_slope() -> None:
    difference = FilteredDifference(0.3, DT)
    found = [float(difference.update(np.array([3.0 * k * DT]))[0]) for k in range(60)]
    assert found[0] == 0.0
    np.testing.assert_allclose(found, 3.0 * (1.0 - 0.7 ** np.arange(60)), atol=1e-9)
    # A gap of two samples on the same ramp changes nothing once settled.
    assert difference.update(np.array([3.0 * 62 * DT]), steps=3)[0] == pytest.approx(3.0, rel=1e-6)


def test_reset_forgets() -> None:
    difference = FilteredDifference(0.3, DT)
    difference.update(np.zeros(1))
    difference.update(np.ones(1))
    difference.reset()
    assert difference.update(np.array([7.0]))[0] == 0.0


@pytest.mark.parametrize("alpha_q", [0.04, 0.3, 1.0])
def test_a_predicted_state_of_a_parabola_is_the_parabola(alpha_q: float) -> None:
    """However late filters make positions and velocities: one acceleration, from its start on."""
    robot = load_robot("xs031")
    gains = replace(Gains(), alpha_q=alpha_q, alpha_qd=0.2, alpha_p=0.5)
    late = StateFilter(axes_of(robot), gains, DT, np.zeros(robot.dof))
    q, qd, qdd = np.array([0.4, -1.0]), np.array([0.1, -0.2]), np.array([0.3, 0.5])
    still, lead_s = np.zeros((2, len(robot.cylinders))), 0.03
    for k in range(2000):
        t = k * DT
        now = late.measured(q + qd * t + 0.5 * qdd * t**2, still, 2e7, 0.0, 1)
    ahead = late.predicted(now, lead_s, qdd, np.zeros(robot.dof))
    t += lead_s
    np.testing.assert_allclose(ahead.q, q + qd * t + 0.5 * qdd * t**2, atol=1e-9)
    np.testing.assert_allclose(ahead.qd, qd + qdd * t, atol=1e-9)
