"""The catalogue: laws against their equations, evaluation, and the robot's list resolved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lti, step

from hydro_model.effects import CATALOGUE, Effect, Stage
from hydro_model.effects import signals as sig
from hydro_model.effects.effect import CHANNELS
from hydro_model.errors import RobotError
from hydro_model.hydraulics.valve import edge_flows, signed_root
from hydro_model.robot import Valve
from hydro_model.robot_files import load_robot

#: Names beside the contract's.
EXTENSIONS = {"rotor_inertia", "load_dependent_friction"}
#: Every name of the contract, by family.
NAMES = {
    "force": """coulomb_friction stribeck_friction asymmetric_friction pressure_dependent_friction
        presliding_friction quadratic_friction position_dependent_friction temperature_drift
        pin_friction payload_change cylinder_inertia structural_flexibility backlash
        encoder_offset base_tilt pressure_sensor_bias pressure_sensor_gain constant_force_offset
        counterbalance_spring joint_coupling external_contact""",
    "flow": """valve_deadband valve_underlap valve_null_bias valve_gain_nonlinearity
        valve_spool_lag valve_rate_limit valve_hysteresis internal_leakage external_leakage
        dead_volume entrained_air cavitation supply_droop tank_back_pressure counterbalance_valve
        pressure_compensation end_cushion line_dynamics""",
    "timing": "pressure_delay command_delay",
}
EFFECTS = pytest.mark.parametrize("effect", CATALOGUE.values(), ids=lambda e: e.name)


def recording(count: int = 200) -> np.ndarray:
    """Random but physical signals."""
    rng = np.random.default_rng(3)
    s = rng.normal(size=(count, sig.SIGNAL_COUNT)) * 0.1
    s[:, sig.PRESSURE_A] = rng.uniform(0.0, 19e6, count)
    s[:, sig.PRESSURE_B] = rng.uniform(0.0, 19e6, count)
    s[:, sig.ATMOSPHERIC_PRESSURE] = 101325.0
    s[:, sig.SUPPLY_FLOW] = rng.uniform(0.0, 1e-3, count)
    s[:, sig.RETURN_FLOW] = rng.uniform(0.0, 1e-3, count)
    s[:, sig.SUPPLY_PRESSURE], s[:, sig.TANK_PRESSURE] = 19e6, 1e6
    s[:, sig.PISTON_POSITION] = rng.uniform(0.0, 0.59, count)
    s[:, sig.TRAVEL_LOW], s[:, sig.TRAVEL_HIGH] = 0.0, 0.59
    s[:, sig.LEVER] = rng.uniform(0.2, 0.4, count)
    s[:, sig.PISTON_FORCE] = rng.normal(size=count) * 3e4
    s[:, sig.AREA_A], s[:, sig.AREA_B] = 5.03e-3, 3.44e-3
    s[:, sig.EDGE_PA : sig.EDGE_BT + 1] = [9e-7, 8e-7, 7e-7, 6e-7]
    s[:, sig.VALVE_FLOW_A : sig.VALVE_FLOW_B + 1] *= 0.01
    s[:, sig.TIME] = np.arange(count) * 0.002
    return s


S = recording()
V, U = S[:, sig.PISTON_VELOCITY], S[:, sig.VALVE_SIGNAL]
X, LEVER, FORCE = S[:, sig.PISTON_POSITION], S[:, sig.LEVER], S[:, sig.PISTON_FORCE]
Q_A, Q_B = S[:, sig.VALVE_FLOW_A], S[:, sig.VALVE_FLOW_B]
P_A, P_B = S[:, sig.PRESSURE_A], S[:, sig.PRESSURE_B]
P_ABS = P_A + 101325.0

VALVE = Valve("spool", "ram", 10.0, c_pa=9e-7, c_at=8e-7, c_pb=7e-7, c_bt=6e-7)
#: Name, parameters, stage, what the equation of PHYSICS notes gives.
OPENED = np.clip((P_A + P_B - 2e7) / 4e6, 0.0, 1.0)


def in_series(first, second):
    """Share of an orifice's flow that another one in series with it lets pass."""
    first = np.maximum(first, 1e-12)
    with np.errstate(divide="ignore"):
        return np.sqrt(1.0 / (1.0 / first**2 + 1.0 / second**2)) / first


EQUATIONS = [
    ("coulomb_friction", [3e3, 0.01], Stage.FRICTION, 3e3 * np.tanh(V / 0.01)),
    (
        "stribeck_friction",
        [1e3, 0.02, 0.01, 1.5, 0.0],
        Stage.FRICTION,
        1e3 * np.exp(-((np.abs(V) / 0.02) ** 1.5)) * np.tanh(V / 0.01),
    ),
    (
        "asymmetric_friction",
        [500.0, 2e3, 0.01, 0.0],
        Stage.FRICTION,
        500.0 * np.tanh(V / 0.01) ** 2 + 2e3 * V * np.tanh(V / 0.01),
    ),
    (
        "pressure_dependent_friction",
        [2e-4, 0.01, 0.0],
        Stage.FRICTION,
        2e-4 * (P_A + P_B) * np.tanh(V / 0.01),
    ),
    ("quadratic_friction", [5e4], Stage.FRICTION, 5e4 * V * np.abs(V)),
    ("constant_force_offset", [-800.0], Stage.FRICTION, np.full(len(S), -800.0)),
    ("valve_null_bias", [0.02], Stage.SIGNAL, U + 0.02),
    (
        "valve_deadband",
        [0.05],
        Stage.SIGNAL,
        np.sign(U) * np.maximum(np.abs(U) - 0.05, 0.0),
    ),
    ("valve_gain_nonlinearity", [0.2, 0.0], Stage.SIGNAL, U * (1.0 + 0.2 * (np.abs(U) - 1.0))),
    (
        # Slopes of 1 and 1.5 (0.4) on either side of 0.3, over all that is opened at full signal.
        "valve_gain_nonlinearity",
        [0.5, 0.3],
        Stage.SIGNAL,
        np.interp(U, [-2.0, -0.3, 0.3, 2.0], [-2.85, -0.3, 0.3, 2.85]) / 1.35,
    ),
    (
        "valve_gain_nonlinearity",
        [-0.6, 0.3],
        Stage.SIGNAL,
        np.interp(U, [-2.0, -0.3, 0.3, 2.0], [-0.98, -0.3, 0.3, 0.98]) / 0.58,
    ),
    ("internal_leakage", [2e-13], Stage.FLOW_A, -2e-13 * (P_A - P_B)),
    ("internal_leakage", [2e-13], Stage.FLOW_B, 2e-13 * (P_A - P_B)),
    ("external_leakage", [2e-13, 3e-13], Stage.FLOW_A, -2e-13 * P_A),
    ("external_leakage", [2e-13, 3e-13], Stage.FLOW_B, -3e-13 * P_B),
    ("dead_volume", [1e-3, 2e-3], Stage.VOLUME_A, np.full(len(S), 1e-3)),
    ("dead_volume", [1e-3, 2e-3], Stage.VOLUME_B, np.full(len(S), 2e-3)),
    (
        "entrained_air",
        [0.01, 1.3],
        Stage.COMPLIANCE_A,
        0.01 / (1.3 * P_ABS) * (101325.0 / P_ABS) ** (1.0 / 1.3),
    ),
    (
        "position_dependent_friction",
        [1e3, 2e3, 4e3, 3e3, 5e3, 0.01, 0.0, 1.0],
        Stage.FRICTION,
        np.interp(X, np.linspace(0.0, 0.59, 5), [1e3, 2e3, 4e3, 3e3, 5e3]) * np.tanh(V / 0.01),
    ),
    (
        "position_dependent_friction",
        [1e3, 2e3, 4e3, 3e3, 5e3, 0.01, 0.3, 0.6],
        Stage.FRICTION,
        np.interp(X, np.linspace(0.177, 0.354, 5), [1e3, 2e3, 4e3, 3e3, 5e3]) * np.tanh(V / 0.01),
    ),
    (
        "pin_friction",
        [2e-3, 0.05, 0.0],
        Stage.FRICTION,
        2e-3 * np.abs(FORCE) / LEVER * np.tanh(S[:, sig.JOINT_VELOCITY] / 0.05),
    ),
    ("counterbalance_spring", [-2e3, 5e3, 0.0], Stage.FRICTION, -2e3 + 5e3 * X),
    (
        "counterbalance_spring",
        [-2e3, 5e3, 1.0],
        Stage.FRICTION,
        (-2e3 + 5e3 * S[:, sig.JOINT_POSITION]) / LEVER,
    ),
    (
        "external_contact",
        [1e5, 0.05, 0.0, 1.0, 0.0],
        Stage.FRICTION,
        -1e5 * np.maximum(0.05 - S[:, sig.TIP_HEIGHT], 0.0) * S[:, sig.TIP_SLOPE] / LEVER,
    ),
    (
        "external_contact",
        [2e4, 0.1, 1.0, 1.0, 0.0],
        Stage.FRICTION,
        -2e4 * np.maximum(0.1 - S[:, sig.JOINT_POSITION], 0.0) / LEVER,
    ),
    (
        "external_contact",
        [2e4, 0.1, -1.0, 1.0, 0.0],
        Stage.FRICTION,
        2e4 * np.maximum(0.1 + S[:, sig.JOINT_POSITION], 0.0) / LEVER,
    ),
    (
        "external_contact",
        [2e4, 0.1, -1.0, 1.5, 0.4],
        Stage.FRICTION,
        2e4
        / np.sqrt(0.1)
        * np.maximum(0.1 + S[:, sig.JOINT_POSITION], 0.0) ** 1.5
        * np.maximum(1.0 + 0.4 * S[:, sig.JOINT_VELOCITY], 0.0)
        / LEVER,
    ),
    (
        "valve_underlap",
        [0.05, 1.0],
        Stage.FLOW_A,
        edge_flows(VALVE, U + 0.05, P_A, P_B, 19e6, 1e6)[0] * (U > -0.05)
        + edge_flows(VALVE, U - 0.05, P_A, P_B, 19e6, 1e6)[0] * (U < 0.05)
        - edge_flows(VALVE, U, P_A, P_B, 19e6, 1e6)[0],
    ),
    (
        # Rounded edges: nothing beyond the width, inside it both open by what is missing to it.
        "valve_underlap",
        [0.05, 0.0],
        Stage.FLOW_B,
        np.maximum(0.05 - np.abs(U), 0.0)
        * (7e-7 * signed_root(19e6 - P_B) - 6e-7 * signed_root(P_B - 1e6)),
    ),
    (
        "pressure_compensation",
        [1.0, 7e5, 0.0],
        Stage.FLOW_B,
        np.maximum(-U, 0.0)
        * 7e-7
        * (signed_root(np.minimum(19e6 - P_B, 7e5)) - signed_root(19e6 - P_B)),
    ),
    (
        "pressure_compensation",
        [0.0, 7e5, 0.4],
        Stage.FLOW_A,
        np.maximum(-U, 0.0)
        * -0.4
        * 8e-7
        * (signed_root(np.minimum(P_A - 1e6, 7e5)) - signed_root(P_A - 1e6)),
    ),
    (
        "counterbalance_valve",
        [0.5, 2e7, 4e6, 1.0],
        Stage.FLOW_A,
        # Two orifices in series: their squared drops add.
        np.where(U < 0.0, np.maximum(-Q_A, 0.0) * (1.0 - in_series(-U, OPENED / 0.5)), 0.0),
    ),
    (
        "end_cushion",
        [0.8, 0.1],
        Stage.FLOW_B,
        0.8 * np.maximum(1.0 - (0.59 - X) / 0.1, 0.0) * np.maximum(-Q_B, 0.0),
    ),
]


@pytest.mark.parametrize(("name", "values", "stage", "expected"), EQUATIONS)
def test_law_is_its_equation(name, values, stage, expected) -> None:
    np.testing.assert_allclose(
        CATALOGUE[name].evaluate(S, values, stage, 0.002), expected, rtol=1e-12, atol=1e-18
    )


def test_catalogue_has_what_the_contract_names() -> None:
    assert all(name == effect.name for name, effect in CATALOGUE.items())
    assert set(CATALOGUE) >= EXTENSIONS
    for channel, names in NAMES.items():
        found = {effect.name for effect in CATALOGUE.values() if effect.channel == channel}
        assert found - EXTENSIONS == set(names.split())


@EFFECTS
def test_every_effect_is_described(effect: Effect) -> None:
    assert effect.channel in {"force", "flow", "timing"}
    for text in (effect.equation, effect.source, effect.separating_experiment):
        assert len(text) > 5
    assert effect.looks_like
    assert effect.terms or effect.change or effect.reading
    assert effect.channels
    assert set(effect.channels) <= set(CHANNELS)
    assert not effect.start or effect.change
    assert len(effect.states) <= sig.MAX_STATES
    for p in effect.parameters:
        assert p.unit
        assert p.text
        assert p.lower <= p.typical <= p.upper


@EFFECTS
def test_compiled_laws_equal_the_plain_ones(effect: Effect) -> None:
    for term in effect.terms:
        if effect.states:
            continue
        plain = [term.law(row, effect.typical) for row in S]
        np.testing.assert_allclose(
            effect.evaluate(S, effect.typical, term.stage), plain, rtol=1e-13
        )


@EFFECTS
def test_linear_parameters_are_columns(effect: Effect) -> None:
    """Superposition: the columns times the linear parameters are the law, states and all."""
    linear = list(effect.linear)
    for term in effect.terms:
        columns = effect.columns(S, effect.typical, term.stage, 0.002)
        assert columns.shape == (len(S), len(linear))
        if linear:
            law = effect.evaluate(S, effect.typical, term.stage, 0.002)
            np.testing.assert_allclose(
                columns @ effect.typical[linear], law, rtol=1e-9, atol=1e-9 * np.abs(law).max()
            )


def test_names_of_signals_follow_their_numbers() -> None:
    for index, name in enumerate(sig.SIGNAL_NAMES):
        assert getattr(sig, name.upper()) == index
    assert len(sig.SIGNAL_NAMES) == sig.SIGNAL_COUNT


def test_spool_lag_over_a_recording_is_the_second_order_response() -> None:
    s = np.zeros((200, sig.SIGNAL_COUNT))
    s[1:, sig.VALVE_SIGNAL] = 0.5
    out = CATALOGUE["valve_spool_lag"].evaluate(s, [80.0, 0.7], sample_time_s=0.002)
    omega = 2.0 * np.pi * 80.0
    system = lti([0.5 * omega**2], [1.0, 1.4 * omega, omega**2])
    _, expected = step(system, T=np.arange(199) * 0.002)
    np.testing.assert_allclose(out[1:], expected, atol=1e-5)


def test_droop_over_a_recording_follows_the_flow_with_its_lag() -> None:
    s = np.zeros((200, sig.SIGNAL_COUNT))
    s[1:, sig.SUPPLY_FLOW] = 1e-3
    out = CATALOGUE["supply_droop"].evaluate(s, [4e8, 0.05], sample_time_s=0.002)
    expected = -4e5 * (1.0 - np.exp(-np.arange(199) * 0.002 / 0.05))
    np.testing.assert_allclose(out[1:], expected, atol=1e-3)


def test_rate_limit_over_a_recording_has_its_slope() -> None:
    s = np.zeros((200, sig.SIGNAL_COUNT))
    s[1:, sig.VALVE_SIGNAL] = 1.0
    out = CATALOGUE["valve_rate_limit"].evaluate(s, [20.0, 5e-4], sample_time_s=0.002)
    assert np.diff(out[2:20]) == pytest.approx(0.04, rel=1e-6)
    assert out[-1] == pytest.approx(1.0)


def test_evaluation_of_states_starts_at_rest_and_keeps_the_input() -> None:
    s = np.full((10, sig.SIGNAL_COUNT), 0.3)
    kept = s.copy()
    lag = CATALOGUE["valve_spool_lag"]
    np.testing.assert_allclose(lag.evaluate(s, [80.0, 0.7], sample_time_s=0.002), 0.3)
    np.testing.assert_array_equal(s, kept)
    assert lag.evaluate(s[:0], [80.0, 0.7], sample_time_s=0.002).shape == (0,)
    with pytest.raises(RobotError, match="internal states: give sample_time_s"):
        lag.evaluate(s, [80.0, 0.7])


def test_wrong_shapes_and_stages_are_said() -> None:
    coulomb = CATALOGUE["coulomb_friction"]
    with pytest.raises(RobotError, match=r"signals of shape \(N, 38\), found \(5,\)"):
        coulomb.evaluate(np.zeros(5), [1.0, 1.0])
    with pytest.raises(RobotError, match="expected 2 parameters"):
        coulomb.evaluate(S, [1.0])
    with pytest.raises(RobotError, match="has no flow_a law"):
        coulomb.evaluate(S, [1.0, 1.0], Stage.FLOW_A)


ROBOT = load_robot("xs031")


@pytest.mark.parametrize(
    "name", ["stribeck_friction", "pressure_dependent_friction", "pin_friction"]
)
def test_a_bristle_turns_a_law_around_over_its_distance(name: str) -> None:
    """At a constant speed from rest, Dahl's bristle is bent by 1 - exp(-x / d)."""
    effect, speed, distance, period = CATALOGUE[name], 0.01, 2e-4, 1e-3
    at = [p.name for p in effect.parameters].index("distance")
    s = np.ones((200, sig.SIGNAL_COUNT))
    s[:, [sig.PISTON_VELOCITY, sig.JOINT_VELOCITY]] = speed
    bent, rounded = effect.typical.copy(), effect.typical.copy()
    bent[at], rounded[at] = distance, 0.0
    scale = [p.name for p in effect.parameters].index("velocity_scale")
    rounded[scale] = 1e-5  # Sharp: all of the law at this speed.
    whole = effect.evaluate(s, rounded, sample_time_s=period)
    np.testing.assert_allclose(whole, whole[0], rtol=1e-12)
    travel = np.arange(200) * period * speed
    expected = whole * (1.0 - np.exp(-travel / distance))
    np.testing.assert_allclose(
        effect.evaluate(s, bent, sample_time_s=period), expected, atol=2e-3 * whole[0]
    )


def test_a_state_that_no_law_looks_at_is_not_followed() -> None:
    """Bit for bit what it is with the state followed beside it, and no sample time is needed."""
    pins = CATALOGUE["pin_friction"]
    plain = pins.evaluate(S, [2e-3, 0.05, 0.0])
    always = replace(pins, states=tuple(replace(s, needs=None) for s in pins.states))
    np.testing.assert_array_equal(plain, always.evaluate(S, [2e-3, 0.05, 0.0], sample_time_s=0.01))
