"""Rails that give way: they, the valves' flows and the laws agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.errors import IdentError
from hydro_ident.estimate.traces import Trace, traces_of
from hydro_ident.mismatch.rails import railed
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.law import Stage
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, FloatArray, Robot
from hydro_model.signals import RETURN_FLOW, SIGNAL_COUNT, SUPPLY_FLOW
from hydro_model.valve import edge_flows

DROOP = EffectSpec("supply_droop", "", {"resistance": 6e9, "time_constant": 0.02})
BACK = EffectSpec("tank_back_pressure", "", {"resistance": 8e12, "time_constant": 0.004})


@pytest.fixture(scope="module")
def trace(make_run: tuple) -> Trace:
    true_crane, simulated_run = make_run
    return traces_of([simulated_run(true_crane(), 4.0).recording()])[0]


def _effects(robot: Robot, *specs: EffectSpec) -> tuple[ActiveEffect, ...]:
    named = tuple(replace(spec, target=robot.name) for spec in specs)
    return tuple(resolve(replace(robot, effects=named)))


def _flows(robot: Robot, trace: Trace) -> tuple[FloatArray, FloatArray]:
    """Drawn and returned, (N,) each, by the flows of `hydro_model.valve`; unknown ones are 0."""
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


def _by_the_laws(robot: Robot, recorded: Trace, found: Trace, terms: tuple) -> FloatArray:
    """Supply and tank, (2, N), that the laws make of the flows at the rails found."""
    signals = np.full((recorded.samples, SIGNAL_COUNT), np.nan)
    signals[:, SUPPLY_FLOW], signals[:, RETURN_FLOW] = _flows(robot, found)
    rails = np.stack([recorded.supply, recorded.tank])
    for one in terms:
        for row, stage in zip(rails, (Stage.SUPPLY, Stage.TANK), strict=True):
            if stage in one.effect.stages:
                row += one.effect.evaluate(signals, one.parameters, stage, recorded.step_s)
    return rails


def _unread(trace: Trace, rows: slice) -> Trace:
    p_a, p_b = trace.p_a.copy(), trace.p_b.copy()
    p_a[rows] = p_b[rows] = np.nan
    return replace(trace, p_a=p_a, p_b=p_b)


@pytest.mark.parametrize("specs", [(DROOP,), (BACK,), (DROOP, BACK)])
def test_rails_flows_and_laws_agree(robot: Robot, trace: Trace, specs: tuple) -> None:
    terms = _effects(robot, *specs)
    found = railed(robot, trace, terms)
    expected = _by_the_laws(robot, trace, found, terms)
    # The first sample's is a fixed point, found to 1 Pa; all others follow exactly.
    assert np.abs(found.supply - expected[0]).max() < 4.0
    assert np.abs(found.tank - expected[1]).max() < 4.0
    moved = np.abs(found.supply - trace.supply) + np.abs(found.tank - trace.tank)
    assert moved.max() > 2e5


@pytest.mark.parametrize("rows", [slice(100), slice(700, 720), slice(None)])
def test_edges_to_pressures_that_nobody_read_count_as_closed(
    robot: Robot, trace: Trace, rows: slice
) -> None:
    """From the first sample, in a hole and all along."""
    terms = _effects(robot, DROOP, BACK)
    signal = trace.valve_signal.copy()
    signal[rows] = 0.0
    shut = railed(robot, replace(trace, valve_signal=signal), terms)
    found = railed(robot, _unread(trace, rows), terms)
    assert np.array_equal(found.supply, shut.supply)
    assert np.array_equal(found.tank, shut.tank)
    assert np.isfinite(found.supply).all()
    assert np.isfinite(found.tank).all()


def test_a_lost_transducer_closes_no_edge_of_other_chambers(robot: Robot, trace: Trace) -> None:
    """What is returned from the chamber opposite is known, and so are the other valve's flows."""
    terms, p_a = _effects(robot, DROOP, BACK), trace.p_a.copy()
    p_a[:, 0] = np.nan
    lost = replace(trace, p_a=p_a)
    found = railed(robot, lost, terms)
    expected = _by_the_laws(robot, lost, found, terms)
    assert np.abs(found.supply - expected[0]).max() < 4.0
    assert np.abs(found.tank - expected[1]).max() < 4.0
    for rail, recorded in ((found.supply, trace.supply), (found.tank, trace.tank)):
        assert np.abs(rail - recorded).max() > 2e5


@pytest.mark.parametrize("left", [0, 1])
def test_a_cylinder_that_no_valve_feeds_draws_nothing(
    robot: Robot, trace: Trace, left: int
) -> None:
    """As one whose valve stays closed."""
    terms, signal = _effects(robot, DROOP, BACK), np.zeros_like(trace.valve_signal)
    signal[:, left] = trace.valve_signal[:, left]
    shut = railed(robot, replace(trace, valve_signal=signal), terms)
    one_fed = replace(robot, valves=(robot.valve_of(robot.cylinders[left].name),))
    found = railed(one_fed, trace, terms)
    assert np.array_equal(found.supply, shut.supply)
    assert np.array_equal(found.tank, shut.tank)
    assert np.abs(found.supply - trace.supply).max() > 2e5


def test_closed_valves_leave_the_rails_as_recorded(robot: Robot, trace: Trace) -> None:
    shut = replace(trace, valve_signal=np.full_like(trace.valve_signal, np.nan))
    found = railed(robot, shut, _effects(robot, DROOP, BACK))
    assert np.array_equal(found.supply, trace.supply)
    assert np.array_equal(found.tank, trace.tank)


def test_a_law_of_another_form_is_refused(robot: Robot, trace: Trace) -> None:
    (droop,) = _effects(robot, DROOP)
    still = replace(droop, effect=replace(CATALOGUE["supply_droop"], states=()))
    with pytest.raises(IdentError, match="follows the flow by one linear state"):
        railed(robot, trace, (still,))
