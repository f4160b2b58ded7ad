"""Limits while moving: ends of joints and strokes, tip speed, pressure, singular poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.core import ControllerCore
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.law import ControlLaw
from hydro_control.motion_limits import MotionLimits, limited, limits_of, relieved
from hydro_control.required_motion import JointMotion, Reference, required_motion
from hydro_model.cylinder import stroke
from hydro_model.kinematics import tip_position, tip_state
from hydro_model.paths import TipPath
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

SEEDS = range(200)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("xs031")


@pytest.fixture(scope="module")
def limits(robot: Robot) -> MotionLimits:
    return limits_of(robot)


def motion(qd_r: FloatArray, qdd_r: FloatArray) -> JointMotion:
    zero = np.zeros_like(qd_r)
    return JointMotion(zero, zero, qd_r, qdd_r, np.zeros(3))


def test_the_range_keeps_joint_limits_and_strokes(robot: Robot, limits: MotionLimits) -> None:
    for i, joint in enumerate(robot.joints):
        assert joint.lower <= limits.lower[i] < limits.upper[i] <= joint.upper
        cylinder = robot.cylinder_of(joint.name)
        for q in (limits.lower[i], limits.upper[i]):
            assert 0.0 <= float(stroke(cylinder, q)) <= cylinder.stroke_m


def test_a_short_stroke_is_the_end(robot: Robot) -> None:
    cylinder = robot.cylinders[0]
    short = replace(robot, cylinders=(replace(cylinder, stroke_m=0.3), *robot.cylinders[1:]))
    i = robot.joint_index(cylinder.joint)
    ends = [
        float(stroke(cylinder, q[i])) for q in (limits_of(short).lower, limits_of(short).upper)
    ]
    assert max(ends) == pytest.approx(0.3, abs=2e-3)
    assert max(ends) <= 0.3


@pytest.mark.parametrize("seed", SEEDS)
def test_from_whatever_is_asked_the_arm_stops_before_the_ends(
    robot: Robot, limits: MotionLimits, seed: int
) -> None:
    """A body that does as it is asked, within the braking that is counted on, never passes."""
    random = np.random.default_rng(seed)
    q = random.uniform(limits.lower, limits.upper)
    asked = random.uniform(-3.0, 3.0, robot.dof)
    dt = 0.002
    for _ in range(1000):
        found = limited(robot, limits, q, asked, motion(asked, np.zeros(robot.dof)))
        q = q + dt * found.qd_r
    slack = limits.braking * dt**2  # what one step of the sampled law may be too far
    assert np.all(q <= limits.upper + slack)
    assert np.all(q >= limits.lower - slack)


@pytest.mark.parametrize("seed", SEEDS)
def test_limits_are_kept_at_every_instant_and_nothing_else_is_touched(
    robot: Robot, limits: MotionLimits, seed: int
) -> None:
    random = np.random.default_rng(seed)
    span = limits.upper - limits.lower
    q = random.uniform(limits.lower - 0.1 * span, limits.upper + 0.1 * span)
    qd, qdd_r = random.normal(0.0, 1.0, (2, robot.dof))
    qd_r = random.normal(0.0, 2.0, robot.dof)
    found = limited(robot, limits, q, qd, motion(qd_r, qdd_r))
    jacobian = tip_state(robot, q, qd)[1]
    for i in range(robot.dof):
        ahead = limits.upper[i] - q[i] if found.qd_r[i] > 0.0 else q[i] - limits.lower[i]
        braking_distance = found.qd_r[i] ** 2 / (2.0 * limits.braking[i])
        assert braking_distance <= max(ahead, 0.0) + 1e-12
        assert found.qd_r[i] * qd_r[i] >= 0.0
    fast = np.linalg.norm(jacobian @ qd_r) > limits.tip_speed_m_s
    if not fast and np.array_equal(found.qd_r, qd_r):
        assert np.array_equal(found.qdd_r, qdd_r)
        assert found.notes == ()
    else:
        assert found.notes


def test_beyond_an_end_the_way_back_is_open(robot: Robot, limits: MotionLimits) -> None:
    q = limits.upper + 0.05
    out = limited(robot, limits, q, q * 0.0, motion(np.full(2, 0.2), np.ones(2)))
    back = limited(robot, limits, q, q * 0.0, motion(np.full(2, -0.2), -np.ones(2)))
    assert np.all(out.qd_r == 0.0)
    assert np.all(out.qdd_r <= 0.0)
    assert np.array_equal(back.qd_r, np.full(2, -0.2))


def test_the_tip_is_slowed_without_turning(robot: Robot) -> None:
    slow = limits_of(robot, 0.25)
    q = 0.5 * (slow.lower + slow.upper)
    asked = np.array([0.4, -0.3])
    found = limited(robot, slow, q, q * 0.0, motion(asked, np.array([1.0, 2.0])))
    jacobian = tip_state(robot, q, q * 0.0)[1]
    assert np.linalg.norm(jacobian @ found.qd_r) == pytest.approx(0.25)
    assert found.qd_r[0] * asked[1] == pytest.approx(found.qd_r[1] * asked[0])
    assert "tip speed" in found.notes[0]


def test_a_tip_path_that_is_too_fast_is_refused(robot: Robot) -> None:
    path = TipPath.through([[2.0, 0.0, -1.2], [3.0, 0.0, -1.2]], [3.0])
    ControllerCore(robot, Gains(), path, tip_speed_m_s=0.63)
    with pytest.raises(ControlError, match=r"reaches 0\.625 m/s at 1\.50 s .* at most 0\.6 m/s"):
        ControllerCore(robot, Gains(), path, tip_speed_m_s=0.6)


@pytest.mark.parametrize("distance", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 0.0])
def test_near_a_singular_pose_no_leap_is_commanded(robot: Robot, distance: float) -> None:
    """Stretched arm, tip asked for sideways, outwards and in between: speeds stay in limits."""
    q = np.array([0.5, -distance])
    tip = np.asarray(tip_position(robot, q))
    for angle in np.linspace(0.0, 2.0 * np.pi, 13):
        push = 0.5 * np.array([np.cos(angle), 0.0, np.sin(angle)])
        reference = Reference("tip", tip + push, push, 4.0 * push)
        found = required_motion(robot, q, np.zeros(2), reference, 10.0)
        speeds = np.array([joint.velocity_limit for joint in robot.joints])
        assert np.all(np.abs(found.qd_r) <= speeds + 1e-12)
        assert np.all(np.isfinite(found.qdd_r))


@pytest.mark.parametrize(
    ("signal", "p_a", "p_b", "expected"),
    [
        (0.5, 10e6, 10e6, 0.5),
        (0.5, 22.5e6, 0.0, 0.5),
        (0.5, 23.75e6, 0.0, 0.25),
        (0.5, 25e6, 0.0, 0.0),
        (0.5, 40e6, 0.0, 0.0),
        (-0.5, 40e6, 0.0, -0.5),
        (-0.5, 0.0, 25e6, 0.0),
        (0.5, 0.0, 40e6, 0.5),
    ],
)
def test_no_chamber_at_its_limit_is_fed(
    signal: float, p_a: float, p_b: float, expected: float
) -> None:
    assert relieved(signal, p_a, p_b, 25e6) == pytest.approx(expected)


@pytest.mark.parametrize("jump", [0.2, 1.0, 100.0])
def test_a_reference_that_jumps_moves_the_voltage_by_the_slew_limit_at_most(
    robot: Robot, jump: float
) -> None:
    gains = Gains()
    law = ControlLaw(robot, gains)
    q = np.array([0.6, -1.5])
    pressures = np.full(len(robot.cylinders), 8e6)
    before = np.zeros(len(robot.valves))
    still = np.zeros(robot.dof)
    for k in range(60):
        aim = Reference("joint", q + (jump if k >= 30 else 0.0), still, still)
        answer = law.step(0.002 * k, q, pressures, pressures, 19e6, 1e6, aim)
        assert np.all(np.abs(answer.voltage_v - before) <= gains.slew_limit_v_s * 0.002 + 1e-12)
        assert np.all(np.abs(answer.voltage_v) <= 10.0)
        before = answer.voltage_v
