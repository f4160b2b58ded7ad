"""Pressures read once per command, and what is quick in a slow command: neither is physics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, trapezoid

from hydro_ident.estimate.forces.force_rows import force_model
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.traces import Trace, traces_of
from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.rows.choices import Choices, choices_of
from hydro_ident.mismatch.rows.ripple import ripple_force, ripple_name
from hydro_ident.mismatch.rows.telling import within
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.recordings.sources import sources_of
from hydro_model.hydraulics.cylinder import chamber_volumes
from hydro_model.hydraulics.valve import edge_flows
from hydro_model.robot_files import load_robot

CYCLE_S, FINE = 0.002, 400
BULK_PA = 1.1e9


@pytest.fixture(scope="module")
def trace(crane_run: Any) -> Trace:
    (whole,) = traces_of([crane_run.recording()])
    return whole


@pytest.mark.parametrize("delay_share", [0.0, 0.3, 0.7, 1.0])
def test_a_ramp_that_is_held_swings_the_pressures_by_the_formula(
    trace: Trace, delay_share: float
) -> None:
    """Against a fine integral of held minus ramp over one interval, at the phase of the stamps."""
    robot = load_robot("xs031")
    cylinder, k = robot.cylinders[0], 1000
    rate = 2.0  # of the signal, 1/s
    u = 0.2 + rate * CYCLE_S * np.arange(trace.samples)
    still = {
        name: np.repeat(getattr(trace, name)[k : k + 1], trace.samples, axis=0)
        for name in ("p_a", "p_b", "supply", "tank", "stroke")
    }
    signal = trace.valve_signal.copy()
    signal[:, 0] = u
    held = replace(trace, valve_signal=signal, **still)
    phase = np.linspace(0.0, 1.0, FINE + 1)
    swing = cumulative_trapezoid(0.5 - phase, phase, initial=0.0) * CYCLE_S * rate * CYCLE_S
    swing -= trapezoid(swing, phase)
    # Commands take effect so late that the stamps lie this far into what is held.
    read = np.interp(1.0 - delay_share, phase, swing)
    p_a, p_b = trace.p_a[k, 0], trace.p_b[k, 0]
    flows = edge_flows(robot.valves[0], 1.0, p_a, p_b, trace.supply[k], trace.tank[k])
    volumes = chamber_volumes(cylinder, trace.stroke[k, 0])
    a, b = (BULK_PA * float(q) / float(v) * read for q, v in zip(flows, volumes, strict=True))
    expected = cylinder.area_a_m2 * a - cylinder.area_b_m2 * b
    late = delay_share * CYCLE_S
    time = (CYCLE_S - late) * late / (2.0 * CYCLE_S) - CYCLE_S / 12.0
    column = ripple_force(robot, 0, held)[k]
    assert BULK_PA * time * column == pytest.approx(expected, rel=1e-3)


def test_the_base_takes_a_ripple_up(
    make_run: tuple[Callable[..., Any], Any], lay_out: Callable[..., Residuals]
) -> None:
    """Force errors as of a ripple are what the base's column says, and most of them are taken up.

    Not all: this one is larger than what is known beforehand of readings in step with commands.
    """
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 14.0, pace=2.5)
    (plain,) = traces_of([run.recording()])
    # Within what readings at any phase may be, beside the model's own (delay, phase) of zero.
    coefficient = 1.4e5
    ripple = coefficient * ripple_force(true_crane(), 0, plain)
    p_a = run.p_a.copy()
    p_a[:, 0] += ripple / true_crane().cylinders[0].area_a_m2
    measured, left = [], []
    for work in (lay_out(run), lay_out(replace(run, p_a=p_a))):
        predictor, base = work.training.predictor, work.base
        at = predictor.ripple_columns[0]
        assert predictor.names[at] == ripple_name("lift_cylinder")
        y, columns = predictor.base(base.model)
        force = predictor.material.channel == predictor.material.channels.index("lift/force")
        assert not columns[~force, at].any()
        measured.append(y[force])
        left.append(float(np.std(base.residual[work.training.mask & force])))
    expected = coefficient * columns[force, at]
    assert np.std(measured[1] - measured[0] - expected) < 0.05 * np.std(expected)
    assert left[1] ** 2 - left[0] ** 2 < 0.5 * np.var(expected)


def test_a_known_base_knows_no_ripple(make_run: tuple[Callable[..., Any], Any]) -> None:
    """With a fixed base the readings' own error is fitted still."""
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 14.0)
    (plain,) = traces_of([run.recording()])
    p_a = run.p_a.copy()
    p_a[:, 0] += -3.0e5 * ripple_force(true_crane(), 0, plain) / 7.85e-3
    sources = sources_of([replace(run, p_a=p_a).recording()])
    surveys = [survey_source(source, true_crane()) for source in sources]
    settings = DiagnosisSettings(fixed_base=True)
    work = residuals(true_crane(), sources, [], surveys, settings)
    assert work is not None
    refitted = fit(work.training, work.base.model)
    assert refitted.model.ripples[0] == pytest.approx(work.base.model.ripples[0], rel=1e-3)
    assert abs(refitted.model.ripples[0]) > 1.0e5


def _choices(trace: Trace, signal: np.ndarray) -> Choices:
    robot = load_robot("xs031")
    seen = replace(trace, valve_signal=signal)
    return choices_of(force_model(robot), SignalSurvey.of(robot, [seen]), [seen])


def test_windows_are_as_long_as_the_commands_are_slow(trace: Trace) -> None:
    """What is quick in a slow command is the controller's answer to noise: no reason for haste."""
    time, shape = trace.time_s, trace.valve_signal.shape
    noise = np.random.default_rng(5).standard_normal(shape)
    slow, quick = (
        0.3 * np.sin(2.0 * np.pi * hz * time)[:, None] + 2.0e-5 * noise for hz in (0.4, 6.0)
    )
    assert _choices(trace, slow).windows_s == pytest.approx((0.1, 0.05))
    assert _choices(trace, quick).windows_s == Choices().windows_s
    assert _choices(trace, np.full(shape, np.nan)).windows_s == Choices().windows_s
    assert _choices(trace, np.zeros(shape)).windows_s == Choices().windows_s
    # Of a live bag the first or last state may have no sample of the valves; a hole is no haste.
    for lost in (slice(0, 1), slice(-1, None), slice(1000, 1400)):
        for signal, expected in ((slow, (0.1, 0.05)), (quick, Choices().windows_s)):
            holed = signal.copy()
            holed[lost] = np.nan
            assert _choices(trace, holed).windows_s == pytest.approx(expected), lost
    # What was hardly ever heard says nothing.
    hardly = np.where(np.arange(len(time))[:, None] % 4 == 0, slow, np.nan)
    assert _choices(trace, hardly).windows_s == Choices().windows_s


def test_rows_beyond_the_positions_that_were_fitted_are_not_checked_on(
    make_run: tuple[Callable[..., Any], Any], lay_out: Callable[..., Residuals]
) -> None:
    true_crane, simulated_run = make_run
    work = lay_out(simulated_run(true_crane(), 14.0))
    material = work.training.predictor.material
    positions = material.positions()
    joint = material.channels.index("lift/force")
    own = material.channel == joint
    middle = float(np.median(positions[own]))
    below = own & (positions < middle)
    inside = within(material, below, material)
    assert inside[below].all()
    assert not inside[own & (positions > middle + 0.05 * np.ptp(positions[below]))].any()
    assert not inside[~own].any()
