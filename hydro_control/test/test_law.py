"""The control law: analytic truths, signs of its terms, limits and faults."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.law.law import ControlLaw, Output
from hydro_control.motion.required_motion import Reference, damped_inverse, required_motion
from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.hydraulics.valve import edge_flows, flow_term
from hydro_model.multibody.kinematics import tip_jacobian, tip_jacobian_rate, tip_position
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

DATASHEET = load_robot("xs031")
ROBOT = replace(
    DATASHEET,
    cylinders=tuple(replace(c, viscous_friction=30e3) for c in DATASHEET.cylinders),
)
POSE = np.array([0.6, -1.5])
P_S, P_T = 19.0e6, 1.0e6
DT = 0.002
UNFILTERED = Gains(alpha_qd=1.0, alpha_p=1.0, alpha_fd=1.0, slew_limit_v_s=1e9)


def balance(robot: Robot, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pressures that hold a pose."""
    torque = inverse_dynamics(robot, q, 0 * q, 0 * q)
    p_b = np.full(2, 8e6)
    p_a = np.empty(2)
    for i, c in enumerate(robot.cylinders):
        p_a[i] = (torque[i] / float(lever(c, q[i])) + p_b[i] * c.area_b_m2) / c.area_a_m2
    return p_a, p_b


def joint_reference(q: FloatArray, qd: FloatArray | None = None) -> Reference:
    still = np.zeros_like(q)
    return Reference("joint", q, still if qd is None else qd, still)


def tip_reference(q: FloatArray, velocity: FloatArray | None = None) -> Reference:
    still = np.zeros(3)
    at = np.asarray(tip_position(ROBOT, q))
    return Reference("tip", at, still if velocity is None else velocity, still)


def run(law: ControlLaw, reference: Reference, steps: int = 3) -> Output:
    p_a, p_b = balance(law.robot, POSE)
    for k in range(steps):
        output = law.step(k * DT, POSE, p_a, p_b, P_S, P_T, reference)
    return output


@pytest.mark.parametrize("reference", [joint_reference(POSE), tip_reference(POSE)])
def test_at_rest_in_balance_the_valves_stay_shut(reference: Reference) -> None:
    output = run(ControlLaw(ROBOT, Gains()), reference)
    np.testing.assert_allclose(output.voltage_v, 0.0, atol=1e-6)
    np.testing.assert_allclose(output.required_force_n, output.force_n, rtol=1e-9)


def test_required_force_at_rest_is_the_gravity_load_of_the_planar_crane() -> None:
    bare = tuple(replace(c, barrel=None, rod=None) for c in ROBOT.cylinders)
    links_alone = replace(ROBOT, cylinders=bare)
    output = run(ControlLaw(links_alone, Gains()), joint_reference(POSE))
    m1, m2 = 128.51, 641.42
    q1, q12 = POSE[0], POSE.sum()
    tilt = 9.81 * m2 * (1.7082 * np.cos(q12) - 0.1434 * np.sin(q12))
    first = 9.81 * (m1 * (0.7404 * np.cos(q1) - 0.0368 * np.sin(q1)) + m2 * 1.6 * np.cos(q1))
    arms = [float(lever(c, q)) for c, q in zip(ROBOT.cylinders, POSE, strict=True)]
    expected = [(first + tilt) / arms[0], tilt / arms[1]]
    np.testing.assert_allclose(output.required_force_n, expected, rtol=1e-9)


def test_constant_required_velocity_gives_the_flow_that_moves_the_piston_so() -> None:
    """Through eqs. 23 and 24 and back through the valve: dV/dt of both chambers is met."""
    law = ControlLaw(ROBOT, replace(UNFILTERED, k_f_m2_ns=0.0, k_x_m=0.0))
    qd = np.array([0.1, -0.2])
    output = run(law, joint_reference(POSE, qd), steps=4)
    p_a, p_b = balance(ROBOT, POSE)
    for i, (c, valve) in enumerate(zip(ROBOT.cylinders, ROBOT.valves, strict=True)):
        x, xd = float(stroke(c, POSE[i])), float(lever(c, POSE[i])) * qd[i]
        u = output.voltage_v[i] / valve.rated_voltage_v
        q_a, q_b = edge_flows(valve, u, p_a[i], p_b[i], P_S, P_T)
        expected = -(c.area_a_m2 / x + c.area_b_m2 / (c.stroke_m - x)) * xd
        assert float(flow_term(c, x, q_a, q_b)) == pytest.approx(expected, rel=1e-6)
        assert np.sign(u) == np.sign(xd)


def shifted(name: str, value: float) -> Gains:
    """Gains of 0 but one, so that a single feedback term of the law is left."""
    zeros = {"k_p_1_s": 0.0, "k_v": 0.0, "k_f_m2_ns": 0.0, "k_x_m": 0.0}
    return replace(UNFILTERED, **{**zeros, name: value})


def test_sign_and_size_of_the_force_error_term() -> None:
    law = ControlLaw(ROBOT, shifted("k_f_m2_ns", 1e-8))
    p_a, p_b = balance(ROBOT, POSE)
    output = law.step(0.0, POSE, p_a - 1e5, p_b, P_S, P_T, joint_reference(POSE))
    missing = 1e5 * np.array([c.area_a_m2 for c in ROBOT.cylinders])
    np.testing.assert_allclose(output.flow_term, -1e-8 * missing, rtol=1e-9)
    assert np.all(output.voltage_v > 0.0)


def test_sign_and_size_of_the_velocity_error_term() -> None:
    """A piston that falls while it should stand is met by extending."""
    law = ControlLaw(ROBOT, shifted("k_x_m", 0.005))
    p_a, p_b = balance(ROBOT, POSE)
    qd = np.array([-0.01, -0.02])
    law.step(0.0, POSE - qd * DT, p_a, p_b, P_S, P_T, joint_reference(POSE))
    output = law.step(DT, POSE, p_a, p_b, P_S, P_T, joint_reference(POSE))
    np.testing.assert_allclose(
        output.piston_velocity_m_s / qd,
        [float(lever(c, q)) for c, q in zip(ROBOT.cylinders, POSE, strict=True)],
    )
    rate = output.required_force_n - law_first_force(law, qd)
    forward = -rate / DT / np.array([c.bulk_modulus_pa for c in ROBOT.cylinders])
    np.testing.assert_allclose(
        output.flow_term - forward, 0.005 * output.piston_velocity_m_s, rtol=1e-6
    )


def law_first_force(law: ControlLaw, qd: FloatArray) -> FloatArray:
    p_a, p_b = balance(ROBOT, POSE)
    fresh = ControlLaw(ROBOT, law.gains)
    return fresh.step(
        0.0, POSE - qd * DT, p_a, p_b, P_S, P_T, joint_reference(POSE)
    ).required_force_n


def test_position_error_raises_the_required_velocity_by_k_p() -> None:
    low = POSE - 0.01
    motion = required_motion(ROBOT, low, 0 * low, joint_reference(POSE), 15.0)
    np.testing.assert_allclose(motion.qd_r, 0.15)
    tip = required_motion(ROBOT, low, 0 * low, tip_reference(POSE), 15.0)
    error = tip_position(ROBOT, POSE) - tip_position(ROBOT, low)
    np.testing.assert_allclose(tip_jacobian(ROBOT, low) @ tip.qd_r, 15.0 * error, atol=1e-12)
    np.testing.assert_allclose(tip.q_d, POSE, atol=4e-4)


def test_friction_is_taken_at_the_required_velocity() -> None:
    """Erratum of eq. 22: with the measured velocity this difference would be 0."""
    qd = np.array([0.1, 0.05])
    rough, smooth = ControlLaw(ROBOT, UNFILTERED), ControlLaw(DATASHEET, UNFILTERED)
    with_friction = run(rough, joint_reference(POSE, qd))
    without = run(smooth, joint_reference(POSE, qd))
    expected = 30e3 * with_friction.required_piston_velocity_m_s
    np.testing.assert_allclose(
        with_friction.required_force_n - without.required_force_n, expected, rtol=1e-9
    )
    assert np.all(expected != 0.0)


def test_required_acceleration_is_the_derivative_of_required_velocity() -> None:
    """Along a motion q(t), with the tip off its reference."""
    path_velocity = np.array([0.3, 0.0, -0.2])
    start = np.asarray(tip_position(ROBOT, POSE)) + np.array([0.01, 0.0, 0.02])
    qd, h = np.array([0.2, -0.3]), 1e-5

    def at(t: float) -> tuple[FloatArray, FloatArray]:
        reference = Reference("tip", start + path_velocity * t, path_velocity, np.zeros(3))
        motion = required_motion(ROBOT, POSE + qd * t, qd, reference, 5.0)
        return motion.qd_r, motion.qdd_r

    numeric = (at(h)[0] - at(-h)[0]) / (2 * h)
    np.testing.assert_allclose(at(0.0)[1], numeric, rtol=1e-6)
    drift = tip_jacobian_rate(ROBOT, POSE, qd) @ at(0.0)[0]
    assert np.linalg.norm(drift) > 0.01


def test_voltage_saturates_and_slews() -> None:
    law = ControlLaw(ROBOT, replace(Gains(), slew_limit_v_s=500.0, k_x_m=0.05))
    p_a, p_b = balance(ROBOT, POSE)
    reference = joint_reference(POSE + 0.9)
    voltages = np.array(
        [law.step(k * DT, POSE, p_a, p_b, P_S, P_T, reference).voltage_v for k in range(40)]
    )
    # Up to rounding of the running sum, no step is above 500 V/s and the end is the limit.
    assert np.abs(np.diff(voltages, axis=0)).max() <= 1.0 + 1e-12
    assert np.abs(voltages[0]).max() <= 1.0
    assert np.abs(voltages).max() == 10.0
    down = [law.wind_down() for _ in range(12)]
    assert np.abs(np.diff([voltages[-1], *down], axis=0)).max() <= 1.0 + 1e-12
    assert not np.any(down[-1])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", range(6))
def test_a_value_that_is_no_number_gives_zero_volts_and_its_name(bad: float, place: int) -> None:
    names = ["joint position", "chamber A", "chamber B", "supply", "tank", "reference position"]
    law = ControlLaw(ROBOT, Gains())
    run(law, joint_reference(POSE + 0.1))
    p_a, p_b = balance(ROBOT, POSE)
    inputs: list[FloatArray] = [POSE.copy(), p_a, p_b, np.array([P_S]), np.array([P_T]), POSE + 0]
    inputs[place][0] = bad
    q, p_a, p_b, p_s, p_t, target = inputs
    output = law.step(1.0, q, p_a, p_b, float(p_s[0]), float(p_t[0]), joint_reference(target))
    assert not np.any(output.voltage_v)
    assert names[place] in output.fault
    # The next good sample is answered as the first.
    assert run(law, joint_reference(POSE)).fault == ""


def test_no_valve_opens_for_a_load_that_holds_more_than_the_supply() -> None:
    """It would empty into the supply: the arm would drop at full voltage."""
    law = ControlLaw(ROBOT, Gains())
    p_a, p_b = np.full(2, 10e6), np.full(2, P_T + 1e4)
    up = joint_reference(POSE + np.array([0.01, 0.0]))
    for k in range(20):
        output = law.step(k * DT, POSE, p_a, p_b, 6e6, P_T, up)
    assert output.flow_term[0] < 0.0
    assert output.voltage_v[0] == 0.0
    assert any("more than the supply" in note for note in output.notes)
    for k in range(20, 40):
        output = law.step(k * DT, POSE, p_a, p_b, 19e6, P_T, up)
    assert output.voltage_v[0] > 0.0
    assert not any("more than the supply" in note for note in output.notes)


def test_a_gap_starts_the_filters_anew() -> None:
    law = ControlLaw(ROBOT, Gains())
    run(law, joint_reference(POSE))
    p_a, p_b = balance(ROBOT, POSE)
    output = law.step(2.0, POSE + 0.1, p_a, p_b, P_S, P_T, joint_reference(POSE + 0.1))
    np.testing.assert_array_equal(output.piston_velocity_m_s, 0.0)
    assert "gap of 1.996 s" in output.notes[0]


def test_a_few_lost_samples_keep_the_velocity() -> None:
    law = ControlLaw(ROBOT, UNFILTERED)
    p_a, p_b = balance(ROBOT, POSE)
    law.step(0.0, POSE, p_a, p_b, P_S, P_T, joint_reference(POSE))
    output = law.step(4 * DT, POSE + 4e-4, p_a, p_b, P_S, P_T, joint_reference(POSE))
    arms = [float(lever(c, q)) for c, q in zip(ROBOT.cylinders, POSE + 4e-4, strict=True)]
    np.testing.assert_allclose(output.piston_velocity_m_s, 0.05 * np.array(arms), rtol=1e-9)


def test_a_stamp_that_does_not_grow_is_an_error() -> None:
    law = ControlLaw(ROBOT, Gains())
    run(law, joint_reference(POSE))
    p_a, p_b = balance(ROBOT, POSE)
    with pytest.raises(ControlError, match="expected a stamp after"):
        law.step(0.0, POSE, p_a, p_b, P_S, P_T, joint_reference(POSE))


def test_the_same_samples_give_the_same_bits() -> None:
    noise = np.random.default_rng(5).normal(size=(50, 2)) * 1e-5
    p_a, p_b = balance(ROBOT, POSE)

    def voltages() -> FloatArray:
        law = ControlLaw(ROBOT, Gains())
        reference = tip_reference(POSE + 0.01)
        return np.array(
            [
                law.step(k * DT, POSE + e, p_a, p_b, P_S, P_T, reference).voltage_v
                for k, e in enumerate(noise)
            ]
        )

    assert voltages().tobytes() == voltages().tobytes()


def test_damped_inverse_is_the_inverse_away_from_singular_poses() -> None:
    jacobian = tip_jacobian(ROBOT, POSE)
    inverse, damped = damped_inverse(jacobian)
    assert not damped
    np.testing.assert_allclose(inverse @ jacobian, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(inverse, np.linalg.pinv(jacobian), atol=1e-12)


@pytest.mark.parametrize("bend", [0.0, -1e-7, -1e-5, -1e-3, -1e-2])
def test_near_the_stretched_pose_required_velocity_stays_small(bend: float) -> None:
    q = np.array([0.6, bend])
    along = np.asarray(tip_position(ROBOT, q))
    along = along / np.linalg.norm(along)
    reference = Reference("tip", tip_position(ROBOT, q) + 0.05 * along, 0.5 * along, np.zeros(3))
    motion = required_motion(ROBOT, q, np.zeros(2), reference, 15.0)
    limits = [joint.velocity_limit for joint in ROBOT.joints]
    assert np.all(np.abs(motion.qd_r) <= limits)
    assert np.all(np.isfinite(motion.qdd_r))
    if bend != 0.0:
        assert "singular" in " ".join(motion.notes)


def test_far_from_its_reference_the_required_velocity_keeps_its_direction() -> None:
    motion = required_motion(
        ROBOT, POSE, np.zeros(2), joint_reference(POSE + np.array([0.4, 0.2])), 15.0
    )
    assert motion.qd_r.tolist() == pytest.approx([1.0, 0.5])
    assert "limit" in motion.notes[0]


def test_a_cylinder_that_pulls_is_controlled_by_the_same_law() -> None:
    """With the triangle mirrored the lever arm is negative, and extending lowers the joint."""
    tilt = ROBOT.cylinders[1]
    joint = ROBOT.joints[1]
    mirrored = replace(tilt, q0_rad=-tilt.q0_rad)
    flipped = replace(joint, lower=-joint.upper, upper=-joint.lower)
    robot = replace(
        ROBOT,
        cylinders=(ROBOT.cylinders[0], mirrored),
        joints=(ROBOT.joints[0], flipped),
    )
    pose = np.array([0.6, 1.5])
    law = ControlLaw(robot, UNFILTERED)
    p_a, p_b = balance(robot, pose)
    still = np.zeros(2)
    up = Reference("joint", pose + np.array([0.0, 0.01]), still, still)
    output = law.step(0.0, pose, p_a, p_b, P_S, P_T, up)
    assert output.voltage_v[1] < 0.0


def test_a_robot_that_cannot_be_controlled_is_refused() -> None:
    with pytest.raises(RobotError, match="no valve for cylinder 'tilt_cylinder'"):
        ControlLaw(replace(ROBOT, valves=ROBOT.valves[:1]), Gains())
    with pytest.raises(RobotError, match="no cylinder on joint 'tilt'"):
        ControlLaw(replace(ROBOT, cylinders=ROBOT.cylinders[:1]), Gains())
    wide = replace(ROBOT.joints[0], lower=-3.0)
    with pytest.raises(ControlError, match="lever arm"):
        ControlLaw(replace(ROBOT, joints=(wide, ROBOT.joints[1])), Gains())
    for limit, found in ((0.0, "0.0"), (np.inf, "none"), (np.nan, "nan")):
        endless = replace(ROBOT.joints[0], velocity_limit=limit)
        with pytest.raises(ControlError, match=f"velocity limit above 0 .* found {found}"):
            ControlLaw(replace(ROBOT, joints=(endless, ROBOT.joints[1])), Gains())


@pytest.mark.parametrize("name", [f.name for f in fields(Gains)])
@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_gains_out_of_range_are_refused(name: str, bad: float) -> None:
    with pytest.raises(ControlError, match=name):
        replace(Gains(), **{name: bad})


def test_valves_in_another_order_get_their_own_voltage() -> None:
    reference = joint_reference(POSE, np.array([0.1, -0.2]))
    straight = run(ControlLaw(ROBOT, Gains()), reference).voltage_v
    turned = replace(ROBOT, valves=ROBOT.valves[::-1])
    np.testing.assert_array_equal(
        run(ControlLaw(turned, Gains()), reference).voltage_v, straight[::-1]
    )
