"""The controller on the rig, core to core: the anchors that a right implementation must meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth import Truth
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_ident.recordings.metrics import TRUTH_HALF_WIDTH, Tracking, tracking
from hydro_ident.study.closed_loop import run_closed_loop
from hydro_ident.study.gain_choice import exact_model
from hydro_model.motion.paths import TipPath
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

#: The first side of the reference parallelogram.
SIDE = TipPath.through([[2.0, 0.0, -1.2], [3.0, 0.0, -1.2]], [3.0])
UNFILTERED = Gains(alpha_qd=1.0, alpha_p=1.0, alpha_fd=1.0)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("xs031")


def drive(truth: Truth, model: Robot, gains: Gains, seed: int = 0) -> Tracking:
    rig = RigCore(load_robot("xs031"), truth, seed=seed, tip_m=[2.0, 0.0, -1.2])
    core = ControllerCore(model, gains, SIDE, start_delay_s=0.5)
    run = run_closed_loop(rig, core, SIDE.duration_s + 0.8)
    stamp_ns = np.round(run.time_s * 1e9).astype(np.int64)
    return tracking(stamp_ns, run.tip_m, run.tip_reference_m, half_width=TRUTH_HALF_WIDTH)


@pytest.fixture(scope="module")
def right(robot: Robot) -> Tracking:
    return drive(Truth.ideal(robot), robot, UNFILTERED)


@pytest.fixture(scope="module")
def realistic(robot: Robot) -> tuple[Truth, Robot, Tracking]:
    """A realistic machine, a model of it, and how the shipped gains drive it."""
    truth = load_truth("realistic", robot)
    model = exact_model(robot, truth)
    return truth, model, drive(truth, model, Gains(), seed=1)


def test_plant_that_equals_the_model_is_followed_almost_exactly(right: Tracking) -> None:
    # The truth plant shares no physics code with the controller's model: only right ones agree.
    assert right.rho_s < 2e-4
    assert right.max_error_mm < 0.1


def test_a_model_that_is_wrong_is_followed_worse(robot: Robot, right: Tracking) -> None:
    heavier = replace(robot, link_inertia=1.2 * robot.link_inertia)
    weaker = replace(robot, valves=tuple(replace(v, c_pa=0.8 * v.c_pa) for v in robot.valves))
    for wrong in (heavier, weaker):
        assert drive(Truth.ideal(robot), wrong, UNFILTERED).rmse_mm > 5.0 * right.rmse_mm


def test_shipped_gains_are_steady_on_a_realistic_machine(
    realistic: tuple[Truth, Robot, Tracking],
) -> None:
    row = realistic[2]
    assert row.max_speed_m_s < 1.02 * row.reference_speed_m_s
    # Unmodelled friction, deadband and delay leave an error of millimetres, not of centimetres.
    assert 0.5 < row.max_error_mm < 15.0


def test_noise_decides_little(realistic: tuple[Truth, Robot, Tracking]) -> None:
    truth, model, first = realistic
    rows = [first.rmse_mm, drive(truth, model, Gains(), seed=2).rmse_mm]
    assert rows[0] != rows[1]
    assert abs(rows[0] - rows[1]) < 0.05 * rows[0]
