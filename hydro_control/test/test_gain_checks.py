"""Gains that cannot be meant for a machine are said before it moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.gain_checks import count_shares, gain_warnings
from hydro_control.gains import Gains
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")


def with_sensors(**changes: float) -> Robot:
    return replace(ROBOT, sensors=replace(ROBOT.sensors, **changes))


def test_the_shipped_gains_are_for_the_shipped_robot() -> None:
    assert gain_warnings(ROBOT, Gains()) == []


def test_what_a_count_asks_grows_with_it_and_with_the_rate() -> None:
    """The largest part is a rate of a rate: of the required force over the velocity."""
    fine = count_shares(ROBOT, Gains())
    coarse = count_shares(with_sensors(encoder_counts_per_rev=2**14), Gains())
    ratio = ROBOT.sensors.encoder_counts_per_rev / 2**14
    np.testing.assert_allclose(coarse, ratio * fine, rtol=1e-3)
    quick = count_shares(with_sensors(rate_hz=1000.0), Gains())
    assert (quick > 2.0 * fine).all()


@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (with_sensors(encoder_counts_per_rev=2**14), "one count of lift's encoder asks for"),
        (with_sensors(rate_hz=100.0), "alpha_qd is a time constant of 14.4 ms at 100 Hz"),
    ],
)
def test_what_is_odd_is_said(robot: Robot, said: str) -> None:
    assert any(text.startswith(said) for text in gain_warnings(robot, Gains()))


def test_heavier_filters_at_the_same_rate_are_said() -> None:
    slow = replace(Gains(), alpha_qd=0.04, alpha_p=0.04, alpha_fd=0.04)
    said = gain_warnings(ROBOT, slow)
    assert [text.split()[0] for text in said] == ["alpha_qd", "alpha_p", "alpha_fd"]
