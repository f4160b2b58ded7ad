"""Listed effects met in the equations where they belong, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_control.adaptation.adaptation import Adaptation
from hydro_control.adaptation.adaptation_settings import KINDS, AdaptationSettings
from hydro_control.compensation.compensation import SMALLEST_SCALE_M_S, Compensation, Motion
from hydro_control.compensation.compensation_plan import NOT_COMPENSATED, plan
from hydro_control.core.core import ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_control.law.law import ControlLaw, Output
from hydro_control.motion.required_motion import Reference
from hydro_control.state.axes import axes_of
from hydro_control.state.sensor_correction import SensorCorrection
from hydro_model.effects import CATALOGUE, Readings, read_with, resolve
from hydro_model.effects.targets import targets
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.hydraulics.valve import valve_signal
from hydro_model.motion.paths import TipPath, load_path
from hydro_model.multibody.kinematics import tip_position
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate_reference import reference_rates

DATASHEET = load_robot("xs031")
ROBOT = replace(
    DATASHEET,
    cylinders=tuple(replace(c, viscous_friction=30e3) for c in DATASHEET.cylinders),
)
POSE, QD = np.array([0.6, -1.5]), np.array([0.1, -0.2])
P_S, P_T = 19.0e6, 1.0e6
DT = 0.002
UNFILTERED = Gains(
    k_f_m2_ns=0.0, k_x_m=0.0, alpha_qd=1.0, alpha_p=1.0, alpha_fd=1.0, slew_limit_v_s=1e9
)


def listing(name: str, target: str = "xs031", /, **values: float) -> EffectSpec:
    return EffectSpec(name, target, values)


def with_effects(*effects: EffectSpec) -> Robot:
    return replace(ROBOT, effects=effects)


def pressures(robot: Robot, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gauge pressures that hold a pose."""
    torque, p_b = inverse_dynamics(robot, q, 0 * q, 0 * q), np.full(2, 8.0e6)
    arms = np.array([float(lever(c, x)) for c, x in zip(robot.cylinders, q, strict=True)])
    areas = np.array([(c.area_a_m2, c.area_b_m2) for c in robot.cylinders])
    return (torque / arms + p_b * areas[:, 1]) / areas[:, 0], p_b


def moving(robot: Robot, qd: FloatArray = QD, gains: Gains = UNFILTERED) -> Output:
    """First answer to a joint reference that moves on from the pose."""
    reference = Reference("joint", POSE, qd, np.zeros(2))
    p_a, p_b = pressures(ROBOT, POSE)
    return ControlLaw(robot, gains).step(0.0, POSE, p_a, p_b, P_S, P_T, reference)


def test_every_effect_is_compensated_or_said_why_not() -> None:
    assert set(NOT_COMPENSATED) <= set(CATALOGUE)
    needed = {
        *("coulomb_friction", "stribeck_friction", "presliding_friction", "pin_friction"),
        *("valve_deadband", "valve_null_bias", "valve_spool_lag", "valve_gain_nonlinearity"),
        *("internal_leakage", "external_leakage", "dead_volume", "entrained_air"),
        *("command_delay", "payload_change", "base_tilt", "encoder_offset"),
    }
    assert not needed & set(NOT_COMPENSATED)


@pytest.mark.parametrize("name", sorted(n for n, e in CATALOGUE.items() if targets(ROBOT, e)))
def test_any_effect_may_be_listed(name: str) -> None:
    effect = CATALOGUE[name]
    values = {
        spec.name: float(value)
        for spec, value in zip(effect.parameters, effect.typical, strict=True)
    }
    robot = with_effects(EffectSpec(name, "xs031", values))
    core, air = ControllerCore(robot, Gains()), ROBOT.atmospheric_pressure_pa
    p_a, p_b = pressures(ROBOT, POSE)
    for k in range(5):
        q = POSE + 1e-4 * k
        answer = core.answer(
            Sample(10**18 + k * 2_000_000, q, p_a + air, p_b + air, P_S + air, P_T + air)
        )
        assert answer is not None
        assert not answer.output.fault
    listed = core.law.plan
    assert (name in listed.names) != (name in listed.left_out)


def test_the_page_names_what_is_not_compensated() -> None:
    page = Path(__file__).parents[2] / "hydro_msgs_docs" / "method.md"
    text = page.read_text(encoding="utf-8")
    rows = [f"| `{name}` | {why} |" for name, why in NOT_COMPENSATED.items()]
    assert "\n".join(rows) in text


def test_without_a_compensated_effect_not_a_bit_changes() -> None:
    droop = listing("supply_droop", resistance=4e8, time_constant=0.1)
    robot = with_effects(droop)
    assert plan(robot).left_out.keys() == {"supply_droop"}
    path = load_path("xs031/parallelogram")
    assert isinstance(path, TipPath)
    start = np.array([0.73, -1.6])
    noise = np.random.default_rng(4).normal(size=(200, 2)) * 1e-5
    air, (p_a, p_b) = ROBOT.atmospheric_pressure_pa, pressures(ROBOT, start)

    def voltages(model: Robot) -> bytes:
        core, out = ControllerCore(model, Gains()), []
        assert core.law.compensation is None
        for k, e in enumerate(noise):
            sample = Sample(10**18 + k * 2_000_000, start + e, p_a + air, p_b + air, None, None)
            answer = core.answer(sample)
            assert answer is not None
            out.append(answer.output.voltage_v)
        return np.array(out).tobytes()

    assert voltages(robot) == voltages(ROBOT)


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (
            listing("coulomb_friction", force=3e3, velocity_scale=0.01),
            lambda v: 3e3 * np.tanh(v / 0.01),
        ),
        (
            listing("coulomb_friction", force=3e3, velocity_scale=1e-4),
            lambda v: 3e3 * np.tanh(v / SMALLEST_SCALE_M_S),
        ),
        (listing("quadratic_friction", coefficient=5e4), lambda v: 5e4 * v * np.abs(v)),
        (listing("constant_force_offset", force=-700.0), lambda v: -700.0 + 0.0 * v),
    ],
)
def test_friction_is_taken_at_the_required_velocity(effect: EffectSpec, expected) -> None:  # type: ignore[no-untyped-def]
    """The robot stands still: at the measured velocity the law would be zero."""
    output, plain = moving(with_effects(effect)), moving(ROBOT)
    np.testing.assert_allclose(
        output.required_force_n - plain.required_force_n,
        expected(output.required_piston_velocity_m_s),
        rtol=1e-9,
    )


def test_friction_of_pressures_and_pins_sees_the_sample() -> None:
    p_a, p_b = pressures(ROBOT, POSE)
    rubbing = with_effects(
        listing("pressure_dependent_friction", coefficient=2e-4, velocity_scale=0.01)
    )
    output, plain = moving(rubbing), moving(ROBOT)
    v = output.required_piston_velocity_m_s
    np.testing.assert_allclose(
        output.required_force_n - plain.required_force_n,
        2e-4 * (p_a + p_b) * np.tanh(v / 0.01),
        rtol=1e-9,
    )
    pins = with_effects(listing("pin_friction", radius=1.5e-3, velocity_scale=0.05))
    arm = np.array([float(lever(c, x)) for c, x in zip(ROBOT.cylinders, POSE, strict=True)])
    np.testing.assert_allclose(
        moving(pins).required_force_n - plain.required_force_n,
        1.5e-3 * np.abs(plain.force_n) / arm * np.tanh(QD / 0.05),
        rtol=1e-9,
    )


def test_a_bristle_ends_at_its_sliding_force_and_waits_at_rest() -> None:
    robot = with_effects(listing("presliding_friction", force=3e3, distance=1e-4))
    compensation = Compensation(robot, plan(robot).active, axes_of(robot), DT)

    def friction(velocity: float, steps: int) -> FloatArray:
        for _ in range(steps):
            motion = Motion(
                *(0.0, POSE, np.full(2, velocity), np.zeros(2), np.ones(2)),
                *(np.full(2, 0.3), np.zeros((2, 2)), P_S, P_T, np.zeros(2)),
            )
            compensation.observe(motion)
        return compensation.friction()

    np.testing.assert_allclose(friction(0.1, 100), 3e3, rtol=1e-3)
    np.testing.assert_allclose(friction(0.0, 100), 3e3, rtol=1e-3)
    np.testing.assert_allclose(friction(-0.1, 100), -3e3, rtol=1e-3)


FLUID = (
    listing("dead_volume", volume_a=1.2e-3, volume_b=0.8e-3),
    listing("entrained_air", fraction=0.01),
    listing("internal_leakage", coefficient=4e-12),
    listing("external_leakage", coefficient_a=2e-12, coefficient_b=3e-12),
)
VALVE = (
    listing("valve_deadband", width=0.012),
    listing("valve_null_bias", bias=-0.006),
    listing("valve_gain_nonlinearity", progression=0.2),
)


@pytest.mark.parametrize("effects", [FLUID, VALVE, (*FLUID, *VALVE)])
def test_the_voltage_keeps_the_force_while_the_piston_moves(
    effects: tuple[EffectSpec, ...],
) -> None:
    """The model's own right-hand side: with no change of force asked, none comes about."""
    robot = with_effects(*effects)
    output = moving(robot)
    p_a, p_b = pressures(ROBOT, POSE)
    u = output.voltage_v / np.array([v.rated_voltage_v for v in robot.valves])
    inputs = np.array([*u, P_S, P_T, 0.0, 0.0])
    state = np.concatenate([POSE, QD, p_a, p_b])
    rates = reference_rates(robot, resolve(robot), 0.0, inputs, state)
    plain_u = moving(ROBOT).voltage_v / 10.0
    plain = reference_rates(
        robot, resolve(robot), 0.0, np.array([*plain_u, P_S, P_T, 0.0, 0.0]), state
    )
    areas = np.array([(c.area_a_m2, -c.area_b_m2) for c in robot.cylinders])
    force_rate = (rates[4:].reshape(2, 2) * areas.T).sum(axis=0)
    missed = (plain[4:].reshape(2, 2) * areas.T).sum(axis=0)
    assert np.all(np.abs(force_rate) < 0.02 * np.abs(missed))
    assert np.all(np.abs(missed) > 2e3)


def test_looking_ahead_covers_delay_lag_hold_and_filter() -> None:
    spool = listing("valve_spool_lag", frequency=80.0, damping=0.8)
    robot = replace(with_effects(spool), command_delay_s=0.002)
    law = ControlLaw(robot, replace(UNFILTERED, alpha_fd=0.5))
    expected = 0.002 + 1.6 / (2.0 * np.pi * 80.0) + 0.5 * DT + 1.5 * DT
    assert law.lead_s == pytest.approx(expected, rel=1e-3)
    assert ControlLaw(replace(ROBOT, command_delay_s=0.002), Gains()).lead_s == 0.0
    late = with_effects(listing("command_delay", delay=0.006))
    assert ControlLaw(late, UNFILTERED).lead_s == pytest.approx(0.006 + DT)
    one = replace(ROBOT, effects=(EffectSpec("command_delay", "tilt_valve", {"delay": 0.009}),))
    assert ControlLaw(one, UNFILTERED).lead_s == pytest.approx(0.009 + DT)


def test_ahead_of_time_only_what_is_required_changes_not_what_is_published() -> None:
    robot = replace(with_effects(listing("command_delay", delay=0.006)))
    law = ControlLaw(robot, UNFILTERED)
    p_a, p_b = pressures(ROBOT, POSE)
    here = Reference("tip", np.asarray(tip_position(ROBOT, POSE + 0.001)), *[np.zeros(3)] * 2)
    speed = np.array([0.2, 0.0, 0.1])
    there = Reference("tip", here.position + law.lead_s * speed, speed, np.zeros(3))
    output = law.step(0.0, POSE, p_a, p_b, P_S, P_T, here, there)
    np.testing.assert_array_equal(output.tip_d_m, here.position)
    np.testing.assert_array_equal(output.qd_d, 0.0)
    np.testing.assert_allclose(output.q_d, POSE + 0.001, atol=1e-5)
    assert np.all(output.required_piston_velocity_m_s != 0.0)


def test_sensors_are_read_back() -> None:
    robot = with_effects(
        listing("encoder_offset", "lift", offset=0.02),
        listing("pressure_sensor_bias", "lift_cylinder/a", bias=1.5e5),
        listing("pressure_sensor_gain", "lift_cylinder/a", error=0.03),
        listing("pressure_sensor_gain", "tilt_cylinder/b", error=-0.01),
        listing("pressure_sensor_bias", "supply", bias=-2e5),
        listing("pressure_delay", "lift_cylinder/b", delay=0.004),
    )
    p_a, p_b = pressures(ROBOT, POSE)
    rows = [np.array([part] * 3) for part in (POSE, p_a, p_b, P_S, P_T, np.zeros(2))]
    shown = read_with(robot, Readings(DT, *rows, np.full_like(rows[0], np.nan)))
    air = robot.atmospheric_pressure_pa
    sample = Sample(
        *(0, shown.q[0], shown.p_a[0] + air, shown.p_b[0] + air),
        *(shown.supply[0] + air, shown.tank[0] + air),
    )
    true = SensorCorrection(robot, plan(robot).active).corrected(sample)
    assert true.p_s is not None
    np.testing.assert_allclose(true.q, POSE, rtol=1e-9)
    np.testing.assert_allclose(true.p_a, p_a + air, rtol=1e-9)
    np.testing.assert_allclose(true.p_b, p_b + air, rtol=1e-9)
    assert true.p_s == pytest.approx(P_S + air, rel=1e-9)
    law = ControlLaw(robot, UNFILTERED)
    assert law.compensation is not None
    assert law.compensation.force_lag_s[0] == pytest.approx(0.002)


def test_an_offset_encoder_is_held_where_it_really_is() -> None:
    core = ControllerCore(with_effects(listing("encoder_offset", "lift", offset=0.02)), Gains())
    air, (p_a, p_b) = ROBOT.atmospheric_pressure_pa, pressures(ROBOT, POSE)
    shown = POSE + np.array([0.02, 0.0])
    answer = core.answer(Sample(10**18, shown, p_a + air, p_b + air, None, None))
    assert answer is not None
    np.testing.assert_allclose(answer.reference.position, POSE, atol=1e-12)
    np.testing.assert_allclose(answer.output.voltage_v, 0.0, atol=0.05)
    np.testing.assert_allclose(answer.output.required_force_n, answer.output.force_n, rtol=1e-9)


def test_masses_and_tilt_are_the_models() -> None:
    """By virtual work: a kilogram at the tip asks for what its weight does."""
    loaded = moving(with_effects(listing("payload_change", mass=60.0)), 0.0 * QD)
    plain = moving(ROBOT, 0.0 * QD)
    h, rise = 1e-6, np.empty(2)
    for i in range(2):
        step = h * np.eye(2)[i]
        rise[i] = (tip_position(ROBOT, POSE + step)[2] - tip_position(ROBOT, POSE - step)[2]) / (
            2.0 * h
        )
    arm = np.array([float(lever(c, x)) for c, x in zip(ROBOT.cylinders, POSE, strict=True)])
    weight = 60.0 * np.linalg.norm(ROBOT.gravity_m_s2) * rise / arm
    np.testing.assert_allclose(loaded.required_force_n - plain.required_force_n, weight, rtol=1e-6)


@pytest.mark.thorough
def test_what_is_listed_is_not_estimated_again(
    slow_swing: Callable[[float, FloatArray], tuple[FloatArray, FloatArray, FloatArray]],
) -> None:
    """The machine of the adaptation's tests, in the model file already."""
    swing = np.array([0.25, 0.2])
    size, bias = np.array([3000.0, 4000.0]), np.array([0.006, -0.004])
    robot = with_effects(
        *(
            listing("coulomb_friction", c.name, force=f, velocity_scale=1e-3)
            for c, f in zip(ROBOT.cylinders, size, strict=True)
        ),
        *(
            listing("valve_null_bias", v.name, bias=b)
            for v, b in zip(ROBOT.valves, bias, strict=True)
        ),
    )
    knowing = Adaptation(ROBOT, AdaptationSettings(KINDS), DT, plan(robot).active)
    ignorant = Adaptation(ROBOT, AdaptationSettings(KINDS), DT)
    for k in range(10_000):
        q, p, voltage = _rubbing_sample(slow_swing(k * DT, swing), size, bias)
        for adaptation in (knowing, ignorant):
            adaptation.observe(q, p, P_S, P_T, voltage)
    estimated = dict(zip(knowing.names, knowing.estimates, strict=True))
    without = dict(zip(ignorant.names, ignorant.estimates, strict=True))
    for name, force in zip(("lift_cylinder", "tilt_cylinder"), size, strict=True):
        assert without[f"{name}.coulomb_friction_n"] == pytest.approx(force, rel=0.1)
        assert estimated[f"{name}.coulomb_friction_n"] < 0.06 * force
    for name, u in zip(("lift_valve", "tilt_valve"), bias, strict=True):
        assert without[f"{name}.null_bias"] == pytest.approx(u, abs=1e-3)
        assert abs(estimated[f"{name}.null_bias"]) < 5e-4


def _rubbing_sample(
    motion: tuple[FloatArray, FloatArray, FloatArray], size: FloatArray, bias: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    q, qd, qdd = motion
    torque, p_b = inverse_dynamics(ROBOT, q, qd, qdd), np.full(2, 8.0e6)
    p_a, voltage = np.empty(2), np.empty(2)
    for i, (c, valve) in enumerate(zip(ROBOT.cylinders, ROBOT.valves, strict=True)):
        arm, x = float(lever(c, q[i])), float(stroke(c, q[i]))
        xd = arm * qd[i]
        rubbing = size[i] * np.tanh(xd / 1e-3) + c.viscous_friction * xd
        p_a[i] = (torque[i] / arm + rubbing + p_b[i] * c.area_b_m2) / c.area_a_m2
        flow = -(c.area_a_m2 / x + c.area_b_m2 / (c.stroke_m - x)) * xd
        u = float(valve_signal(valve, c, flow, x, p_a[i], p_b[i], P_S, P_T)) - bias[i]
        voltage[i] = u * valve.rated_voltage_v
    return q, np.array([p_a, p_b]), voltage


def test_a_law_of_the_piston_position_sees_it_near_an_end_too() -> None:
    """Only the oil is counted on as softer there; the force was identified where the piston is."""
    near = np.array([0.6, -2.4])
    x = np.array([float(stroke(c, q)) for c, q in zip(ROBOT.cylinders, near, strict=True)])
    assert x[1] < 0.03 * ROBOT.cylinders[1].stroke_m
    sprung = with_effects(
        listing("counterbalance_spring", "tilt_cylinder", force=-2e3, stiffness=5e3)
    )
    p_a, p_b = pressures(ROBOT, near)

    def force(robot: Robot) -> FloatArray:
        reference = Reference("joint", near, np.zeros(2), np.zeros(2))
        law = ControlLaw(robot, UNFILTERED)
        return law.step(0.0, near, p_a, p_b, P_S, P_T, reference).required_force_n

    added = force(sprung) - force(ROBOT)
    np.testing.assert_allclose(added, [0.0, -2e3 + 5e3 * x[1]], atol=1e-6)


def test_laws_beside_which_is_estimated_see_the_piston_where_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    near, seen = np.array([0.6, -2.4]), []
    observe = Compensation.observe

    def noted(self: Compensation, motion: Motion) -> None:
        seen.append(motion.x)
        observe(self, motion)

    monkeypatch.setattr(Compensation, "observe", noted)
    robot = with_effects(
        listing("counterbalance_spring", "tilt_cylinder", force=-2e3, stiffness=5e3)
    )
    adaptation = Adaptation(ROBOT, AdaptationSettings(KINDS), DT, plan(robot).active)
    for _ in range(200):
        adaptation.observe(near, np.array(pressures(ROBOT, near)), P_S, P_T, np.zeros(2))
    x = [float(stroke(c, q)) for c, q in zip(ROBOT.cylinders, near, strict=True)]
    np.testing.assert_allclose(seen[-1], x, rtol=1e-6)
