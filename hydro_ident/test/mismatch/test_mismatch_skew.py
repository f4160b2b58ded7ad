"""Pressures read a tenth of a millisecond after positions: the base's, and no law's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.signals.derivatives import (
    FilterSettings,
    central_differences,
    motion,
    smooth_rates,
)
from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.answer.lacking import readings_apart
from hydro_ident.mismatch.answer.late_positions import without_late
from hydro_ident.mismatch.answer.outcome import Finding
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit, settled
from hydro_ident.mismatch.fitting.training import start_model
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.naming.lags import resolved
from hydro_ident.mismatch.rows.skew import (
    TORQUES,
    is_unnamed,
    largest_skew,
    skew_name,
    usual_skew,
)
from hydro_ident.mismatch.settings import LEAST_CYCLES, DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.mismatch.trials.scoring import score
from hydro_ident.mismatch.verifying.verify import Verification
from hydro_ident.recordings.sources import sources_of
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.readings import EVERY_CHAMBER
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
STEP_S = 0.002
SOFT = {"inertia": 20.0, "frequency": 2.4, "damping": 1.0}
SPRING = EffectSpec("structural_flexibility", "lift_cylinder", SOFT)
MODE = {"inertia": 250.0, "frequency": 7.1, "damping": 0.1}
LATE = EffectSpec("pressure_delay", "xs031", {"delay": STEP_S})


def _run(make_run: Make, skews_s: Any, *effects: EffectSpec) -> Any:
    """A machine with some effects, whose pressures of chambers a and b are read a little late."""
    true_crane, simulated_run = make_run
    run = simulated_run(replace(true_crane(), effects=effects), 13.0)
    p_a, p_b = (
        p - s * np.gradient(p, STEP_S, axis=0)
        for p, s in zip((run.p_a, run.p_b), np.broadcast_to(skews_s, 2), strict=True)
    )
    return replace(run, p_a=p_a, p_b=p_b)


def _fitted(work: Residuals, without: Fitted, spec: EffectSpec) -> Contender:
    one = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    if spec.name == LATE.name:
        one = replace(one, cylinder=None, target="xs031", index=EVERY_CHAMBER)
    [found] = Contest(work.training).fitted(without, [one], without.bench.noise)
    return found


def _left(work: Residuals) -> float:
    material = work.training.predictor.material
    rows = work.training.mask & (material.channel == material.channels.index("lift/force"))
    return float(np.std(work.base.residual[rows]))


def test_rates_of_pressures_are_their_slopes() -> None:
    time = STEP_S * np.arange(4000)
    rate = smooth_rates(5.0e6 * np.sin(9.0 * time), STEP_S, FilterSettings())
    inner = slice(100, -100)
    assert rate[inner] == pytest.approx(4.5e7 * np.cos(9.0 * time)[inner], abs=1e-5 * 4.5e7)
    assert not smooth_rates(np.ones(1), STEP_S, FilterSettings()).any()


def test_rates_in_a_slow_log_are_slopes_as_those_of_positions_are() -> None:
    """Three points err by (2 pi f h)^2 / 6: at 5 Hz and 50 samples per second by 6.6 %."""
    time, turn = 0.02 * np.arange(500), 2.0 * np.pi * 5.0
    rate = smooth_rates(np.sin(turn * time), 0.02, FilterSettings().borne_at(0.02))
    inner = slice(100, -100)
    assert rate[inner] == pytest.approx(turn * np.cos(turn * time)[inner], abs=0.01 * turn)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_stretches_of_a_few_samples_have_slopes_and_no_bends(count: int) -> None:
    ramp = 0.5 + 0.3 * STEP_S * np.arange(count)[:, None]
    slope, bend = central_differences(ramp, STEP_S)
    assert slope == pytest.approx(np.full_like(ramp, 0.3 if count > 1 else 0.0))
    assert not bend.any()
    # No filter settles in so few.
    for moved in motion(ramp, STEP_S, FilterSettings()):
        assert moved.shape == ramp.shape
        assert np.isfinite(moved).all()


def test_holes_of_a_pressure_are_no_steps_of_it(
    crane_run: Any, predictor_of: Callable[..., Any]
) -> None:
    """Of a pressure that a quarter of the samples lacks, rows beside its holes are kept."""
    given = crane_run.recording()
    p_a = given.p_a.copy()
    for begin in range(500, len(p_a), 400):
        p_a[begin : begin + 100, 0] = np.nan
    whole, holed = (predictor_of(given.robot, replace(given, p_a=p)) for p in (given.p_a, p_a))
    columns = []
    for predictor in (whole, holed):
        material = predictor.material
        rows = material.channel == material.channels.index("lift/flow_a")
        _, x = predictor.base(start_model(given.robot, predictor))
        columns.append((material.time_s[rows].round(6), x[rows, predictor.skew_columns[0]]))
    (times, full), (kept, found) = columns
    assert 0.5 * times.size < kept.size < 0.8 * times.size
    expected = full[np.isin(times, kept)]
    # A line over 0.2 s is not what the pressure did there; rows beside it see little of that.
    assert np.std(found - expected) < 0.2 * np.std(expected)
    never = np.column_stack([p_a[:, 0], np.full(len(p_a), np.nan)])
    assert not smooth_rates(never, STEP_S, FilterSettings())[:, 1].any()


def test_the_base_takes_skews_up(make_run: Make, lay_out: Callable[..., Residuals]) -> None:
    """Found at their sizes, chamber by chamber, and nothing of them is left; nor any law."""
    added_s = np.array([3.0e-4, 1.0e-4])
    plain, late = (lay_out(_run(make_run, s)) for s in (np.zeros(2), added_s))
    predictor = late.training.predictor
    columns = predictor.skew_columns
    assert predictor.names[columns[0]] == skew_name("lift_cylinder", "a")
    before, after = (np.array(w.base.model.skews_s[:-1]).reshape(2, 2) for w in (plain, late))
    assert np.abs(before).max() < 5e-5
    assert (after - before)[0] == pytest.approx(added_s, abs=3e-5)
    std = np.sqrt(np.diag(late.base.covariance))[list(columns.values())].reshape(2, 2)
    assert (np.abs(after - added_s) < 4.0 * std + 2e-5).all()
    assert _left(late) < 1.05 * _left(plain)
    notes = [robot_of(w.training.predictor, w.base, w.robot).notes for w in (plain, late)]
    told = [[n for n in some if n.startswith("the pressure of")] for some in notes]
    assert not told[0]
    assert told[1][0].startswith("the pressure of lift_cylinder/a is read 0.")
    assert told[1][0].endswith("ms after positions: taken out, not in the model")
    # A soft, damped spring gains less on rows that took no part than its numbers cost.
    spring = _fitted(late, late.base, SPRING)
    assert 0.5 * spring.held_out < spring.cost


@pytest.mark.thorough
def test_a_mode_is_more_than_late_pressures(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    mode = EffectSpec("structural_flexibility", "lift_cylinder", MODE)
    work = lay_out(_run(make_run, 1e-4, mode))
    found = _fitted(work, work.base, mode)
    assert 0.5 * found.held_out > found.cost
    assert resolved(work.training, work.base, found)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 500.0, 1000.0])
def test_no_lateness_lies_between_base_and_finding(rate_hz: float) -> None:
    """Where the base ends the effect begins, and the prior reaches as far as polling may."""
    assert largest_skew(0, 1.0 / rate_hz) == pytest.approx(LEAST_CYCLES / rate_hz)
    assert usual_skew(0, 1.0 / rate_hz) >= 0.25 * largest_skew(0, 1.0 / rate_hz)


def test_positions_that_are_read_too_late_are_no_law_of_the_machine() -> None:
    assert is_unnamed(0, -1e-3)
    assert is_unnamed(TORQUES, 5e-3)
    assert not is_unnamed(0, 1e-3)  # its further lateness is a finding


def test_positions_that_lag_behind_are_told_whatever_else_is_found(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """Encoders behind a filter of 6 ms: pressures seem early by more than half a cycle."""
    run = _run(make_run, 0.0)
    late = replace(run, q=np.concatenate([run.q[:1].repeat(3, axis=0), run.q[:-3]]))
    for one, apart in ((run, False), (late, True)):
        work = lay_out(one)
        told = readings_apart(work.training, work.base)
        assert bool(told) is apart
        assert all("before the positions" in text for text in told.values())


@pytest.mark.parametrize(
    ("late", "told", "stays"), [(True, False, False), (True, True, True), (False, False, True)]
)
def test_a_lag_that_nothing_tells_is_none_beside_positions_that_are_late(
    late: bool, told: bool, stays: bool, make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """A spool of 30 +- 2000 Hz predicts what is read as late, too: it is that lateness."""
    run = _run(make_run, 0.0)
    q = np.concatenate([run.q[:1].repeat(3, axis=0), run.q[:-3]])
    work = lay_out(replace(run, q=q) if late else run)
    spec = EffectSpec("valve_spool_lag", "lift_valve", {"frequency": 30.0, "damping": 0.8})
    term = resolve(replace(load_robot("xs031"), effects=(spec,)))[0]
    whole = fit(work.training, work.base.model.with_term(term))
    deviation = 1e-6 if told else 1e4
    whole = replace(whole, refined=deviation**2 * np.eye(len(whole.names)))
    named: Any = SimpleNamespace(term=whole.model.terms[-1])
    finding = Finding(named, Verification(1e-4, {}, {}, 0.0, True, ""), ("lift/flow_a",))
    less, kept, refused = without_late(work, whole, [finding])
    assert (kept == [finding]) is stays
    assert (less is whole) is stays
    assert all("read late" in one.verification.reason for one in refused)
    assert len(refused) + len(kept) == 1


@pytest.mark.thorough
def test_what_is_later_than_half_a_cycle_is_the_effect(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """The base goes to its end, the effect says more; in the model it has all of it."""
    run = _run(make_run, 0.0)
    p_a, p_b = (np.concatenate([p[:1], p[:-1]]) for p in (run.p_a, run.p_b))
    work = lay_out(replace(run, p_a=p_a, p_b=p_b))
    most = largest_skew(0, work.training.cycle_s)
    *skews, torques = work.base.model.skews_s
    assert torques == 0.0
    assert skews == pytest.approx((most,) * len(skews))
    # How late they are is not told there, nor how well.
    robot = robot_of(work.training.predictor, work.base, work.robot)
    told = [n for n in robot.notes if n.startswith("the pressure of")]
    assert len(told) == len(skews)
    assert told[0] == (
        "the pressure of lift_cylinder/a is read 1.00 ms or more after positions, as far as a base"
        " goes: taken out, not in the model"
    )
    found = _fitted(work, work.base, LATE)
    assert found.gain > 1000.0
    assert resolved(work.training, work.base, found)
    # Beside skews that something else has pulled the other way it only brings them back.
    back = replace(found.fitted.model, skews_s=(*(-most for _ in skews), 0.0))
    pulled = replace(found, fitted=replace(found.fitted, model=back))
    assert not resolved(work.training, work.base, pulled)
    whole = settled(work.training, fit(work.training, found.fitted.model))
    assert not any(whole.model.skews_s)
    assert whole.model.terms[0].parameters[0] == pytest.approx(STEP_S, rel=0.1)
    at = list(work.training.predictor.skew_columns.values())
    assert not whole.columns[:, at].any()


@pytest.mark.thorough
def test_a_known_base_knows_no_skew(make_run: Make) -> None:
    """With a fixed base the readings' own skew is fitted still."""
    true_crane, _ = make_run
    found = []
    for skew_s in (0.0, 3.0e-4):
        sources = sources_of([_run(make_run, skew_s).recording()])
        surveys = [survey_source(source, true_crane()) for source in sources]
        work = residuals(true_crane(), sources, [], surveys, DiagnosisSettings(fixed_base=True))
        assert work is not None
        found.append(work.base.model.skews_s[0])
    assert found[1] - found[0] == pytest.approx(3.0e-4, rel=0.1)


@pytest.mark.thorough
def test_pressures_far_later_than_a_cycle_are_tried_as_late_as_they_are(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """Reversals turn in milliseconds: what lateness does to them is no multiple of a shorter's."""
    rubbing = EffectSpec("coulomb_friction", "lift_cylinder", {"force": 5e3})
    run, cycles = _run(make_run, 0.0, rubbing), 7
    p_a, p_b = (
        np.concatenate([np.repeat(p[:1], cycles, axis=0), p[:-cycles]]) for p in (run.p_a, run.p_b)
    )
    work = lay_out(replace(run, p_a=p_a, p_b=p_b))
    (friction,) = resolve(replace(load_robot("xs031"), effects=(rubbing,)))
    current = fit(work.training, work.base.model.with_term(friction))
    trials = [e for e in work.bank.entries(current.model) if e.trial.name == LATE.name]
    scores = {
        float(e.trial.active.parameters[0]): score(current.bench, e, work.training.mask)
        for e in trials
        if e.trial.target == "xs031"
    }
    best = max(scores, key=lambda delay_s: scores[delay_s].value)
    assert best == pytest.approx(cycles * STEP_S, rel=0.2)
