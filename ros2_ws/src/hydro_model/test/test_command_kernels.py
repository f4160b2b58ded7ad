"""What follows from the commands alone is integrated ahead of the model, and is the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import RK45, solve_ivp

from hydro_model.effects.law import Row, Stage, Term
from hydro_model.effects.signals import PRESSURE_A, VALVE_SIGNAL
from hydro_model.numerics.dormand_prince import BETWEEN
from hydro_model.robot import Robot
from hydro_model.simulation.simulate import Model, simulate
from hydro_model.simulation.simulate_arrays import model_arrays
from hydro_model.simulation.simulate_reference import reference_rates

QUICK = {
    "valve_rate_limit": {"rate": 20.0, "time_constant": 5e-4},
    "valve_spool_lag": {"frequency": 100.0, "damping": 0.8},
    "valve_hysteresis": {"half_width": 0.01, "time_constant": 5e-4},
    "valve_null_bias": {"bias": 0.01},
}


def _tight(robot: Robot, times: np.ndarray, volts: np.ndarray) -> np.ndarray:
    """Effect states by scipy over the readable right-hand side, from command to command."""
    model = Model(robot)
    start = simulate(robot, times[:1], volts[:1], [0.3])
    state = np.concatenate([start.q[0], start.qd[0], start.p_a[0], start.p_b[0]])
    state = np.concatenate([state, start.effect_states[0]])
    scale, out = model.arrays.scale, [start.effect_states[0]]
    for k in range(len(times) - 1):
        inputs = model.inputs(volts[k] / 10.0, start.supply[0], start.tank[0])
        solved = solve_ivp(
            lambda t, z, u=inputs: (
                reference_rates(model.robot, model.active, t, u, z * scale) / scale
            ),
            (times[k], times[k + 1]),
            state / scale,
            "LSODA",
            rtol=1e-10,
            atol=1e-11,
        )
        state = solved.y[:, -1] * scale
        out.append(state[4:])
    return np.array(out)


@pytest.mark.parametrize("step_s", [0.002, pytest.param(0.05, marks=pytest.mark.thorough)])
def test_states_of_valves_are_those_of_a_tight_solution(make_slider, step_s) -> None:
    robot = make_slider(viscous_friction=2e4, effects=QUICK)
    times = np.arange(9) * step_s
    volts = np.random.default_rng(5).uniform(-2.0, 2.0, (9, 1))
    run = simulate(robot, times, volts, [0.3])
    scale = Model(robot).arrays.scale[4:]
    exact = _tight(robot, times, volts)
    np.testing.assert_allclose(run.effect_states / scale, exact / scale, atol=1e-5)


def test_a_long_hold_is_looked_ahead_to_in_several_goes(make_slider) -> None:
    """The quickest spool allowed rings 1500 times in a second: more steps than are kept."""
    quickest = {"valve_spool_lag": {"frequency": 1500.0, "damping": 0.2}}
    robot = make_slider(viscous_friction=2e4, effects=quickest)
    run = simulate(robot, [0.0, 0.1], [[1.0], [1.0]], [0.3], p0=[[9e6, 9e6]])
    moved = simulate(robot, [0.0, 0.002, 0.1], [[0.0], [1.0], [1.0]], [0.3], p0=[[9e6, 9e6]])
    np.testing.assert_allclose(run.valve_signal[-1], 0.1, atol=1e-6)
    np.testing.assert_allclose(moved.valve_signal[-1], 0.1, atol=1e-6)


def test_quick_valves_do_not_shorten_the_steps_of_the_model(make_slider) -> None:
    times = np.arange(251) * 0.002
    volts = 2.0 * np.sin(9.0 * times)[:, None]
    plain, quick = (
        simulate(make_slider(viscous_friction=2e4, effects=effects), times, volts, [0.3])
        for effects in ({}, QUICK)
    )
    assert quick.steps < 2 * plain.steps


def test_a_valve_that_feels_pressure_is_no_matter_of_commands_alone(make_slider) -> None:
    def felt(s: Row, p: Row) -> float:
        return s[VALVE_SIGNAL] + 1e-9 * s[PRESSURE_A]

    robot = make_slider(effects=QUICK)
    active = Model(robot).active
    assert model_arrays(robot, active, robot).known.tolist() == [4, 5, 6, 7, 8]
    effect = replace(active[-1].effect, terms=(Term(Stage.SIGNAL, felt),))
    changed = (*active[:-1], replace(active[-1], effect=effect))
    arrays = model_arrays(robot, changed, robot)
    assert arrays.known.size == 0
    assert arrays.judged.size == arrays.scale.size


def test_polynomials_between_the_ends_are_the_formulas_own() -> None:
    """scipy has them as coefficients of the powers: those of the fourth are theirs alone."""
    np.testing.assert_allclose(BETWEEN, RK45.P[:, 3], rtol=1e-12)
