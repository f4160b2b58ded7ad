"""Limits while moving: ends of joints and strokes, tip speed, pressure, singular poses.

Every property is asked of the readable functions and of the compiled ones that drive the machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.law.law import ControlLaw
from hydro_control.law.law_arrays import SPEED, LawArrays, law_arrays, law_work
from hydro_control.law.law_kernels import voltage_kernel
from hydro_control.law.motion_kernels import limit_notes, motion_kernel
from hydro_control.motion.braking import (
    BRAKING_PER_VELOCITY_1_S,
    DOWN,
    POINTS,
    UP,
    speed_before_end,
)
from hydro_control.motion.motion_limits import (
    MotionLimits,
    limited,
    limits_of,
    refuse_fast,
    relieved,
)
from hydro_control.motion.required_motion import JointMotion, Reference, required_motion
from hydro_control.state.axes import axes_of
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.motion.paths_segments import Quintic
from hydro_model.multibody.kinematics import tip_position, tip_state
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

SEEDS = range(200)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("xs031")


@pytest.fixture(scope="module")
def limits(robot: Robot) -> MotionLimits:
    return limits_of(robot)


Limiter = Callable[[Robot, MotionLimits, FloatArray, FloatArray, JointMotion], JointMotion]


def arrays_of(robot: Robot, limits: MotionLimits, k_p_1_s: float) -> LawArrays:
    return law_arrays(robot, axes_of(robot), limits, Gains(k_p_1_s=k_p_1_s), 0.002)


def shipped(
    arrays: LawArrays, reference: Reference, q: FloatArray, qd: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """The compiled required motion, and what limited it."""
    rows = np.array([reference.position, reference.velocity, reference.acceleration])
    out, work = np.empty((2, len(q))), law_work(arrays)
    found = motion_kernel(arrays, work, reference.space == "tip", q, qd, rows, out[0], out[1])
    return out[0], out[1], limit_notes(found)


def limited_as_shipped(
    robot: Robot, limits: MotionLimits, q: FloatArray, qd: FloatArray, asked: JointMotion
) -> JointMotion:
    """As `limited`: the whole compiled required motion, asked for what passes its first half."""
    arrays = arrays_of(robot, limits, 0.0)
    arrays.limits[SPEED] = 1e9
    reference = Reference("joint", q, asked.qd_r, asked.qdd_r)
    qd_r, qdd_r, notes = shipped(arrays, reference, q, qd)
    return replace(asked, qd_r=qd_r, qdd_r=qdd_r, notes=notes)


both = pytest.mark.parametrize("limiter", [limited, limited_as_shipped], ids=["read", "shipped"])


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


@both
@pytest.mark.parametrize("seed", SEEDS)
def test_from_whatever_is_asked_the_arm_stops_before_the_ends(
    robot: Robot, limits: MotionLimits, seed: int, limiter: Limiter
) -> None:
    """A body that does as it is asked never passes; on the rig: test_ends_rig.py."""
    random = np.random.default_rng(seed)
    q = random.uniform(limits.lower, limits.upper)
    asked = random.uniform(-3.0, 3.0, robot.dof)
    dt = 0.02
    for _ in range(200):
        found = limiter(robot, limits, q, asked, motion(asked, np.zeros(robot.dof)))
        q = q + dt * found.qd_r
    assert np.all(q <= limits.upper)
    assert np.all(q >= limits.lower)


@both
@pytest.mark.parametrize("seed", SEEDS)
def test_limits_are_kept_at_every_instant_and_nothing_else_is_touched(
    robot: Robot, limits: MotionLimits, seed: int, limiter: Limiter
) -> None:
    random = np.random.default_rng(seed)
    span = limits.upper - limits.lower
    q = random.uniform(limits.lower - 0.1 * span, limits.upper + 0.1 * span)
    limits = replace(
        limits,
        open_lower=np.minimum(limits.lower, q),
        open_upper=np.maximum(limits.upper, q),
    )
    qd, qdd_r = random.normal(0.0, 1.0, (2, robot.dof))
    qd_r = random.normal(0.0, 2.0, robot.dof)
    found = limiter(robot, limits, q, qd, motion(qd_r, qdd_r))
    jacobian = tip_state(robot, q, qd)[1]
    for i in range(robot.dof):
        grid = np.linspace(limits.lower[i], limits.upper[i], POINTS)
        side = UP if found.qd_r[i] > 0.0 else DOWN
        energy = np.interp(q[i], grid, limits.braking[side, i])
        assert 0.5 * found.qd_r[i] ** 2 <= energy + 1e-12
        assert found.qd_r[i] * qd_r[i] >= 0.0
    fast = np.linalg.norm(jacobian @ qd_r) > limits.tip_speed_m_s
    if not fast and np.array_equal(found.qd_r, qd_r):
        assert np.array_equal(found.qdd_r, qdd_r)
        assert found.notes == ()
    else:
        assert found.notes


@pytest.mark.parametrize("seed", range(10))
def test_the_cylinder_can_brake_as_it_is_counted_on(
    robot: Robot, limits: MotionLimits, seed: int
) -> None:
    """And 1.4 times as hard, whatever the others do within as many of their limits per second."""
    random = np.random.default_rng(seed)
    speeds = np.array([joint.velocity_limit for joint in robot.joints])
    steps = (limits.upper - limits.lower) / (POINTS - 1)
    p_s, p_t = robot.supply_pressure_pa, robot.tank_pressure_pa
    for i, axis in product(range(robot.dof), axes_of(robot)):
        if axis.joint is not robot.joints[i]:
            continue
        for side, towards in ((UP, 1.0), (DOWN, -1.0)):
            q = random.uniform(limits.lower, limits.upper)
            k = min(int((q[i] - limits.lower[i]) / steps[i]), POINTS - 2)
            counted = abs(limits.braking[side, i, k + 1] - limits.braking[side, i, k]) / steps[i]
            assert 0.0 < counted <= BRAKING_PER_VELOCITY_1_S * speeds[i] * 1.001
            others = random.uniform(-1.0, 1.0, robot.dof) * speeds / speeds[i]
            others[i] = -towards
            torque = inverse_dynamics(robot, q, 0.0 * q, 1.4 * counted * others)[i]
            c, h = axis.cylinder, 1e-6
            arm = float(stroke(c, q[i] + h) - stroke(c, q[i] - h)) / (2.0 * h)
            push = arm * (p_s * c.area_a_m2 - p_t * c.area_b_m2)
            pull = arm * (p_t * c.area_a_m2 - p_s * c.area_b_m2)
            # Between two tabulated points the worst pose is a little worse than at either.
            assert pull - 0.02 * push <= torque <= 1.02 * push


def test_the_speed_before_an_end_leaves_time_to_react(limits: MotionLimits) -> None:
    """Going on for 0.1 s and braking by the local deceleration then ends within the distance."""
    for i in range(len(limits.lower)):
        ends = float(limits.lower[i]), float(limits.upper[i])
        energies = limits.braking[UP, i]
        step = (ends[1] - ends[0]) / (POINTS - 1)
        brake = float(energies[-2]) / step
        for away in np.linspace(0.0, 0.9 * step, 7):
            speed, fall = speed_before_end(energies, *ends, ends[1] - away, 0.0)
            assert 0.1 * speed + speed**2 / (2.0 * brake) == pytest.approx(away, abs=1e-12)
            h = 1e-7
            less = speed_before_end(energies, *ends, ends[1] - away - h, 0.0)[0]
            assert away == 0.0 or fall == pytest.approx((less - speed) / h, rel=1e-3)


@both
def test_beyond_an_end_the_way_back_is_open(
    robot: Robot, limits: MotionLimits, limiter: Limiter
) -> None:
    q, still = limits.upper + 0.05, np.zeros(2)
    stood = replace(limits, open_upper=q)
    out = limiter(robot, stood, q, still, motion(np.full(2, 0.2), np.ones(2)))
    back = limiter(robot, stood, q, still, motion(np.full(2, -0.2), -np.ones(2)))
    assert np.all(out.qd_r == 0.0)
    assert np.all(out.qdd_r <= 0.0)
    assert np.array_equal(back.qd_r, np.full(2, -0.2))


@both
def test_from_further_out_than_it_stood_an_arm_is_asked_back(
    robot: Robot, limits: MotionLimits, limiter: Limiter
) -> None:
    still = np.zeros(2)
    for sign, end in ((1.0, limits.upper), (-1.0, limits.lower)):
        found = limiter(robot, limits, end + sign * 0.03, still, motion(sign * 0.2 + still, still))
        assert found.qd_r == pytest.approx(np.full(2, -sign * 0.1))  # 0.03 rad over 0.3 s
        away = limiter(robot, limits, end + sign * 0.03, still, motion(-sign * 0.2 + still, still))
        assert np.array_equal(away.qd_r, np.full(2, -sign * 0.2))


@both
def test_the_tip_is_slowed_without_turning(robot: Robot, limiter: Limiter) -> None:
    slow = limits_of(robot, 0.25)
    q = 0.5 * (slow.lower + slow.upper)
    asked = np.array([0.4, -0.3])
    found = limiter(robot, slow, q, q * 0.0, motion(asked, np.array([1.0, 2.0])))
    jacobian = tip_state(robot, q, q * 0.0)[1]
    assert np.linalg.norm(jacobian @ found.qd_r) == pytest.approx(0.25)
    assert found.qd_r[0] * asked[1] == pytest.approx(found.qd_r[1] * asked[0])
    assert "tip speed" in found.notes[0]


@pytest.mark.parametrize("seed", range(20))
def test_no_joint_is_asked_for_more_than_its_speed(robot: Robot, seed: int) -> None:
    random = np.random.default_rng(seed)
    limits = limits_of(robot, 20.0)
    speeds = np.array([joint.velocity_limit for joint in robot.joints])
    q, asked = 0.5 * (limits.lower + limits.upper), random.uniform(1.1, 5.0, 2) * speeds
    reference = Reference("joint", q, asked, np.zeros(2))
    found, _, notes = shipped(arrays_of(robot, limits, 20.0), reference, q, np.zeros(2))
    read = required_motion(robot, q, np.zeros(2), reference, 20.0)
    for qd_r in (found, read.qd_r):
        assert np.max(qd_r / speeds) == pytest.approx(1.0)
        assert qd_r[0] * asked[1] == pytest.approx(qd_r[1] * asked[0])
    assert "required joint velocity is at its limit" in notes


def test_a_tip_path_that_is_too_fast_is_refused(robot: Robot) -> None:
    path = TipPath.through([[2.0, 0.0, -1.2], [3.0, 0.0, -1.2]], [3.0])
    ControllerCore(robot, Gains(), path, tip_speed_m_s=0.63)
    with pytest.raises(ControlError, match=r"reaches 0\.625 m/s at 1\.5000 s .* at most 0\.6 m/s"):
        ControllerCore(robot, Gains(), path, tip_speed_m_s=0.6)


def test_a_joint_path_whose_tip_is_too_fast_is_refused(robot: Robot) -> None:
    """Slowed while it is played it would be another motion than the one that was asked for."""
    start, end = [0.2, -0.9], [1.1, -0.9]
    path = JointPath((Quintic.at_rest(start, end, 2.0),), joints=robot.joint_names)
    times = np.linspace(0.0, 2.0, 2001)
    tips = tip_position(robot, path.sample_many(times)[0])
    fastest = float(np.linalg.norm(np.gradient(tips, times, axis=0), axis=1).max())
    ControllerCore(robot, Gains(), path, tip_speed_m_s=1.01 * fastest)
    with pytest.raises(ControlError, match=rf"reaches {fastest:.2f}\d m/s at 1\.0000 s"):
        ControllerCore(robot, Gains(), path, tip_speed_m_s=0.99 * fastest)
    # Of the joints that it does not name it is asked where they stand: a bent arm is slower.
    lift = JointPath((Quintic.at_rest([0.2], [1.1], 2.0),), joints=("lift",))
    bent = np.array([0.2, -2.4])
    refuse_fast(robot, lift, 0.99 * fastest, bent)
    with pytest.raises(ControlError, match="the tip reaches"):
        refuse_fast(robot, lift, 0.99 * fastest, np.array(start))


def test_a_leg_of_a_few_milliseconds_is_no_way_around_the_tip_speed(robot: Robot) -> None:
    """A quintic from rest to rest is fastest in its middle, 15/8 of its mean speed."""
    corners = [[2.0, 0.0, -1.2], [2.012, 0.0, -1.2], [3.0, 0.0, -1.2]]
    path = TipPath.through(corners, [0.004, 5.0], start_delay_s=0.003)
    refuse_fast(robot, path, 5.63)
    with pytest.raises(ControlError, match=r"reaches 5\.625 m/s at 0\.0050 s"):
        refuse_fast(robot, path, 5.62)


@pytest.mark.parametrize("distance", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 0.0])
def test_near_a_singular_pose_no_leap_is_commanded(robot: Robot, distance: float) -> None:
    """Stretched arm, tip asked for sideways, outwards and in between: speeds stay in limits."""
    tilt = replace(robot.joints[1], upper=0.3)  # so that no end keeps it from being stretched
    robot = replace(robot, joints=(robot.joints[0], tilt))
    q = np.array([0.5, -distance])
    tip = np.asarray(tip_position(robot, q))
    for angle in np.linspace(0.0, 2.0 * np.pi, 13):
        push = 0.5 * np.array([np.cos(angle), 0.0, np.sin(angle)])
        reference = Reference("tip", tip + push, push, 4.0 * push)
        found = required_motion(robot, q, np.zeros(2), reference, 10.0)
        speeds = np.array([joint.velocity_limit for joint in robot.joints])
        arrays = arrays_of(robot, limits_of(robot), 10.0)
        loop_qd_r, loop_qdd_r, notes = shipped(arrays, reference, q, np.zeros(2))
        assert np.all(np.abs(found.qd_r) <= speeds + 1e-12)
        assert np.all(np.abs(loop_qd_r) <= speeds + 1e-12)
        assert np.all(np.isfinite([found.qdd_r, loop_qdd_r]))
        # Undamped, the lost direction would ask for the speed limit whatever small push is given.
        small = Reference("tip", tip + 1e-4 * push, 0.0 * push, 0.0 * push)
        creep, _, notes = shipped(arrays, small, q, np.zeros(2))
        assert np.all(np.abs(creep) < 0.02)
        assert distance > 0.05 or distance == 0.0 or "singular" in notes[0]


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
    robot = load_robot("xs031")
    assert robot.sensors.pressure_range_pa == 25e6
    pressures, out = np.array([[p_a, p_a], [p_b, p_b]]), np.zeros(2)
    arrays = arrays_of(robot, limits_of(robot), 20.0)
    arrays.gains[-1] = 100.0  # no slew limit
    voltage_kernel(arrays, np.full(2, signal), pressures, np.zeros(2), out)
    assert out == pytest.approx(10.0 * expected)


def test_a_supply_that_the_transducers_cannot_show_is_refused() -> None:
    """Valves would be closed for pressures that the load needs, and nobody told."""
    with pytest.raises(
        ControlError, match="a supply of at most 250 bar, its pressure transducers"
    ):
        limits_of(replace(load_robot("xs031"), supply_pressure_pa=28e6))


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
