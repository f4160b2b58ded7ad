"""Rails that give way: they, the valves' flows and the laws agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from hydro_ident.errors import IdentError
from hydro_ident.estimate.flows.rails import railed
from hydro_ident.estimate.signals.traces import Trace, traces_of
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot import EffectSpec, FloatArray, Robot

DROOP = EffectSpec("supply_droop", "", {"resistance": 6e9, "time_constant": 0.02})
BACK = EffectSpec("tank_back_pressure", "", {"resistance": 8e12, "time_constant": 0.004})
#: Delays of valves that have none.
PROMPT = (0.0, 0.0)


@pytest.fixture(scope="module")
def trace(make_run: tuple) -> Trace:
    true_crane, simulated_run = make_run
    return traces_of([simulated_run(true_crane(), 4.0).recording()])[0]


def _effects(robot: Robot, *specs: EffectSpec) -> tuple[ActiveEffect, ...]:
    named = tuple(replace(spec, target=robot.name) for spec in specs)
    return tuple(resolve(replace(robot, effects=named)))


def _flows(robot: Robot, trace: Trace) -> tuple[FloatArray, FloatArray]:
    """Drawn and returned, (N,) each, by `hydro_model.hydraulics.valve`; unknown ones are 0."""
    drawn, returned = np.zeros(trace.samples), np.zeros(trace.samples)
    for i, cylinder in enumerate(robot.cylinders):
        u = np.where(np.isfinite(trace.valve_signal[:, i]), trace.valve_signal[:, i], 0.0)
        q_a, q_b = edge_flows(
            robot.valve_of(cylinder.name), u, trace.p_a[:, i], trace.p_b[:, i],
            trace.supply, trace.tank,
        )  # fmt: skip
        drawn += np.nan_to_num(np.where(u > 0.0, q_a, q_b))
        returned -= np.nan_to_num(np.where(u > 0.0, q_b, q_a))
    return drawn, returned


def _solved(
    robot: Robot,
    trace: Trace,
    specs: tuple[EffectSpec, ...],
    delays_s: tuple[float, ...] = PROMPT,
) -> FloatArray:
    """Supply and tank, (2, N), as scipy solves the states' equations from rest.

    Signals are held from sample to sample and come late, pressures and recorded rails are straight
    between samples.
    """
    late = np.array(delays_s) / trace.step_s
    given = {spec.name: spec.parameters for spec in specs}
    droop, back = (given.get(n) for n in ("supply_droop", "tank_back_pressure"))

    def wanted(k: int, part: float, x: FloatArray) -> FloatArray:
        now = _between(trace, k, part, x, late)
        drawn, returned = (float(flow[0]) for flow in _flows(robot, now))
        return np.array([
            droop["resistance"] * drawn if droop else 0.0,
            back["resistance"] * returned * abs(returned) if back else 0.0,
        ])  # fmt: skip

    lags = np.array([one["time_constant"] if one else 1.0 for one in (droop, back)])
    first = fsolve(lambda x: wanted(0, 0.0, x) - x, np.zeros(2), xtol=1e-12)
    states, h = [first], trace.step_s
    for k in range(trace.samples - 1):
        run = solve_ivp(
            lambda t, x, k=k: (wanted(k, t / h, x) - x) / lags,
            (0.0, h), states[-1], method="LSODA", rtol=1e-6, atol=1.0, max_step=h / 4,
        )  # fmt: skip
        states.append(run.y[:, -1])
    lowered = np.array(states).T
    return np.stack([trace.supply - lowered[0], trace.tank + lowered[1]])


def _between(trace: Trace, k: int, part: float, x: FloatArray, late: FloatArray) -> Trace:
    """The trace's one sample at a part of the interval behind a sample, at lowered rails."""
    at = min(k + 1, trace.samples - 1)
    told = np.maximum(np.floor(k + part - late + 1e-9).astype(int), 0)

    def straight(name: str) -> FloatArray:
        values = getattr(trace, name)
        return np.asarray(values[k] + part * (values[at] - values[k]))[None]

    return replace(
        trace, time_s=np.zeros(1), p_a=straight("p_a"), p_b=straight("p_b"),
        supply=straight("supply") - x[0], tank=straight("tank") + x[1],
        valve_signal=trace.valve_signal[told, np.arange(told.size)][None],
    )  # fmt: skip


def _cut(trace: Trace, rows: slice) -> Trace:
    """Some samples of a trace, evenly spaced."""
    names = ("time_s", "q", "stroke", "p_a", "p_b", "supply", "tank", "valve_signal",
             "joint_torque")  # fmt: skip
    own = {name: getattr(trace, name)[rows] for name in names}
    return replace(trace, step_s=trace.step_s * (rows.step or 1), core=None, **own)


def _finer(trace: Trace, times: int) -> Trace:
    """The trace with samples between its own: signals held, the rest straight."""
    at = np.arange((trace.samples - 1) * times + 1) / times
    own = np.arange(trace.samples)

    def straight(values: FloatArray) -> FloatArray:
        columns = values.reshape(trace.samples, -1).T
        fine = np.stack([np.interp(at, own, column) for column in columns], axis=1)
        return fine.reshape(-1, *values.shape[1:])

    names = ("time_s", "q", "stroke", "p_a", "p_b", "supply", "tank", "joint_torque")
    fine = {name: straight(getattr(trace, name)) for name in names}
    signal = trace.valve_signal[np.floor(at).astype(int)]
    return replace(trace, step_s=trace.step_s / times, core=None, valve_signal=signal, **fine)


def _unread(trace: Trace, rows: slice) -> Trace:
    p_a, p_b = trace.p_a.copy(), trace.p_b.copy()
    p_a[rows] = p_b[rows] = np.nan
    return replace(trace, p_a=p_a, p_b=p_b)


@pytest.mark.parametrize("rows", [slice(1000, 1060), slice(0, 600, 10)])
@pytest.mark.parametrize("specs", [(DROOP,), (BACK,), (DROOP, BACK)])
def test_rails_are_those_of_their_equations(
    robot: Robot, trace: Trace, specs: tuple, rows: slice
) -> None:
    """At 500 Hz and at 50 Hz, where lags are a cycle and a fifth of one."""
    own = _cut(trace, rows)
    found, expected = (
        railed(robot, own, _effects(robot, *specs), PROMPT),
        _solved(robot, own, specs),
    )
    moved = np.abs(expected - [own.supply, own.tank]).max(axis=1)
    assert moved.max() > 2e5
    assert np.abs(found.supply - expected[0]).max() <= 0.01 * moved[0]
    assert np.abs(found.tank - expected[1]).max() <= 0.01 * moved[1]


@pytest.mark.parametrize("delays_s", [(0.0013, 0.0094), (0.004, 0.0), (0.03, 0.0301)])
@pytest.mark.parametrize("rows", [slice(1000, 1060), slice(0, 300, 10)])
def test_valves_draw_as_late_as_they_open(
    robot: Robot, trace: Trace, rows: slice, delays_s: tuple[float, float]
) -> None:
    """By whole cycles and parts of them, each by its own."""
    own, specs = _cut(trace, rows), (DROOP, BACK)
    found = railed(robot, own, _effects(robot, *specs), delays_s)
    expected = _solved(robot, own, specs, delays_s)
    moved = np.abs(expected - [own.supply, own.tank]).max(axis=1)
    assert np.abs(found.supply - expected[0]).max() <= 0.01 * moved[0]
    assert np.abs(found.tank - expected[1]).max() <= 0.01 * moved[1]


@pytest.mark.parametrize("resistance", [4e9, 4e10, 1e11])
@pytest.mark.parametrize("lag_s", [0.001, 0.02, 0.2])
def test_rails_on_a_coarse_grid_are_those_on_a_fine_one(
    robot: Robot, trace: Trace, resistance: float, lag_s: float
) -> None:
    """However much a line gives way: nothing rings."""
    droop = replace(DROOP, parameters={"resistance": resistance, "time_constant": lag_s})
    terms, coarse = _effects(robot, droop), _cut(trace, slice(0, None, 10))
    fine = railed(robot, _finer(coarse, 100), terms, PROMPT).supply[::100]
    found = railed(robot, coarse, terms, PROMPT).supply
    assert np.abs(found - fine).max() < 0.02 * np.abs(fine - coarse.supply).max()


@pytest.mark.parametrize("rows", [slice(100), slice(700, 720), slice(None)])
def test_edges_to_pressures_that_nobody_read_count_as_closed(
    robot: Robot, trace: Trace, rows: slice
) -> None:
    """From the first sample, in a hole (from its last reading on) and all along."""
    terms = _effects(robot, DROOP, BACK)
    signal = trace.valve_signal.copy()
    signal[rows] = signal[max((rows.start or 0) - 1, 0)] = 0.0
    shut = railed(robot, replace(trace, valve_signal=signal), terms, PROMPT)
    found = railed(robot, _unread(trace, rows), terms, PROMPT)
    assert np.array_equal(found.supply, shut.supply)
    assert np.array_equal(found.tank, shut.tank)
    assert np.isfinite(found.supply).all()
    assert np.isfinite(found.tank).all()


def test_a_lost_transducer_closes_no_edge_of_other_chambers(robot: Robot, trace: Trace) -> None:
    """What is returned from the chamber opposite is known, and so are the other valve's flows."""
    terms, p_a = _effects(robot, DROOP, BACK), trace.p_a.copy()
    p_a[:, 0] = np.nan
    lost = _cut(replace(trace, p_a=p_a), slice(1000, 1300))
    found = railed(robot, lost, terms, PROMPT)
    expected = _solved(robot, lost, (DROOP, BACK))
    moved = np.abs(expected - [lost.supply, lost.tank]).max(axis=1)
    assert moved.min() > 2e5
    assert np.abs(found.supply - expected[0]).max() <= 0.01 * moved[0]
    assert np.abs(found.tank - expected[1]).max() <= 0.01 * moved[1]


@pytest.mark.parametrize("left", [0, 1])
def test_a_cylinder_that_no_valve_feeds_draws_nothing(
    robot: Robot, trace: Trace, left: int
) -> None:
    """As one whose valve stays closed."""
    terms, signal = _effects(robot, DROOP, BACK), np.zeros_like(trace.valve_signal)
    signal[:, left] = trace.valve_signal[:, left]
    shut = railed(robot, replace(trace, valve_signal=signal), terms, PROMPT)
    one_fed = replace(robot, valves=(robot.valve_of(robot.cylinders[left].name),))
    found = railed(one_fed, trace, terms, PROMPT)
    assert np.array_equal(found.supply, shut.supply)
    assert np.array_equal(found.tank, shut.tank)
    assert np.abs(found.supply - trace.supply).max() > 2e5


def test_closed_valves_leave_the_rails_as_recorded(robot: Robot, trace: Trace) -> None:
    shut = replace(trace, valve_signal=np.full_like(trace.valve_signal, np.nan))
    found = railed(robot, shut, _effects(robot, DROOP, BACK), PROMPT)
    assert np.array_equal(found.supply, trace.supply)
    assert np.array_equal(found.tank, trace.tank)


def test_a_law_of_another_form_is_refused(robot: Robot, trace: Trace) -> None:
    (droop,) = _effects(robot, DROOP)
    still = replace(droop, effect=replace(CATALOGUE["supply_droop"], states=()))
    with pytest.raises(IdentError, match="follows the flow by one linear state"):
        railed(robot, trace, (still,), PROMPT)
