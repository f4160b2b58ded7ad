"""Gains that cannot be meant for a machine are said before it moves."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_control.gains import Gains
from hydro_control.law.gain_checks import count_shares, gain_warnings
from hydro_model.multibody.rigid_body import mass_matrix, required_torque
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


def test_what_is_to_be_corrected_is_named_as_the_robot_file_has_it() -> None:
    (lift, _) = gain_warnings(with_sensors(encoder_counts_per_rev=2**14), Gains())
    key = re.search(r"correct (\w+) of the robot file [(](\w+), (\w+)[)]", lift)
    assert key is not None
    assert ROBOT.source is not None
    content = yaml.safe_load(ROBOT.source.read_text(encoding="utf-8"))
    assert content[key[2]][key[3]][key[1]] == ROBOT.sensors.encoder_counts_per_rev


def test_the_page_on_gains_has_these_numbers() -> None:
    page = (Path(__file__).parents[2] / "hydro_msgs_docs/gains.md").read_text(encoding="utf-8")
    fine = count_shares(ROBOT, Gains())[0]
    coarse = count_shares(with_sensors(encoder_counts_per_rev=2**14), Gains())[0]
    said = f"{fine:.0%} ({10.0 * fine:.2f} V) for the shipped robot, {coarse:.0%} with 14 bits"
    text = " ".join(page.split())
    assert said.replace("%", " %") in text
    weights = [1.0 - 0.5 ** (500.0 / rate_hz) for rate_hz in (1000.0, 100.0)]
    assert f"{weights[0]:.2f} at 1 kHz, {weights[1]:.2f} at 100 Hz" in text
    pose, still, lift = np.array([0.6, -1.5]), np.zeros(2), np.array([1.0, 0.0])
    held, free = (required_torque(ROBOT, pose, still, lift, still, k) for k in (Gains().k_v, 0.0))
    rate = (held - free)[0] / mass_matrix(ROBOT, pose)[0, 0]
    assert f"(1/s): about {rate:.0f} for the lift" in text


def test_heavier_filters_at_the_same_rate_are_said() -> None:
    slow = replace(Gains(), alpha_qd=0.04, alpha_p=0.04, alpha_fd=0.04)
    said = gain_warnings(ROBOT, slow)
    assert [text.split()[0] for text in said] == ["alpha_qd", "alpha_p", "alpha_fd"]
