"""A payload taken up mid-run on a random machine, with and without adaptation."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_control.adaptation.adaptation_settings import KINDS, AdaptationSettings
from hydro_hw_bridge.rig.payload import Payload
from hydro_hw_bridge.rig.random_truth import random_truth
from hydro_ident.study.adaptation import pick_up
from hydro_ident.study.gain_choice import exact_model
from hydro_model.robot_files import load_robot


@pytest.mark.thorough
def test_adaptation_finds_the_payload_and_lowers_the_error() -> None:
    robot = load_robot("xs031")
    truth = random_truth(robot, 101)
    model, payload = exact_model(robot, truth), Payload(50.0, 7.0)
    _, off = pick_up(robot, truth, model, AdaptationSettings(), payload, hold_s=0.5)
    run, on = pick_up(robot, truth, model, AdaptationSettings(KINDS), payload, hold_s=4.0)
    assert on.payload_before_kg == pytest.approx(0.0, abs=4.0)
    assert on.payload_after_kg == pytest.approx(50.0, abs=4.0)
    assert on.coulomb_error < 0.1
    assert on.null_error < 0.002
    assert on.rmse_after_mm < 0.8 * off.rmse_after_mm
    assert on.max_after_mm < off.max_after_mm
    assert on.speed_excess < 0.02
    assert on.hold_drift == 0.0
    assert np.all(np.abs(run.estimates[:, 0]) <= 100.0)
