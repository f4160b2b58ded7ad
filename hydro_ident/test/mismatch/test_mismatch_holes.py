"""Valve messages that were lost: what they touch is left out, and nothing else changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.flows.chambers import WindowSettings
from hydro_ident.estimate.forces.force_rows import force_model
from hydro_ident.estimate.signals.derivatives import FilterSettings
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace, last_known, traces_of
from hydro_ident.mismatch.fitting.training import start_model
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.lost_signals import LATEST_S, held_signal
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.telling import telling
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
WINDOWS = WindowSettings(max_delay_cycles=6.0)


def _material(robot: Robot, trace: Trace) -> Material:
    return material_of(robot, force_model(robot), [trace], FilterSettings(), WINDOWS, {})


def _with_holes(trace: Trace, holes: list[slice]) -> Trace:
    """The trace without the lift valve's signal in some samples."""
    signal = trace.valve_signal.copy()
    for hole in holes:
        signal[hole, 0] = np.nan
    return replace(trace, valve_signal=signal)


def _kept_times(material: Material, signals: SignalSurvey, channel: int) -> np.ndarray:
    rows = telling(material, signals) & (material.channel == channel)
    return np.asarray(material.time_s[rows])


def test_a_lost_message_costs_the_windows_that_touch_it(crane_run: Any) -> None:
    """Also where it is the sample that a window ends at, and where some are lost in a row."""
    robot = crane_run.robot
    (trace,) = traces_of([crane_run.recording()])
    signals, whole = SignalSurvey.of(robot, [trace]), _material(robot, trace)
    reach_s = WINDOWS.length_s + WINDOWS.max_delay_cycles * trace.step_s
    # A longer hole takes what any delay may move it to.
    for hole, more_s in ((slice(4000, 4001), 0.0), (slice(4000, 4012), LATEST_S)):
        holed = _material(robot, _with_holes(trace, [hole]))
        begin_s, end_s = hole.start * trace.step_s, (hole.stop - 1) * trace.step_s
        for k, name in enumerate(whole.channels):
            if not whole.is_flow(k) or not name.startswith("lift"):
                continue
            before, after = (_kept_times(m, signals, k) for m in (whole, holed))
            lost = np.setdiff1d(before.round(6), after.round(6))
            assert before.size > 100
            assert not np.setdiff1d(after.round(6), before.round(6)).size
            assert (lost > begin_s - reach_s).all(), name
            assert (lost < end_s + max(reach_s, more_s)).all(), name


# Delays and lags move a hole to rows that do not touch it ----------------------------------------

DELAY_S = 0.04
LAG = EffectSpec("valve_spool_lag", "lift_valve", {"frequency": 6.0, "damping": 0.5})


@pytest.fixture(scope="module")
def late(make_run: Make) -> Any:
    """A machine whose commands come 40 ms late, without sensors' noise."""
    true_crane, simulated_run = make_run
    return simulated_run(replace(true_crane(), command_delay_s=DELAY_S), 12.0, noisy=False)


@pytest.fixture(scope="module")
def slow(make_run: Make) -> Any:
    """A machine whose lift spool rings, without sensors' noise."""
    true_crane, simulated_run = make_run
    return simulated_run(replace(true_crane(), effects=(LAG,)), 12.0, noisy=False)


def _single_holes(trace: Trace) -> Trace:
    """Without twenty messages of the lift valve, which lie wherever they lie."""
    at = np.random.default_rng(2).choice(np.arange(500, trace.samples - 100), 20, replace=False)
    return _with_holes(trace, [slice(k, k + 1) for k in at.tolist()])


def _true_models(robot: Robot, predictor: Predictor) -> list[Model]:
    """The machine's own numbers, its delay as the base's and as the effect of that name."""
    start = start_model(robot, predictor, resolve(robot))
    cycle_s = predictor.material.stretches[0].trace.step_s
    given = {"delay": robot.command_delay_s - cycle_s}
    if given["delay"] <= 0.0:
        return [start]
    (term,) = resolve(replace(robot, effects=(EffectSpec("command_delay", robot.name, given),)))
    quick = replace(start, delays_s=(cycle_s,) * len(robot.cylinders)).with_term(term)
    return [start, quick]


def _lift_flows(material: Material) -> np.ndarray:
    flows = [k for k, n in enumerate(material.channels) if n.startswith("lift/flow")]
    return np.isin(material.channel, flows) & (material.time_s > 0.2)


@pytest.mark.parametrize("machine", ["late", "slow"])
def test_what_was_lost_leaves_no_flow_unexplained(
    machine: str, request: pytest.FixtureRequest
) -> None:
    """In every row that is kept the true model is as good as in those of the whole recording."""
    run = request.getfixturevalue(machine)
    (trace,) = traces_of([run.recording()])
    predictors = [Predictor(_material(run.robot, t)) for t in (trace, _single_holes(trace))]
    whole, holed = ([p.residual(m) for m in _true_models(run.robot, p)] for p in predictors)
    rows = [_lift_flows(p.material) for p in predictors]
    assert 0.5 * rows[0].sum() < rows[1].sum() < rows[0].sum()
    y, _ = predictors[0].base(_true_models(run.robot, predictors[0])[0])
    for before, after in zip(whole, holed, strict=True):
        most = max(np.abs(before[rows[0]]).max(), 0.01 * y[rows[0]].std())
        assert np.abs(after[rows[1]]).max() < 1.5 * most


def test_short_holes_are_held_and_long_ones_stay() -> None:
    signal = np.arange(20.0)
    signal[[0, 1, 5, 8, 9, 10, 19]] = np.nan
    held = held_signal(signal, 2)
    assert np.flatnonzero(np.isnan(held)).tolist() == [0, 1, 8, 9, 10]
    assert (held[5], held[19]) == (4.0, 18.0)
    assert np.isfinite(last_known(signal)).all()
    assert last_known(signal)[[0, 9, 19]].tolist() == [2.0, 7.0, 18.0]
    assert not last_known(np.full(3, np.nan)).any()
    whole = np.arange(5.0)
    assert held_signal(whole, 2) is whole


def test_rows_after_a_long_hole_are_out_of_reach_of_every_delay(late: Any) -> None:
    """What the valve was told meanwhile is unknown: as late as that may come, no row is kept."""
    (trace,) = traces_of([late.recording()])
    hole = slice(3000, 3060)
    predictor = Predictor(_material(late.robot, _with_holes(trace, [hole])))
    rows = _lift_flows(predictor.material)
    times = predictor.material.time_s[rows]
    last_s = (hole.stop - 1) * trace.step_s
    assert not ((times > last_s - 0.04) & (times < last_s + 0.1)).any()
    assert ((times > last_s) & (times < last_s + 0.2)).any()
    assert (predictor.material.time_s[_lift_flows(predictor.material)] < 6.0).any()
    y, _ = predictor.base(start_model(late.robot, predictor))
    for model in _true_models(late.robot, predictor):
        assert np.abs(predictor.residual(model)[rows]).max() < 0.05 * y[rows].std()


def test_a_window_that_nothing_tells_counts_nothing(crane_run: Any) -> None:
    """In no column: with some of them it would be a flow that lacks the others."""
    (trace,) = traces_of([crane_run.recording()])
    (stretch,) = _material(crane_run.robot, trace).stretches
    steps = np.ones((trace.samples - 1, 2))
    steps[5000, 1] = np.nan
    means = Material.windowed(stretch, 0, steps)
    touched = (stretch.starts[0] <= 5000) & (stretch.starts[0] + stretch.span > 5000)
    assert touched.any()
    assert not means[touched].any()
    assert means[~touched] == pytest.approx(1.0 / trace.step_s)
