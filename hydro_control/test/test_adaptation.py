"""Online adaptation: known parameters found, bounds, freezing, no jumps, the seam to the law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_control.adaptation.adaptation import Adaptation
from hydro_control.adaptation.adaptation_model import unit_payload
from hydro_control.adaptation.adaptation_settings import KINDS, AdaptationSettings, kinds_of
from hydro_control.adaptation.bounded_estimator import BoundedEstimator, Prior
from hydro_control.core.core import ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.law.law import ControlLaw
from hydro_control.motion.required_motion import Reference
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.hydraulics.valve import valve_signal
from hydro_model.multibody.kinematics import tip_jacobian, tip_jacobian_rate
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
DT = 0.002
P_S, P_T = 19.0e6, 1.0e6
ALL = AdaptationSettings(KINDS)
PAYLOAD_KG = 50.0
COULOMB_N = np.array([3000.0, 4000.0])
VISCOUS = np.array([5.0e3, -2.0e3])
NULL_BIAS = np.array([0.006, -0.004])


def motion(t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Slow sums of sines: positions, velocities, accelerations."""
    mean, size = np.array([0.5, -1.4]), np.array([[0.25, 0.05], [0.2, 0.06]])
    rate = 2.0 * np.pi * np.array([[0.1, 0.31], [0.13, 0.37]])
    phase = rate * t + np.array([[0.0, 1.0], [2.0, 0.5]])
    q = mean + (size * np.sin(phase)).sum(axis=1)
    qd = (size * rate * np.cos(phase)).sum(axis=1)
    qdd = -(size * rate**2 * np.sin(phase)).sum(axis=1)
    return q, qd, qdd


def sample(t: float, payload_kg: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, pressures (2, m) and valve voltages of a machine with the values above.

    The payload's torque is by virtual work, ``J^T m (a - g)``: not by the code under test.
    """
    q, qd, qdd = motion(t)
    jacobian = tip_jacobian(ROBOT, q)
    tip = jacobian @ qdd + tip_jacobian_rate(ROBOT, q, qd) @ qd
    torque = inverse_dynamics(ROBOT, q, qd, qdd)
    torque = torque + payload_kg * jacobian.T @ (tip - ROBOT.gravity_m_s2)
    p_b = np.full(2, 8.0e6)
    p_a, voltage = np.empty(2), np.empty(2)
    for i, (c, valve) in enumerate(zip(ROBOT.cylinders, ROBOT.valves, strict=True)):
        arm = float(lever(c, q[i]))
        xd = arm * qd[i]
        rubbing = COULOMB_N[i] * np.tanh(xd / 1e-3) + (c.viscous_friction + VISCOUS[i]) * xd
        p_a[i] = (torque[i] / arm + rubbing + p_b[i] * c.area_b_m2) / c.area_a_m2
        x = float(stroke(c, q[i]))
        flow = -(c.area_a_m2 / x + c.area_b_m2 / (c.stroke_m - x)) * xd
        u = float(valve_signal(valve, c, flow, x, p_a[i], p_b[i], P_S, P_T)) - NULL_BIAS[i]
        voltage[i] = u * valve.rated_voltage_v
    return q, np.array([p_a, p_b]), voltage


def fed(adaptation: Adaptation, start_s: float, end_s: float, payload_kg: float) -> FloatArray:
    """What the law would use at each sample, (N, k)."""
    used = []
    for k in range(round(start_s / DT), round(end_s / DT)):
        q, pressures, voltage = sample(k * DT, payload_kg)
        adaptation.observe(q, pressures, P_S, P_T, voltage)
        used.append(adaptation.used)
    return np.array(used)


@pytest.fixture(scope="module")
def runs() -> tuple[Adaptation, FloatArray, FloatArray]:
    """Estimator after 10 s without and 10 s with the payload, and what it gave the law."""
    adaptation = Adaptation(ROBOT, ALL, DT)
    return adaptation, fed(adaptation, 0.0, 10.0, 0.0), fed(adaptation, 10.0, 20.0, PAYLOAD_KG)


def test_column_of_the_payload_is_virtual_work_at_the_tip() -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        q = random.uniform([0.0, -2.0], [1.0, -0.5])
        qd, qdd = random.normal(size=(2, 2))
        jacobian = tip_jacobian(ROBOT, q)
        acceleration = jacobian @ qdd + tip_jacobian_rate(ROBOT, q, qd) @ qd
        expected = jacobian.T @ (acceleration - ROBOT.gravity_m_s2)
        np.testing.assert_allclose(
            inverse_dynamics(unit_payload(ROBOT), q, qd, qdd), expected, atol=1e-10
        )


def test_finds_payload_friction_and_null_bias(
    runs: tuple[Adaptation, FloatArray, FloatArray],
) -> None:
    adaptation, before, after = runs
    assert before[-1][0] == pytest.approx(0.0, abs=3.0)
    assert after[-1][0] == pytest.approx(PAYLOAD_KG, abs=3.0)
    np.testing.assert_allclose(adaptation.used[1:3], COULOMB_N, atol=300.0)
    # Within the dead zone viscous and Coulomb friction stand for each other; the sum counts.
    for speed in (0.02, 0.05, 0.08):
        friction = adaptation.used[1:3] + adaptation.used[3:5] * speed
        expected = COULOMB_N + VISCOUS * speed
        np.testing.assert_allclose(friction, expected, atol=2.0 * ALL.dead_zone_n)
    np.testing.assert_allclose(adaptation.null_bias, NULL_BIAS, atol=1e-3)
    # From the instant on it takes less than 2 s.
    assert np.all(np.abs(after[1000:, 0] - PAYLOAD_KG) < 10.0)


def test_what_the_law_uses_moves_at_a_limited_rate_within_bounds(
    runs: tuple[Adaptation, FloatArray, FloatArray],
) -> None:
    _, before, after = runs
    used = np.concatenate([before, after])
    largest = np.array([100.0, 8e3, 8e3, 2e4, 2e4, 0.02, 0.02])
    assert np.all(np.abs(np.diff(used, axis=0)) <= largest * DT / ALL.ramp_s * (1.0 + 1e-9))
    assert np.all(np.abs(used) <= largest)
    assert used[:, 1:3].min() >= 0.0


def test_a_load_beyond_the_bound_stays_at_the_bound() -> None:
    adaptation = Adaptation(ROBOT, replace(ALL, payload_kg=20.0), DT)
    used = fed(adaptation, 0.0, 6.0, PAYLOAD_KG)
    assert used[:, 0].max() == 20.0
    assert "payload_kg" in str(adaptation.report()["adaptation_at_bound"]).split()
    # And leaves it once the load is gone.
    assert fed(adaptation, 6.0, 12.0, 0.0)[-1][0] < 8.0


def test_standing_still_changes_nothing_whatever_the_force(
    runs: tuple[Adaptation, FloatArray, FloatArray],
) -> None:
    moved = runs[0]
    q, pressures, _ = sample(20.0, PAYLOAD_KG)
    estimates, covariance, used = moved.estimates, moved._force.covariance.copy(), moved.used
    noise = np.random.default_rng(2)
    # 20 bar more than the pose needs: stiction may hold that.
    pushed = np.array([[2e6], [0.0]])
    moved.forget()
    for _ in range(3000):
        shaken = q + noise.normal(scale=3e-6, size=2)
        moved.observe(shaken, pressures + pushed, P_S, P_T, np.array([0.2, -0.2]))
    assert moved.frozen
    np.testing.assert_array_equal(moved.estimates, estimates)
    np.testing.assert_array_equal(moved._force.covariance, covariance)
    np.testing.assert_allclose(moved.used, used, atol=1e-3)


def test_only_what_is_chosen_is_used() -> None:
    adaptation = Adaptation(ROBOT, AdaptationSettings(("friction",)), DT)
    fed(adaptation, 0.0, 5.0, PAYLOAD_KG)
    assert adaptation.estimates[0] > 20.0
    assert not np.any(adaptation.used[[0, 5, 6]])
    assert np.all(adaptation.used[1:3] > 1000.0)


def test_a_gap_keeps_the_estimates_and_a_reset_drops_them() -> None:
    adaptation = Adaptation(ROBOT, ALL, DT)
    fed(adaptation, 0.0, 4.0, PAYLOAD_KG)
    estimates, used = adaptation.estimates, adaptation.used
    adaptation.forget()
    np.testing.assert_array_equal(adaptation.estimates, estimates)
    adaptation.reset(used=False)
    assert not np.any(adaptation.estimates)
    np.testing.assert_array_equal(adaptation.used, used)
    adaptation.reset()
    assert not np.any(adaptation.used)


@pytest.mark.parametrize(
    "settings",
    [
        {"kinds": ("payload", "payload")},
        {"kinds": ("mass",)},
        {"payload_kg": 0.0},
        {"ramp_s": float("nan")},
        {"dead_zone_n": -1.0},
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ControlError, match="adaptation"):
        AdaptationSettings(**settings)  # type: ignore[arg-type]


def test_words_of_the_parameter() -> None:
    assert kinds_of(" payload, friction null_bias ") == KINDS
    assert not AdaptationSettings(kinds_of("")).on


PRIORS = (Prior(-10.0, 10.0, 0.0, 5.0, 0.1), Prior(-1.0, 1.0, 0.5, 1.0, 0.1))


def test_estimator_solves_exact_equations() -> None:
    estimator = BoundedEstimator(PRIORS)
    random, truth = np.random.default_rng(4), np.array([3.0, -0.4])
    for _ in range(500):
        rows = random.normal(size=(2, 2))
        estimator.update(rows, rows @ truth, 1e-6, 0.0, 0.01)
    np.testing.assert_allclose(estimator.value, truth, atol=1e-6)
    assert estimator.updates == 500


def test_estimator_forgets_nothing_without_equations_and_never_winds_up() -> None:
    estimator = BoundedEstimator(PRIORS)
    value, covariance = estimator.value.copy(), estimator.covariance.copy()
    estimator.update(np.zeros((0, 2)), np.zeros(0), 1.0, 0.0, 0.01)
    np.testing.assert_array_equal(estimator.value, value)
    np.testing.assert_array_equal(estimator.covariance, covariance)
    # One direction only, for long: the other's uncertainty stays at the prior's.
    for _ in range(20000):
        estimator.update(np.array([[1.0, 0.0]]), np.array([2.0]), 1.0, 0.0, 0.01)
    assert np.all(estimator.std <= [5.0 + 1e-9, 1.0 + 1e-9])
    assert np.all(np.linalg.eigvalsh(estimator.covariance) > 0.0)
    assert estimator.value[1] == 0.5


def test_estimator_stays_in_its_box_and_its_dead_zone() -> None:
    estimator = BoundedEstimator(PRIORS)
    row = np.array([[1.0, 0.0]])
    estimator.update(row, np.array([1.9]), 1e-6, 2.0, 0.01)
    assert estimator.value[0] == 0.0
    for _ in range(100):
        estimator.update(row, np.array([1e3]), 1e-3, 2.0, 0.01)
    assert estimator.value[0] == 10.0


POSE = np.array([0.6, -1.5])
AIR = ROBOT.atmospheric_pressure_pa


def core_sample(k: int) -> Sample:
    q, pressures, _ = sample(k * DT, PAYLOAD_KG)
    p_a, p_b = pressures + AIR
    return Sample(10**18 + k * 2_000_000, q, p_a, p_b, P_S + AIR, P_T + AIR)


def voltages(core: ControllerCore, samples: int) -> FloatArray:
    out = []
    for k in range(samples):
        answer = core.answer(core_sample(k))
        assert answer is not None
        out.append(answer.output.voltage_v)
    return np.array(out)


def test_off_is_the_law_without_adaptation() -> None:
    off = ControllerCore(ROBOT, Gains(), adaptation=AdaptationSettings())
    assert off.law.adaptation is None
    with pytest.raises(ControlError, match="adaptation is off"):
        off.request_adaptation_reset()
    np.testing.assert_array_equal(
        voltages(off, 200), voltages(ControllerCore(ROBOT, Gains()), 200)
    )


def test_same_samples_same_answers_and_activation_starts_anew() -> None:
    core = ControllerCore(ROBOT, Gains(), adaptation=ALL)
    first = voltages(core, 800)
    assert core.law.adaptation is not None
    assert core.law.adaptation.used[0] > 0.0
    core.restart()
    assert not np.any(core.law.adaptation.used)
    np.testing.assert_array_equal(voltages(core, 800), first)
    core.request_adaptation_reset()
    core.answer(core_sample(800))
    assert core.law.adaptation._force.updates == 0
    assert core.law.adaptation.used[0] > 0.0


def test_a_reset_asked_for_during_one_is_made_with_the_next_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its answer has said that the estimates start anew."""
    core = ControllerCore(ROBOT, Gains(), adaptation=ALL)
    voltages(core, 10)
    adaptation = core.law.adaptation
    assert adaptation is not None
    reset, resets = adaptation.reset, list[bool]()

    def resetting(*, used: bool = True) -> None:
        if not resets:
            core.request_adaptation_reset()
        resets.append(used)
        reset(used=used)

    monkeypatch.setattr(adaptation, "reset", resetting)
    core.request_adaptation_reset()
    for k in range(10, 13):
        core.answer(core_sample(k))
    assert resets == [False, False]


def test_the_law_adds_the_load_and_takes_off_the_bias() -> None:
    """Each value by itself, set by hand, against what it must do to the answer."""
    reference = Reference("joint", POSE, np.array([0.1, -0.1]), np.zeros(2))

    def step(used: FloatArray) -> tuple[FloatArray, FloatArray]:
        law = ControlLaw(ROBOT, replace(Gains(), k_p_1_s=0.0), adaptation=ALL)
        assert law.adaptation is not None
        law.adaptation.used = used
        p = np.full(2, 8e6)
        output = law.step(0.0, POSE, p, p, P_S, P_T, reference)
        return output.required_force_n, output.valve_signal

    nothing = step(np.zeros(7))
    loaded = step(np.array([50.0, 0, 0, 0, 0, 0, 0]))
    arm = [float(lever(c, q)) for c, q in zip(ROBOT.cylinders, POSE, strict=True)]
    jacobian = tip_jacobian(ROBOT, POSE)
    weight = -50.0 * jacobian.T @ ROBOT.gravity_m_s2 / arm
    # The rest is centripetal.
    np.testing.assert_allclose(loaded[0] - nothing[0], weight, rtol=0.02)
    rubbing = step(np.array([0, 3e3, 0, 0, 1e4, 0, 0]))
    xd_r = arm * np.array([0.1, -0.1])
    expected = [3e3 * np.tanh(xd_r[0] / 0.02), 1e4 * xd_r[1]]
    np.testing.assert_allclose(rubbing[0] - nothing[0], expected, rtol=1e-6)
    biased = step(np.array([0, 0, 0, 0, 0, 0.01, -0.005]))
    np.testing.assert_allclose(biased[1] - nothing[1], [-0.01, 0.005], atol=1e-12)


def test_report_names_every_value_in_text() -> None:
    adaptation = Adaptation(ROBOT, ALL, DT)
    report = adaptation.report()
    assert report["adaptation"] == "payload friction null_bias"
    assert report["adaptation_frozen"] == "yes"
    for name in (
        "payload_kg",
        "lift_cylinder.coulomb_friction_n",
        "tilt_cylinder.viscous_friction_change",
        "tilt_valve.null_bias",
    ):
        for kind in ("adapted", "estimate", "std"):
            float(str(report[f"{kind}/{name}"]))
