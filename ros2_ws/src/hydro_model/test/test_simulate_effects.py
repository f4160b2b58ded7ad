"""Each effect in a roll-out does what its equation says, on a slider with known answers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson
from scipy.signal import lti, step

from hydro_model.effects import CATALOGUE
from hydro_model.hydraulics.cylinder import chamber_volumes
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot import Robot
from hydro_model.simulation.simulate import Model, Rollout, equilibrium_pressures, simulate

VISCOUS = 2e4

#: Parameters that turn an effect off.
OFF: dict[str, dict[str, float]] = {
    "coulomb_friction": {"force": 0.0},
    "stribeck_friction": {"force": 0.0, "stribeck_velocity": 0.01},
    "asymmetric_friction": {"force": 0.0, "viscous": 0.0},
    "pressure_dependent_friction": {"coefficient": 0.0},
    "quadratic_friction": {"coefficient": 0.0},
    "constant_force_offset": {"force": 0.0},
    "valve_null_bias": {"bias": 0.0},
    "valve_deadband": {"width": 0.0},
    "valve_gain_nonlinearity": {"progression": 0.0},
    "internal_leakage": {"coefficient": 0.0},
    "external_leakage": {"coefficient_a": 0.0, "coefficient_b": 0.0},
    "dead_volume": {"volume_a": 0.0, "volume_b": 0.0},
    "entrained_air": {"fraction": 0.0},
    "supply_droop": {"resistance": 0.0, "time_constant": 0.1},
    "tank_back_pressure": {"resistance": 0.0},
    "presliding_friction": {"force": 0.0, "distance": 2e-4},
    "position_dependent_friction": dict.fromkeys(
        ("retracted", "quarter", "middle", "three_quarters", "extended"), 0.0
    ),
    "pin_friction": {"radius": 0.0},
    "temperature_drift": {"viscous": 0.0},
    "structural_flexibility": {"inertia": 0.0, "frequency": 5.0},
    "backlash": {"width": 0.0},
    "counterbalance_spring": {"force": 0.0, "stiffness": 0.0},
    "external_contact": {"stiffness": 0.0, "height": 1.0},
    "payload_change": {"mass": 0.0},
    "cylinder_inertia": {"barrel_mass": 0.0, "rod_mass": 0.0},
    "base_tilt": {"pitch": 0.0},
    "valve_underlap": {"width": 0.0},
    "pressure_compensation": {"share": 0.0, "margin": 7e5},
    "counterbalance_valve": {"restriction": 0.0, "setting": 0.0, "range": 1e5, "pilot_ratio": 0.0},
    "end_cushion": {"strength": 0.0, "length": 0.2},
    "cavitation": {"conductance": 0.0, "pressure": 1e5},
    "command_delay": {"delay": 0.0},
}
#: Effects of instruments act on no machine, whatever their size.
OFF |= {
    "encoder_offset": {"offset": 0.02},
    "pressure_sensor_bias": {"bias": 2e5},
    "pressure_sensor_gain": {"error": 0.02},
    "pressure_delay": {"delay": 0.01},
}


def run(robot: Robot, volts: float, duration: float = 1.0, x0: float = 0.1) -> Rollout:
    times = np.arange(round(duration / 0.002) + 1) * 0.002
    return simulate(robot, times, np.full((len(times), 1), volts), [x0])


def frequency(robot: Robot, x0: float, p0: np.ndarray) -> float:
    """Natural frequency of small motion in rad/s, from the linearised right-hand side."""
    model = Model(robot)
    inputs = model.inputs([0.0], 19e6, 1e6)
    state = model.rest([x0], [0.0], p0, inputs)
    moved = state.copy()
    moved[1] = 1e-3
    gradient = (model.rates(0.0, moved, inputs) - model.rates(0.0, state, inputs)) / 1e-3
    c = robot.cylinders[0]
    stiffness = -(gradient[2] * c.area_a_m2 - gradient[3] * c.area_b_m2)
    return float(np.sqrt(stiffness / robot.link_inertia[0, 0]))


@pytest.mark.parametrize("name", OFF)
def test_an_effect_of_size_zero_changes_nothing(make_slider, name) -> None:
    plain = run(make_slider(viscous_friction=VISCOUS), 3.0, 0.3)
    off = run(make_slider(viscous_friction=VISCOUS, effects={name: OFF[name]}), 3.0, 0.3)
    np.testing.assert_allclose(off.q, plain.q, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(off.p_a, plain.p_a, rtol=1e-6)


def test_every_effect_without_dynamics_of_its_own_can_be_off() -> None:
    dynamic = {"valve_spool_lag", "valve_rate_limit", "valve_hysteresis", "line_dynamics"}
    # Of a robot with more joints, or without cylinders.
    others = {"joint_coupling", "rotor_inertia", "load_dependent_friction"}
    assert set(OFF) == set(CATALOGUE) - dynamic - others


@pytest.mark.parametrize(
    ("name", "values", "size"),
    [
        ("coulomb_friction", {"force": 3e3}, lambda v, p: 3e3),
        ("asymmetric_friction", {"force": 700.0}, lambda v, p: 700.0),
        ("pressure_dependent_friction", {"coefficient": 2e-4}, lambda v, p: 2e-4 * p),
        ("quadratic_friction", {"coefficient": 5e4}, lambda v, p: 5e4 * v * v),
        ("constant_force_offset", {"force": -900.0}, lambda v, p: -900.0),
        (
            "stribeck_friction",
            {"force": 1e3, "stribeck_velocity": 0.2},
            lambda v, p: 1e3 * np.exp(-((v / 0.2) ** 2)),
        ),
        ("presliding_friction", {"force": 3e3, "distance": 2e-4}, lambda v, p: 3e3),
    ],
)
def test_friction_at_steady_speed(make_slider, name, values, size) -> None:
    """At constant speed the piston force is the viscous force and the effect's."""
    out = run(make_slider(viscous_friction=VISCOUS, effects={name: values}), 2.0)
    v = out.qd[-1, 0]
    assert v > 0.03
    load = out.p_a[-1, 0] + out.p_b[-1, 0]
    assert out.piston_force[-1, 0] == pytest.approx(VISCOUS * v + size(v, load), rel=2e-3)


def test_deadband_holds_small_commands_and_shifts_larger_ones(make_slider) -> None:
    banded = make_slider(viscous_friction=VISCOUS, effects={"valve_deadband": {"width": 0.01}})
    assert np.abs(run(banded, 0.09).qd).max() < 1e-9
    shifted = run(make_slider(viscous_friction=VISCOUS), 0.2)
    np.testing.assert_allclose(run(banded, 0.3).q, shifted.q, atol=1e-9)
    back = run(make_slider(viscous_friction=VISCOUS), -0.2)
    np.testing.assert_allclose(run(banded, -0.3).q, back.q, atol=1e-9)


def test_positive_null_bias_creeps_out_at_the_rate_of_its_signal(make_slider) -> None:
    biased = make_slider(viscous_friction=VISCOUS, effects={"valve_null_bias": {"bias": 0.005}})
    out = run(biased, 0.0, 4.0)
    q_a, _ = edge_flows(biased.valves[0], 0.005, out.p_a[-1], out.p_b[-1], 19e6, 1e6)
    assert out.qd[-1, 0] > 0.0
    assert out.qd[-1, 0] == pytest.approx(q_a[0] / biased.cylinders[0].area_a_m2, rel=1e-2)
    np.testing.assert_allclose(out.valve_signal, 0.005)


def test_bias_acts_before_the_deadband(make_slider) -> None:
    effects = {"valve_deadband": {"width": 0.01}, "valve_null_bias": {"bias": 0.005}}
    out = run(make_slider(viscous_friction=VISCOUS, effects=effects), 0.1, 0.01)
    np.testing.assert_allclose(out.valve_signal, 0.005)


def test_gain_nonlinearity_bends_the_opening(make_slider) -> None:
    bent = make_slider(effects={"valve_gain_nonlinearity": {"progression": 0.2}})
    assert run(bent, 5.0, 0.01).valve_signal[-1, 0] == pytest.approx(0.5 * (1.0 - 0.1))
    assert run(bent, -10.0, 0.01).valve_signal[-1, 0] == pytest.approx(-1.0)


def test_spool_follows_as_the_second_order_system(make_slider) -> None:
    lag = {"valve_spool_lag": {"frequency": 60.0, "damping": 0.7}}
    robot, times = make_slider(viscous_friction=VISCOUS, effects=lag), np.arange(101) * 0.002
    volts = np.zeros((101, 1))
    volts[10:] = 2.0
    out = simulate(robot, times, volts, [0.2], tolerance=1e-8)
    omega = 2.0 * np.pi * 60.0
    _, expected = step(lti([0.2 * omega**2], [1.0, 1.4 * omega, omega**2]), T=times[:91])
    np.testing.assert_allclose(out.valve_signal[10:, 0], expected, atol=1e-6)


def test_rate_limit_gives_its_slope(make_slider) -> None:
    robot = make_slider(viscous_friction=VISCOUS, effects={"valve_rate_limit": {"rate": 20.0}})
    times, volts = np.arange(51) * 0.002, np.full((51, 1), 8.0)
    volts[0] = 0.0
    opening = simulate(robot, times, volts, [0.2]).valve_signal[:, 0]
    np.testing.assert_allclose(np.diff(opening[1:18]), 0.04, rtol=1e-6)
    assert opening[-1] == pytest.approx(0.8, abs=1e-6)


def test_internal_leakage_equalises_with_its_time_constant(make_slider) -> None:
    """Piston held by a huge mass: ``tau = 1 / (beta c (1/V_a + 1/V_b))``."""
    coefficient = 4e-12
    robot = make_slider(mass_kg=1e15, effects={"internal_leakage": {"coefficient": coefficient}})
    times = np.arange(501) * 0.002
    out = simulate(robot, times, np.zeros((501, 1)), [0.2], p0=[[12e6, 4e6]])
    volume_a, volume_b = chamber_volumes(robot.cylinders[0], 0.2)
    rate = 1.2e9 * coefficient * (1.0 / volume_a + 1.0 / volume_b)
    np.testing.assert_allclose((out.p_a - out.p_b)[:, 0], 8e6 * np.exp(-rate * times), rtol=1e-5)
    content = out.p_a[:, 0] * volume_a + out.p_b[:, 0] * volume_b
    np.testing.assert_allclose(content, content[0], rtol=1e-6)


def test_external_leakage_empties_each_chamber(make_slider) -> None:
    leak = {"external_leakage": {"coefficient_a": 4e-12, "coefficient_b": 0.0}}
    robot, times = make_slider(mass_kg=1e15, effects=leak), np.arange(501) * 0.002
    out = simulate(robot, times, np.zeros((501, 1)), [0.2], p0=[[12e6, 4e6]])
    volume_a, _ = chamber_volumes(robot.cylinders[0], 0.2)
    expected = 12e6 * np.exp(-1.2e9 * 4e-12 / volume_a * times)
    np.testing.assert_allclose(out.p_a[:, 0], expected, rtol=1e-5)
    np.testing.assert_allclose(out.p_b[:, 0], 4e6, rtol=1e-6)


def test_dead_volume_lowers_the_natural_frequency(make_slider) -> None:
    dead = {"dead_volume": {"volume_a": 1e-3, "volume_b": 0.5e-3}}
    robot, x0 = make_slider(effects=dead), 0.2
    c = robot.cylinders[0]
    volume_a, volume_b = chamber_volumes(c, x0)
    soft_a, soft_b = c.area_a_m2**2 / (volume_a + 1e-3), c.area_b_m2**2 / (volume_b + 0.5e-3)
    expected = np.sqrt(c.bulk_modulus_pa * (soft_a + soft_b) / 1000.0)
    p0 = equilibrium_pressures(robot, [x0])
    assert frequency(robot, x0, p0) == pytest.approx(expected, rel=1e-9)
    assert expected < 0.8 * frequency(make_slider(), x0, p0)
    # The same frequency in a roll-out.
    times = np.arange(501) * 0.001
    out = simulate(robot, times, np.zeros((501, 1)), [x0], [1e-4], p0)
    motion = 1e-4 / expected * np.sin(expected * times)
    np.testing.assert_allclose(out.q[:, 0] - x0, motion, atol=5e-3 * 1e-4 / expected)


def test_air_softens_at_low_pressure_only(make_slider) -> None:
    """1 % of air more than halves the stiffness at 10 bar, and hardly shows at 150 bar."""
    airy, clean = make_slider(effects={"entrained_air": {"fraction": 0.01}}), make_slider()
    for pressure, low, high in ((1e6, 0.3, 0.7), (15e6, 0.97, 1.0)):
        p0 = np.full((1, 2), pressure)
        ratio = (frequency(airy, 0.3, p0) / frequency(clean, 0.3, p0)) ** 2
        assert low < ratio < high
        absolute = pressure + 101325.0
        air = 0.01 / (1.4 * absolute) * (101325.0 / absolute) ** (1.0 / 1.4)
        assert ratio == pytest.approx(1.0 / (1.0 + 1.2e9 * air), rel=1e-6)


def test_supply_droops_with_the_flow_and_its_lag(make_slider) -> None:
    droop = {"supply_droop": {"resistance": 4e8, "time_constant": 0.05}}
    robot = make_slider(viscous_friction=VISCOUS, effects=droop)
    out = run(robot, 4.0)
    valve = robot.valves[0]
    flow, _ = edge_flows(valve, 0.4, out.p_a, out.p_b, out.supply[:, None], out.tank[:, None])
    assert 19e6 - out.supply[-1] == pytest.approx(4e8 * flow[-1, 0], rel=1e-3)
    drop = 19e6 - out.supply
    # At the start the flow is that of the full supply.
    assert drop[0] == pytest.approx(4e8 * flow[0, 0], rel=3e-2)
    pulled = (4e8 * flow[:, 0] - drop) / 0.05
    expected = drop[0] + cumulative_simpson(pulled, x=out.time_s, initial=0.0)
    np.testing.assert_allclose(drop, expected, atol=5e-3 * np.ptp(drop))
    assert np.ptp(out.supply[:50]) > 1e4


def test_tank_pressure_rises_with_the_square_of_the_flow(make_slider) -> None:
    back = {"tank_back_pressure": {"resistance": 2e12}}
    robot = make_slider(viscous_friction=VISCOUS, effects=back)
    out = run(robot, 4.0)
    returned = out.qd[-1, 0] * robot.cylinders[0].area_b_m2
    assert out.tank[-1] - 1e6 == pytest.approx(2e12 * returned**2, rel=2e-2)
    assert out.tank[-1] > 1.1e6


def test_retracting_draws_from_the_supply_too(make_slider) -> None:
    droop = {"supply_droop": {"resistance": 4e8, "time_constant": 0.02}}
    robot = make_slider(viscous_friction=VISCOUS, effects=droop)
    out = run(robot, -4.0, x0=0.5)
    drawn = -out.qd[-1, 0] * robot.cylinders[0].area_b_m2
    assert drawn > 0.0
    assert 19e6 - out.supply[-1] == pytest.approx(4e8 * drawn, rel=2e-2)


def test_friction_as_sharp_as_allowed_takes_implicit_steps(make_slider) -> None:
    """3 kN within 10 um/s on a ton: rates of 3e5 1/s would hold explicit steps to 10 us."""
    sharp = {"coulomb_friction": {"force": 3e3, "velocity_scale": 1e-5}}
    robot, times = make_slider(viscous_friction=VISCOUS, effects=sharp), np.arange(251) * 0.004
    volts = np.where(times > 0.5, 0.0, 2.0)[:, None]
    out = simulate(robot, times, volts, [0.2])
    exact = simulate(robot, times, volts, [0.2], tolerance=1e-9)
    assert out.steps < 5000
    np.testing.assert_allclose(out.q, exact.q, atol=1e-5)
