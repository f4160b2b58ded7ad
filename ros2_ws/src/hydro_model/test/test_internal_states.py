"""Effects with internal states along a recording, against scipy and in gaps."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

from hydro_model.effects import CATALOGUE, Effect
from hydro_model.effects import signals as sig
from hydro_model.effects.compiled import evaluate_law, signals_read
from hydro_model.effects.internal_states import HELD_SIGNALS
from hydro_model.effects.valve_effects import TRAVEL
from hydro_model.robot import FloatArray

STEP_S = 0.002
#: By their rates alone, as a roll-out has them, also where a recording tells more.
DYNAMIC = [replace(effect, known_states=None) for effect in CATALOGUE.values() if effect.states]
#: Size of what the signals do, by index; all others are 1.
SIZES = {
    sig.PISTON_VELOCITY: 0.15,
    sig.JOINT_VELOCITY: 0.3,
    sig.OTHER_VELOCITY: 0.3,
    sig.PISTON_FORCE: 2e4,
    sig.VALVE_SIGNAL: 0.3,
    sig.VALVE_FLOW_A: 2e-4,
    sig.VALVE_FLOW_B: 1e-4,
    sig.SUPPLY_FLOW: 2e-4,
    sig.RETURN_FLOW: 1e-4,
    sig.PRESSURE_A: 2e5,
    sig.PRESSURE_B: 2e5,
}


def recording(count: int) -> FloatArray:
    """Rows of smooth motion with reversals; what is held moves in steps."""
    rng = np.random.default_rng(5)
    times = np.arange(count) * STEP_S
    rows = np.ones((count, sig.SIGNAL_COUNT))
    rows[:, sig.TIME] = times
    rows[:, [sig.OTHER_ACCELERATION, sig.PISTON_ACCELERATION]] = np.nan
    rows[:, sig.ATMOSPHERIC_PRESSURE] = 1e5
    for index, size in SIZES.items():
        phases, rates = rng.uniform(0.0, 6.3, 3), (9.0, 31.0, 70.0)
        waves = [np.sin(w * times + phase) for w, phase in zip(rates, phases, strict=True)]
        rows[:, index] = size * (waves[0] + 0.5 * waves[1] + 0.2 * waves[2])
    return rows


def exact(effect: Effect, rows: FloatArray, parameters: FloatArray) -> FloatArray:
    """The first law with its states integrated by scipy from sample to sample."""
    own = slice(sig.STATE_0, sig.STATE_0 + len(effect.states))
    moving = np.ones(sig.SIGNAL_COUNT, dtype=bool)
    moving[list(HELD_SIGNALS)] = False
    moving[sig.STATE_0 : sig.STATE_0 + sig.MAX_STATES] = False
    values = np.empty(len(rows))
    state = np.empty(len(effect.states))
    averaged = all(one.averaged for one in effect.states)
    parts = np.linspace(0.0, 1.0, 2001 if averaged else 2)
    for k, sample in enumerate(rows):
        row = sample.copy()
        if k == 0:
            for i, one in enumerate(effect.states):
                state[i] = row[sig.STATE_0 + i] = one.initial(row, parameters)
        row[own] = state
        values[k] = effect.term().law(row, parameters)
        last = k + 1 == len(rows)
        if last and not averaged:
            break
        slope = np.where(moving, 0.0 if last else rows[k + 1] - sample, 0.0)

        def rates(part: float, y: FloatArray, start=sample, slope=slope) -> FloatArray:
            now = start + part * slope
            now[own] = y
            return STEP_S * np.array([one.rate(now, parameters) for one in effect.states])

        size = np.maximum(np.abs(state), 1e-12)
        solved = solve_ivp(
            rates, (0.0, 1.0), state, "LSODA", parts, rtol=1e-7, atol=1e-7 * size, max_step=0.25
        )
        state = solved.y[:, -1]
        if averaged:
            row[own] = trapezoid(solved.y, parts)
            values[k] = effect.term().law(row, parameters)
    return values


def corners(effect: Effect) -> list[FloatArray]:
    """Typical parameters, and bounds of what sets how fast the states are."""
    fast = {"frequency", "inertance", "damping", "distance", "time_constant", "rate", "half_width"}
    choices = [
        sorted({one.lower, one.upper}) if one.name in fast else [one.typical]
        for one in effect.parameters
    ]
    return [effect.typical, *(np.array(values) for values in itertools.product(*choices))]


@pytest.mark.parametrize("effect", DYNAMIC, ids=lambda effect: effect.name)
def test_states_agree_with_scipy_over_the_bounds_of_the_parameters(effect) -> None:
    rows = recording(120)
    for parameters in corners(effect):
        ours = effect.evaluate(rows, parameters, sample_time_s=STEP_S)
        theirs = exact(effect, rows, parameters)
        np.testing.assert_allclose(
            ours, theirs, rtol=0.0, atol=1e-3 * np.ptp(theirs), err_msg=f"{parameters}"
        )


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=lambda effect: effect.name)
def test_the_signals_that_a_law_names_are_all_it_looks_at(effect) -> None:
    rows = recording(20)
    laws = [term.law for term in effect.terms]
    laws += [law for state in effect.states for law in (state.rate, state.initial)]
    for law in laws:
        blind = np.full_like(rows, np.nan)
        seen = list(signals_read(law))
        blind[:, seen] = rows[:, seen]
        expected = evaluate_law(law, rows, effect.typical)
        np.testing.assert_array_equal(evaluate_law(law, blind, effect.typical), expected)


def test_a_gap_leaves_the_states_as_they_were() -> None:
    effect, rows = CATALOGUE["presliding_friction"], recording(200)
    whole = effect.evaluate(rows, effect.typical, sample_time_s=STEP_S)
    rows[80:100, sig.PISTON_VELOCITY] = np.nan
    holed = effect.evaluate(rows, effect.typical, sample_time_s=STEP_S)
    np.testing.assert_array_equal(holed[:80], whole[:80])
    np.testing.assert_array_equal(holed[80:101], holed[79])


def test_states_never_known_start_at_rest_after_the_gap() -> None:
    effect, rows = CATALOGUE["valve_rate_limit"], recording(50)
    late = effect.evaluate(rows[10:], effect.typical, sample_time_s=STEP_S)
    rows[:10, sig.VALVE_SIGNAL] = np.nan
    holed = effect.evaluate(rows, effect.typical, sample_time_s=STEP_S)
    assert np.all(np.isnan(holed[:10]))
    np.testing.assert_array_equal(holed[10:], late)


EXACT = [e for e in DYNAMIC if all(s.linear or s.after for s in e.states)]
BRISTLES = [e for e in EXACT if any(one.name == "distance" for one in e.parameters)]
#: No kink between two samples that steps would have to find.
SMOOTH = [e for e in EXACT if e not in BRISTLES]


@pytest.mark.parametrize("effect", SMOOTH, ids=lambda effect: effect.name)
def test_what_is_followed_exactly_is_what_steps_come_to(effect) -> None:
    at_once = tuple(replace(s, averaged=False) for s in effect.states)
    states = tuple(replace(s, linear=False, after=None) for s in at_once)
    effect = replace(effect, states=at_once)
    stepped, rows = replace(effect, states=states), recording(400)
    rows[150:160, [*HELD_SIGNALS, sig.OTHER_VELOCITY, sig.PISTON_VELOCITY]] = np.nan
    for parameters in corners(effect):
        if TRAVEL in effect.parameters:
            # A branch remembers the errors of steps, which add up: scipy and Dahl's curve test it.
            parameters[effect.parameters.index(TRAVEL)] = 0.0
        ours = effect.evaluate(rows, parameters, sample_time_s=STEP_S)
        theirs = stepped.evaluate(rows, parameters, sample_time_s=STEP_S)
        size = np.nanmax(np.abs(theirs))
        np.testing.assert_allclose(
            ours, theirs, rtol=0.0, atol=3e-5 * size, err_msg=f"{parameters}"
        )


@pytest.mark.parametrize("distance", [2e-5, 6e-4])
@pytest.mark.parametrize("effect", BRISTLES, ids=lambda effect: effect.name)
def test_a_bristle_bends_as_scipy_has_it_to_each_turn(effect, distance: float) -> None:
    """Integrated from turn to turn, between which its rate has no kink."""
    rows = recording(300)
    parameters = effect.typical.copy()
    parameters[[one.name for one in effect.parameters].index("distance")] = distance
    v, times = rows[:, sig.PISTON_VELOCITY], rows[:, sig.TIME]
    before = np.flatnonzero(v[:-1] * v[1:] < 0.0)
    turns = times[before] + STEP_S * v[before] / (v[before] - v[before + 1])

    def rate(t: float, w: FloatArray, way: float) -> FloatArray:
        return (np.interp(t, times, v) - way * np.interp(t, times, v) * w) / distance

    bent, edges = np.empty(len(rows)), np.array([0.0, *turns, times[-1]])
    w = np.zeros(1)
    for begin, end in itertools.pairwise(edges):
        inside = (times >= begin) & (times <= end)
        way = np.sign(np.interp(0.5 * (begin + end), times, v))
        asked = np.unique([begin, *times[inside], end])
        solved = solve_ivp(
            rate, (begin, end), w, "LSODA", asked, args=(way,), rtol=1e-10, atol=1e-12,
            max_step=STEP_S,
        )  # fmt: skip
        bent[inside], w = solved.y[0, np.isin(asked, times[inside])], solved.y[:, -1]
    rows[:, sig.STATE_0] = bent
    expected = evaluate_law(effect.term().law, rows, parameters)
    ours = effect.evaluate(rows, parameters, sample_time_s=STEP_S)
    np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-6 * np.ptp(expected))


LINEAR = [effect for effect in EXACT if all(state.linear for state in effect.states)]


@pytest.mark.parametrize("effect", LINEAR, ids=lambda effect: effect.name)
def test_linear_states_look_at_held_signals_alone(effect) -> None:
    known = {*HELD_SIGNALS, *range(sig.STATE_0, sig.STATE_0 + sig.MAX_STATES)}
    for state in effect.states:
        assert signals_read(state.rate) <= known


@pytest.mark.parametrize("step_s", [0.002, 0.01])
@pytest.mark.parametrize("name", ["valve_spool_lag", "valve_hysteresis"])
def test_the_mean_of_a_held_signal_is_as_late_as_the_spool(name: str, step_s: float) -> None:
    """Of a step: what a lag is short of it, integrated, is the lag times its height.

    2 zeta / omega of a spool; the time constant of one that follows its command over a play.
    """
    effect, count, step = CATALOGUE[name], 400, 100
    frequency, damping = effect.typical[:2]
    lag_s = 2.0 * damping / (2.0 * np.pi * frequency)
    if name == "valve_hysteresis":
        lag_s = float(effect.typical[[p.name for p in effect.parameters].index("time_constant")])
    rows = np.full((count, sig.SIGNAL_COUNT), np.nan)
    rows[:, sig.VALVE_SIGNAL] = np.where(np.arange(count) < step, 0.0, 0.5)
    mean = effect.held_mean(rows, effect.typical, effect.stages[0], step_s)
    height = mean[-1] - mean[0]
    short_s = step_s * float((mean[-1] - mean[step:]).sum()) / height
    # Eighths of an interval resolve 0.5 ms to 2 % where it is 2 ms, to a half where it is 10 ms.
    assert short_s == pytest.approx(lag_s, abs=0.025 * step_s)


def test_means_go_on_from_one_lot_of_rows_to_the_next() -> None:
    """However many rows are looked at together, and where signals are unknown in between."""
    rows = recording(600)
    rows[300:310, sig.VALVE_SIGNAL] = np.nan
    for name in ("valve_spool_lag", "valve_hysteresis", "valve_rate_limit"):
        effect = CATALOGUE[name]
        whole = effect.held_mean(rows, effect.typical, effect.stages[0], STEP_S)
        fine = np.repeat(rows, 8, axis=0)
        law = effect.evaluate(fine, effect.typical, effect.stages[0], STEP_S / 8)
        law = np.append(law, law[-1])
        expected = (0.5 * (law[1:] + law[:-1])).reshape(-1, 8).mean(axis=1)
        assert whole == pytest.approx(expected, rel=1e-12, abs=1e-15, nan_ok=True), name
        short = effect.held_mean(rows[:5], effect.typical, effect.stages[0], STEP_S)
        assert short[:4] == pytest.approx(whole[:4], rel=1e-12), name
        assert effect.held_mean(rows[:0], effect.typical, effect.stages[0], STEP_S).size == 0
