"""What measured motion ends in 0 V: thresholds, noise, single wrong readings, and its latch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.errors import ControlError
from hydro_control.monitoring.runaway import BELIEVED, SPAN, RunawayLimits, RunawayWatch
from hydro_control.motion.motion_limits import limits_of
from hydro_model.multibody.kinematics import tip_position, tip_state
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
LIMITS = limits_of(ROBOT)
RANGE = LIMITS.upper - LIMITS.lower
MIDDLE = np.array([0.8, -1.2])
DT = 0.002


def watch(runaway: RunawayLimits | None = None, tip_speed_m_s: float = 3.0) -> RunawayWatch:
    limits = replace(LIMITS, tip_speed_m_s=tip_speed_m_s)
    return RunawayWatch(ROBOT, limits, runaway or RunawayLimits(), DT)


def judged(one: RunawayWatch, rows: FloatArray, *, driven: bool = True) -> list[str]:
    return [one.judge(k * DT, q, driven=driven) for k, q in enumerate(rows)]


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("joint", [0, 1])
def test_a_joint_beyond_its_end_by_more_than_the_margin_is_a_fault(
    joint: int, sign: float
) -> None:
    rows = np.tile(MIDDLE, (10, 1))
    end = LIMITS.upper[joint] if sign > 0.0 else LIMITS.lower[joint]
    rows[2:, joint] = end + sign * 0.019 * RANGE[joint]  # and the leap there is no speed
    assert not any(judged(watch(RunawayLimits(speed_factor=1e6)), rows))
    rows[2:, joint] = end + sign * 0.021 * RANGE[joint]
    said = judged(watch(RunawayLimits(speed_factor=1e6)), rows)
    assert [bool(text) for text in said] == [k >= 1 + BELIEVED for k in range(10)]
    assert f"joint '{ROBOT.joint_names[joint]}' is measured at" in said[-1]
    wide = RunawayLimits(end_share=0.03, speed_factor=1e6)
    assert not any(judged(watch(wide), rows))


@pytest.mark.parametrize(("factor", "faulty"), [(1.45, False), (1.55, True), (-1.55, True)])
@pytest.mark.parametrize("joint", [0, 1])
def test_a_joint_faster_than_its_limit_by_the_factor_is_a_fault(
    joint: int, factor: float, faulty: bool
) -> None:
    rows = np.tile(MIDDLE, (40, 1))
    rows[:, joint] += factor * ROBOT.joints[joint].velocity_limit * DT * np.arange(40)
    said = judged(watch(tip_speed_m_s=20.0), rows)
    assert bool(said[-1]) == faulty
    assert said.index(said[-1]) in ((0,) if not faulty else (SPAN + BELIEVED - 1,))
    assert not faulty or "at a speed of" in said[-1]


@pytest.mark.parametrize(("speed", "faulty"), [(0.7, False), (0.8, True)])
def test_a_tip_faster_than_its_limit_by_the_factor_is_a_fault(speed: float, faulty: bool) -> None:
    radius = float(np.linalg.norm(_tip(MIDDLE)[[0, 2]]))
    rows = np.tile(MIDDLE, (40, 1))
    rows[:, 0] += speed / radius * DT * np.arange(40)  # about the lift's axis, near enough
    said = judged(watch(tip_speed_m_s=0.5), rows)
    assert bool(said[-1]) == faulty
    assert not faulty or "the tip is measured at 0.8" in said[-1]


def test_under_a_low_limit_what_every_start_overshoots_is_no_runaway() -> None:
    radius = float(np.linalg.norm(_tip(MIDDLE)[[0, 2]]))
    for speed, faulty in ((0.21, False), (0.24, True)):
        rows = np.tile(MIDDLE, (40, 1))
        rows[:, 0] += speed / radius * DT * np.arange(40)
        assert bool(judged(watch(tip_speed_m_s=0.02), rows)[-1]) == faulty


def test_it_says_how_fast_the_tip_is() -> None:
    random, one, rows = np.random.default_rng(5), watch(tip_speed_m_s=0.02), [MIDDLE]
    for _ in range(SPAN + BELIEVED - 1):  # with the last of these it is believed
        rows.append(rows[-1] + DT * random.uniform(0.1, 0.3, 2))
    said = judged(one, np.array(rows))[-1]
    moved_m = tip_position(ROBOT, rows[-1]) - tip_position(ROBOT, rows[-1 - SPAN])
    expected = float(np.linalg.norm(moved_m)) / (SPAN * DT)
    found = float(said.removeprefix("the tip is measured at ").split()[0])
    assert found == pytest.approx(expected, abs=6e-4)


def _tip(q: FloatArray) -> FloatArray:
    jacobian = tip_state(ROBOT, q, 0.0 * q)[1]
    across = float(np.linalg.norm(jacobian[:, 0]))
    tip = np.asarray(tip_position(ROBOT, q))
    return np.asarray(tip * across / np.linalg.norm(tip[[0, 2]]))


def test_wrong_readings_noise_and_gaps_are_none() -> None:
    random = np.random.default_rng(3)
    rows = MIDDLE + 2e-4 * random.normal(size=(500, 2))
    rows[100:102] += 0.5  # two readings, and as they leave the span again
    rows[200] = LIMITS.upper + 1.0
    assert not any(judged(watch(), rows))
    moved, late = watch(), 0.5
    assert not moved.judge(0.0, MIDDLE, driven=True)
    assert not any(moved.judge(late + k * DT, MIDDLE + 0.3, driven=True) for k in range(50))


def test_what_the_valves_do_not_get_drives_nothing_and_driving_begins_where_it_stands() -> None:
    one = watch()
    rows = MIDDLE + np.outer(np.linspace(0.0, 1.0, 40), [1.0, 0.0])
    assert not any(judged(one, rows, driven=False))
    assert one.opened
    assert one.upper[0] == pytest.approx(MIDDLE[0] + 1.0)
    # Driven back its place follows, so that the way out closes behind it.
    for k in range(60):
        q = rows[-1] - [0.001 * k, 0.0]
        assert not one.judge(0.1 + k * DT, q, driven=True)
    assert one.upper[0] == pytest.approx(MIDDLE[0] + 1.0 - 0.059)
    for k in range(200):
        q = np.maximum(rows[-1] - [0.059 + 0.001 * k, 0.0], MIDDLE)
        assert not one.judge(0.3 + k * DT, q, driven=True)
    assert not one.opened
    assert np.array_equal(one.upper, LIMITS.upper)


@pytest.mark.parametrize(("share", "factor"), [(0.0, 1.5), (0.1, 1.5), (0.02, 1.0)])
def test_limits_that_are_none_are_refused(share: float, factor: float) -> None:
    with pytest.raises(ControlError, match="should be above"):
        RunawayLimits(share, factor)
