"""The base model: conservation laws, closed forms, scipy, and its error messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, solve_ivp

from hydro_model.effects import CATALOGUE
from hydro_model.effects.targets import targets
from hydro_model.errors import RobotError, SimulationError
from hydro_model.hydraulics.cylinder import chamber_volumes, lever, stroke
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.multibody.rigid_body import inverse_dynamics, kinetic_energy, potential_energy
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot
from hydro_model.simulation.simulate import Model, Rollout, equilibrium_pressures, simulate
from hydro_model.simulation.simulate_reference import reference_rates

Q0 = np.array([0.8, -1.2])


def grid(duration: float, step: float = 0.002) -> np.ndarray:
    return np.arange(round(duration / step) + 1) * step


def crane(friction: float = 0.0) -> Robot:
    robot = load_robot("xs031")
    cylinders = tuple(replace(c, viscous_friction=friction) for c in robot.cylinders)
    return replace(robot, cylinders=cylinders)


def with_every_effect(robot: Robot) -> Robot:
    specs = (
        EffectSpec(e.name, robot.name, {p.name: p.typical for p in e.parameters})
        for e in CATALOGUE.values()
        if targets(robot, e)
    )
    return replace(robot, effects=tuple(specs))


@pytest.fixture(scope="module")
def free_crane() -> tuple[Robot, Rollout]:
    """The crane swinging on its closed cylinders without friction."""
    robot, times = crane(), grid(1.0, 0.001)
    p0 = np.add(equilibrium_pressures(robot, Q0), [[3e6, 0.0], [-2e6, 0.0]])
    return robot, simulate(robot, times, np.zeros((len(times), 2)), Q0, p0=p0, tolerance=1e-9)


def test_fluid_in_a_closed_chamber_is_conserved(free_crane) -> None:
    """Without flow ``pdot = -beta Vdot / V``, so ``p + beta ln V`` stays."""
    robot, run = free_crane
    for i, cylinder in enumerate(robot.cylinders):
        volumes = chamber_volumes(cylinder, stroke(cylinder, run.q[:, i]))
        for pressure, volume in zip((run.p_a[:, i], run.p_b[:, i]), volumes, strict=True):
            content = pressure + cylinder.bulk_modulus_pa * np.log(volume)
            assert np.ptp(pressure) > 1e4
            assert np.ptp(content) < 1.0


def test_energy_is_conserved_when_nothing_dissipates(free_crane) -> None:
    """Mechanical energy and the work done on closed chambers, ``-integral of p dV``."""
    robot, run = free_crane
    total = kinetic_energy(robot, run.q, run.qd) + potential_energy(robot, run.q)
    swing = np.ptp(kinetic_energy(robot, run.q, run.qd))
    for i, cylinder in enumerate(robot.cylinders):
        beta = cylinder.bulk_modulus_pa
        volumes = chamber_volumes(cylinder, stroke(cylinder, run.q[:, i]))
        for pressure, volume in zip((run.p_a[:, i], run.p_b[:, i]), volumes, strict=True):
            content = pressure[0] + beta * np.log(volume[0])
            total -= content * volume - beta * (volume * np.log(volume) - volume)
    assert swing > 1.0
    assert np.ptp(total) < 1e-5 * swing


def test_hydraulic_natural_frequency(make_slider) -> None:
    """Small motion about x0: ``w^2 = beta (A1 / x0 + A2 / (S - x0)) / m``."""
    robot, x0, amplitude = make_slider(), 0.25, 1e-5
    c = robot.cylinders[0]
    stiffness = c.bulk_modulus_pa * (c.area_a_m2 / x0 + c.area_b_m2 / (c.stroke_m - x0))
    omega = np.sqrt(stiffness / 1000.0)
    times = grid(0.5)
    p0 = equilibrium_pressures(robot, [x0])
    start = simulate(robot, times, np.zeros((len(times), 1)), [x0], [amplitude * omega], p0)
    expected = amplitude * np.sin(omega * times)
    np.testing.assert_allclose(start.q[:, 0] - x0, expected, atol=2e-3 * amplitude)


def test_chamber_content_grows_by_what_the_valve_lets_in(make_slider) -> None:
    robot, times = make_slider(viscous_friction=2e4), grid(0.4)
    run = simulate(robot, times, np.full((len(times), 1), 4.0), [0.1], tolerance=1e-9)
    c, v = robot.cylinders[0], robot.valves[0]
    flows = edge_flows(v, 0.4, run.p_a[:, 0], run.p_b[:, 0], 19e6, 1e6)
    volumes = chamber_volumes(c, run.q[:, 0])
    for p, volume, q in zip((run.p_a[:, 0], run.p_b[:, 0]), volumes, flows, strict=True):
        content = p / c.bulk_modulus_pa + np.log(volume)
        gained = cumulative_simpson(q / volume, x=times, initial=0.0)
        np.testing.assert_allclose(content - content[0], gained, atol=2e-5)
    assert run.q[-1, 0] > 0.15


def test_power_at_the_joint_becomes_mechanical_energy() -> None:
    robot, times = crane(40e3), grid(0.5, 0.001)
    volts = np.column_stack([np.sin(6.0 * times), -np.cos(5.0 * times)])
    run = simulate(robot, times, volts, Q0, tolerance=1e-9)
    speed = np.column_stack([lever(c, run.q[:, i]) for i, c in enumerate(robot.cylinders)])
    speed *= run.qd
    np.testing.assert_allclose(run.friction, 40e3 * speed, atol=1e-6)
    power = ((run.piston_force - run.friction) * speed).sum(axis=1)
    energy = kinetic_energy(robot, run.q, run.qd) + potential_energy(robot, run.q)
    work = cumulative_simpson(power, x=times, initial=0.0)
    np.testing.assert_allclose(energy - energy[0], work, atol=2e-3 * np.ptp(energy))


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_positive_voltage_extends_both_cylinders(direction) -> None:
    robot, times = crane(40e3), grid(0.5)
    run = simulate(robot, times, np.full((len(times), 2), direction), Q0)
    for i, cylinder in enumerate(robot.cylinders):
        moved = stroke(cylinder, run.q[-1, i]) - stroke(cylinder, Q0[i])
        assert np.sign(moved) == direction


def test_equilibrium_stays_at_rest() -> None:
    robot, times = crane(), grid(0.5)
    p0 = equilibrium_pressures(robot, Q0)
    np.testing.assert_allclose(p0.sum(axis=1), 20e6)
    run = simulate(robot, times, np.zeros((len(times), 2)), Q0)
    assert np.abs(run.qd).max() < 1e-9
    torque = inverse_dynamics(robot, Q0, np.zeros(2), np.zeros(2))
    levers = [float(lever(c, q)) for c, q in zip(robot.cylinders, Q0, strict=True)]
    np.testing.assert_allclose(run.piston_force[-1] * levers, torque, rtol=1e-9)


def test_load_too_heavy_for_the_supply_is_said(make_slider) -> None:
    with pytest.raises(SimulationError, match=r"'ram' cannot hold 98100 N.*supply at 1.9e\+07"):
        equilibrium_pressures(make_slider(mass_kg=10000.0, gravity=9.81), [0.3])


def test_compiled_rates_equal_the_reference() -> None:
    for robot in (crane(3e4), with_every_effect(crane(3e4))):
        model, rng = Model(robot), np.random.default_rng(7)
        for _ in range(20):
            inputs = model.inputs(rng.uniform(-0.5, 0.5, 2), 19e6, 1e6, rng.normal(size=2) * 1e3)
            p0 = rng.uniform(0.0, 20e6, (2, 2))
            state = model.rest(Q0 + rng.normal(size=2) * 0.2, rng.normal(size=2), p0, inputs)
            state[8:] *= rng.uniform(0.5, 1.5, len(state) - 8)
            ours = model.rates(0.3, state, inputs)
            theirs = reference_rates(model.robot, model.active, 0.3, inputs, state, robot)
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("dof", [1, 3, 6])
def test_contact_at_the_tip_of_any_chain_equals_the_reference(make_chain, dof) -> None:
    ground = EffectSpec("external_contact", f"chain{dof}", {"stiffness": 2e3, "height": 9.0})
    model = Model(replace(make_chain(4, dof, 0.4), effects=(ground,)))
    rng = np.random.default_rng(11)
    for _ in range(5):
        inputs = model.inputs([], 19e6, 1e6, rng.normal(size=dof))
        state = rng.normal(size=2 * dof)
        theirs = reference_rates(model.robot, model.active, 0.0, inputs, state)
        np.testing.assert_allclose(model.rates(0.0, state, inputs), theirs, rtol=1e-9, atol=1e-9)


def test_roll_out_agrees_with_scipy() -> None:
    """Radau with tight tolerances over the readable right-hand side, from step to step."""
    robot = with_every_effect(crane(3e4))
    prompt = [e for e in robot.effects if e.name != "command_delay"]
    robot = replace(robot, effects=tuple(prompt))
    times = grid(0.012, 0.006)
    # No signal rests on a law's corner (1 V is the knee's), where slopes are the integrator's.
    volts = np.array([[2.0, -1.4], [-0.3, 0.2], [0.0, 0.0]])
    run = simulate(robot, times, volts, Q0, tolerance=1e-9)
    model = Model(robot)
    rails = [19e6, 1e6]
    first = model.inputs(volts[0] / 10.0, *rails)
    p0 = equilibrium_pressures(model.robot, Q0)
    state = model.rest(Q0, np.zeros(2), p0, first)
    scale, laws = model.arrays.scale, model.active
    for k in range(len(times) - 1):
        inputs = model.inputs(volts[k] / 10.0, *rails)
        solved = solve_ivp(
            lambda t, z, u=inputs: (
                reference_rates(model.robot, laws, t, u, z * scale, robot) / scale
            ),
            (times[k], times[k + 1]),
            state / scale,
            method="Radau",
            rtol=1e-8,
            atol=1e-9,
        )
        state = solved.y[:, -1] * scale
    ours = np.concatenate([run.q[-1], run.qd[-1], run.p_a[-1], run.p_b[-1], run.effect_states[-1]])
    np.testing.assert_allclose(ours / scale, state / scale, atol=1e-6)


def test_tighter_tolerance_brings_the_roll_out_closer() -> None:
    robot, times = with_every_effect(crane(3e4)), grid(0.3)
    volts = 2.0 * np.sin(np.outer(times, [9.0, 7.0]))
    exact = simulate(robot, times, volts, Q0, tolerance=1e-11).p_a
    errors = [
        np.abs(simulate(robot, times, volts, Q0, tolerance=tol).p_a - exact).max()
        for tol in (1e-4, 1e-6, 1e-8)
    ]
    assert errors[0] > errors[1] > errors[2]
    assert errors[1] < 100.0


def test_command_delay_shifts_the_commands(make_slider) -> None:
    volts = np.zeros((101, 1))
    volts[20:60] = 3.0
    times = grid(0.2)
    late = simulate(make_slider(command_delay_s=0.004), times, volts, [0.2])
    shifted = np.vstack([np.zeros((2, 1)), volts[:-2]])
    now = simulate(make_slider(), times, shifted, [0.2])
    np.testing.assert_allclose(late.q, now.q, atol=1e-12)
    np.testing.assert_allclose(late.valve_signal, now.valve_signal)


def test_delay_by_a_part_of_a_sample(make_slider) -> None:
    volts = np.zeros((101, 1))
    volts[20:60] = 3.0
    late = simulate(make_slider(command_delay_s=0.001), grid(0.2), volts, [0.2])
    fine = np.vstack([np.zeros((1, 1)), np.repeat(volts, 2, axis=0)[:-2]])
    now = simulate(make_slider(), grid(0.2, 0.001), fine, [0.2])
    np.testing.assert_allclose(late.q, now.q[::2], atol=1e-9)


def test_a_command_that_acts_before_it_is_given_is_refused(make_slider) -> None:
    """Going back in time to it, a roll-out would never end."""
    with pytest.raises(SimulationError, match=r"command_delay_s of 0 or more, found -0\.01"):
        simulate(make_slider(command_delay_s=-0.01), grid(0.02), np.zeros((11, 1)), [0.3])


def test_measured_oil_temperature_is_what_friction_drifts_with(make_slider) -> None:
    drift = {"viscous": 2e4, "reference": 40.0, "halving_temperature": 17.5}
    robot = make_slider(viscous_friction=2e4, effects={"temperature_drift": drift})
    times = grid(0.3)
    volts, oil = np.full((len(times), 1), 4.0), np.where(times < 0.15, 57.5, 40.0)
    run = simulate(robot, times, volts, [0.1], oil_c=oil)
    halved = np.where(times < 0.15, 1e4, 2e4)
    np.testing.assert_allclose(run.friction[:, 0], halved * run.qd[:, 0], rtol=1e-9, atol=1e-6)
    warm = simulate(make_slider(viscous_friction=1e4), times, volts, [0.1])
    np.testing.assert_allclose(run.q[times < 0.15], warm.q[times < 0.15], atol=1e-7)
    assert abs(run.q[-1, 0] - warm.q[-1, 0]) > 1e-5


def test_voltage_is_limited_to_the_rated(make_slider) -> None:
    times = grid(0.05)
    beyond = simulate(make_slider(), times, np.full((len(times), 1), 25.0), [0.2])
    full = simulate(make_slider(), times, np.full((len(times), 1), 10.0), [0.2])
    np.testing.assert_array_equal(beyond.q, full.q)


def test_measured_rails_replace_constants_and_their_effects(make_slider) -> None:
    effects = {"supply_droop": {"resistance": 4e8, "time_constant": 0.05}}
    robot, times = make_slider(viscous_friction=2e4, effects=effects), grid(0.2)
    volts = np.full((len(times), 1), 5.0)
    p0 = equilibrium_pressures(robot, [0.1])
    drooping = simulate(robot, times, volts, [0.1], p0=p0)
    assert drooping.supply[-1] < 18.9e6
    rails = {"supply": drooping.supply, "tank": drooping.tank}
    measured = simulate(robot, times, volts, [0.1], p0=p0, **rails)
    np.testing.assert_array_equal(measured.supply, drooping.supply)
    assert measured.effect_states.shape == (len(times), 0)
    np.testing.assert_allclose(measured.q, drooping.q, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "values", "delay_s"),
    [
        ("valve_spool_lag", {"frequency": 8.0}, 0.0),
        ("valve_hysteresis", {"half_width": 0.05}, 0.0),
        ("supply_droop", {"resistance": 8e8, "time_constant": 0.3}, 0.0),
        ("structural_flexibility", {"inertia": 300.0, "frequency": 3.0, "damping": 0.3}, 0.0),
        ("", {}, 0.06),
    ],
)
def test_a_roll_out_remembers_what_came_before_its_start(
    make_slider, name, values, delay_s
) -> None:
    """Begun amid a motion it goes on as that did, where it is told what was before."""
    robot = make_slider(
        viscous_friction=2e4, command_delay_s=delay_s, effects={name: values} if name else {}
    )
    times, begin, lead = grid(2.0), 600, 600
    volts = 4.0 * np.sin(2.0 * np.pi * 1.7 * times)[:, None]
    whole = simulate(robot, times, volts, [0.3])
    seen = (whole.q, whole.qd, np.stack([whole.p_a, whole.p_b], axis=2))
    bare = simulate(robot, times[begin:], volts[begin:], *(s[begin] for s in seen))
    first = begin - lead
    told = simulate(robot, times[first:], volts[first:], *(s[first : begin + 1] for s in seen))
    errors = [np.abs(run.q - whole.q[-len(run.q) :]).max() for run in (bare, told)]
    assert errors[1] < 0.1 * errors[0], errors
    # What was told is what it says of the samples before.
    np.testing.assert_allclose(told.q[: lead + 1], whole.q[first : begin + 1], rtol=1e-12)


def test_joint_torque_pushes(make_slider) -> None:
    """A force on the closed cylinder moves it by force over stiffness, at rest in the end."""
    robot, times = make_slider(viscous_friction=1e5), grid(2.0)
    push = np.full((len(times), 1), 500.0)
    run = simulate(robot, times, np.zeros((len(times), 1)), [0.3], torque=push)
    c = robot.cylinders[0]
    stiffness = c.bulk_modulus_pa * (c.area_a_m2 + c.area_b_m2) / 0.3
    assert run.q[-1, 0] - 0.3 == pytest.approx(500.0 / stiffness, rel=1e-3)


def test_a_joint_without_a_cylinder_moves_by_its_torque(make_slider) -> None:
    robot = replace(make_slider(), cylinders=(), valves=())
    times = grid(0.5)
    push = np.full((len(times), 1), 500.0)
    run = simulate(robot, times, np.zeros((len(times), 0)), [0.1], torque=push)
    np.testing.assert_allclose(run.q[:, 0], 0.1 + 0.25 * times**2, atol=1e-9)
    assert run.piston_force.shape == (len(times), 0)


def test_rates_are_finite_below_vapour_pressure() -> None:
    model = Model(with_every_effect(crane(3e4)))
    inputs = model.inputs([0.2, -0.2], 19e6, 1e6)
    state = model.rest(Q0, np.zeros(2), np.full((2, 2), -5e6), inputs)
    assert np.all(np.isfinite(model.rates(0.0, state, inputs)))


def test_a_piston_that_leaves_its_stroke_is_named(make_slider) -> None:
    times = grid(3.0)
    with pytest.raises(SimulationError, match=r"slider.*t = 0\.\d+ s: 'ram' at 0\.6"):
        simulate(make_slider(viscous_friction=1e4), times, np.full((1501, 1), 10.0), [0.3])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"voltages": np.zeros((11, 2))},
            r"voltages .* shape \(11, 1\), found \(11, 2\)",
        ),
        ({"voltages": np.full((11, 1), np.nan)}, "voltages holds values that are not finite"),
        ({"time_s": np.zeros(11)}, "increasing"),
        ({"q0": [0.1, 0.2]}, r"q0 should have shape \(1,\)"),
        ({"p0": [1e6, 1e6]}, r"p0 should have shape \(1, 2\)"),
        ({"q0": np.full((12, 1), 0.3)}, r"q0 should have 1 to 11 rows.* found 12"),
        ({"q0": np.full((3, 1), 0.3)}, "p0 should be as well"),
        ({"supply": [1.0]}, r"supply should have shape \(11,\)"),
        ({"oil_c": np.full(11, np.nan)}, "oil_c holds values that are not finite"),
    ],
)
def test_bad_input_is_said(make_slider, change, message) -> None:
    given = {"time_s": grid(0.02), "voltages": np.zeros((11, 1)), "q0": [0.3]} | change
    with pytest.raises(SimulationError, match=message):
        simulate(make_slider(), **given)


def test_unknown_effect_is_said(make_slider) -> None:
    robot = make_slider(effects={"warp_drive": {}})
    with pytest.raises(RobotError, match="no effect 'warp_drive' in the catalogue"):
        simulate(robot, grid(0.02), np.zeros((11, 1)), [0.3])


def test_massless_robot_fails_plainly(make_slider) -> None:
    with pytest.raises(SimulationError, match="not finite, or a mass matrix"):
        simulate(make_slider(mass_kg=0.0), grid(0.02), np.zeros((11, 1)), [0.3])
