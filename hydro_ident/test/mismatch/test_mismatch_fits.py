"""Fits of effects: taken on until there is nothing more to take, from wherever they start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.mismatch.answer.outcome import MATCHES, Diagnosis
from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import fit, fit_term, fit_without, settled
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.naming.contenders import leading
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.contender import Contender
from hydro_ident.report.model_parameters import model_rows
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

Made = tuple[Callable[..., Any], Callable[..., Any]]


def _term(name: str, target: str, **parameters: float) -> ActiveEffect:
    robot = replace(load_robot("xs031"), effects=(EffectSpec(name, target, parameters),))
    (term,) = resolve(robot)
    return term


def _laid_out(lay_out: Callable[..., Residuals], make_run: Made, effect: EffectSpec) -> Residuals:
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(replace(true_crane(), effects=(effect,)), 12.0))


def _promised(one: Fitted) -> float:
    """What a further linear step would take out, as a share."""
    return (one.start_squares - one.squares) / one.squares


def test_a_lag_and_a_delay_are_fitted_until_nothing_is_promised(
    lay_out: Callable[..., Residuals], make_run: Made
) -> None:
    lag = {"frequency": 12.0, "damping": 0.8}
    work = _laid_out(lay_out, make_run, EffectSpec("valve_spool_lag", "lift_valve", lag))
    start = _term("valve_spool_lag", "lift_valve", frequency=16.0, damping=0.8)
    begun = fit(work.training, work.base.model.with_term(start), passes=1)
    done = settled(work.training, begun)
    assert _promised(begun) > 1e-2
    assert _promised(done) < 1e-3
    frequency, damping = done.model.terms[-1].parameters
    assert damping / frequency == pytest.approx(0.8 / 12.0, rel=0.1)


@pytest.mark.parametrize(("spring", "named"), [(399.0, True), (381.0, True), (370.0, False)])
def test_what_cannot_be_the_cause_leads_by_more_than_a_hair(spring: float, named: bool) -> None:
    """A contact that is never left has the form of a spring: of what gains as much, the spring."""
    contact, held = (
        Contender(term, None, 410.0, held_out, 3.0)  # type: ignore[arg-type]
        for term, held_out in (
            (_term("external_contact", "tilt_cylinder", stiffness=1e4, height=0.1), 400.0),
            (_term("counterbalance_spring", "tilt_cylinder", force=1e3, stiffness=8e3), spring),
        )
    )
    assert leading([contact, held], [held]) is (held if named else contact)
    assert leading([held, contact], [held, contact]) is contact
    assert leading([contact, held], []) is contact


@pytest.mark.thorough
def test_the_best_of_a_contest_is_fitted_to_the_end_wherever_it_starts(
    lay_out: Callable[..., Residuals], make_run: Made
) -> None:
    """Beside a base that follows to first order alone, a far start is worse than no effect."""
    play = {"half_width": 0.01}
    work = _laid_out(lay_out, make_run, EffectSpec("valve_hysteresis", "lift_valve", play))
    without = fitted(work.training, work.base.model, work.base.bench.noise)
    noise = without.bench.noise
    start = _term("valve_hysteresis", "lift_valve", half_width=0.2)
    rough = fit_term(work.training, without, start, noise, 6)
    assert rough.squares > without.squares
    (found,) = Contest(work.training).fitted(without, [start], noise)
    assert found.gain > 0.5 * without.squares
    # A shape moves by no more than a factor of two per pass: from 0.2 four of them lead near.
    assert 0.008 < found.term.parameters[0] < 0.02


@pytest.mark.parametrize(
    ("gone", "progression", "least", "most"),
    [(0, 0.1, 1e5, 1e8), (0, 2e-3, 50.0, 5e3), (1, 0.1, 0.0, 50.0)],
)
def test_a_model_without_an_effect_is_fitted_from_the_one_with_it(
    lay_out: Callable[..., Residuals],
    make_run: Made,
    gone: int,
    progression: float,
    least: float,
    most: float,
) -> None:
    """The first step takes the slopes that are known, and numbers that their bounds held then."""
    bent = {"progression": progression, "knee": 0.0}
    work = _laid_out(lay_out, make_run, EffectSpec("valve_gain_nonlinearity", "lift_valve", bent))
    training, model = work.training, work.base.model
    for one in (
        _term("valve_gain_nonlinearity", "lift_valve", **bent),
        _term("dead_volume", "tilt_cylinder", volume_a=1e-4, volume_b=1e-4),
    ):
        model = model.with_term(one)
    whole = settled(training, fit(training, model))
    noise = whole.bench.noise
    rest = tuple(t for k, t in enumerate(whole.model.terms) if k != gone)
    without = fit_without(training, whole, rest)
    whole_way = fit(training, replace(whole.model, terms=rest), noise, passes=8)
    assert without.names == whole_way.names
    assert without.bench.noise is noise
    lost = whole_way.squares - whole.squares
    assert least <= lost <= most
    assert without.squares - whole.squares == pytest.approx(lost, rel=2e-3, abs=1.0)
    left = whole_way.start_squares - whole.squares
    assert without.start_squares - whole.squares == pytest.approx(left, rel=2e-3, abs=1.0)


@pytest.mark.thorough
def test_no_base_gives_energy_for_going_faster(
    lay_out: Callable[..., Residuals], make_run: Made
) -> None:
    """A friction that falls with speed is no viscous friction below zero: it is left over."""
    falling = {"force": 3000.0, "stribeck_velocity": 0.04, "exponent": 1.0}
    true_crane, simulated_run = make_run
    light = [replace(c, viscous_friction=500.0) for c in true_crane().cylinders]
    effect = EffectSpec("stribeck_friction", "tilt_cylinder", falling)
    truth = replace(true_crane(), cylinders=tuple(light), effects=(effect,))
    work = lay_out(simulated_run(truth, 12.0))
    predictor = work.training.predictor
    at = predictor.names.index("tilt_cylinder.viscous_friction")
    coulomb = _term("coulomb_friction", "tilt_cylinder", force=2000.0)
    for model in (work.base.model, work.base.model.with_term(coulomb)):
        fitted_there = settled(work.training, fit(work.training, model, passes=8))
        assert predictor.parameters(fitted_there.model)[at] >= 0.0
    # Beside Coulomb's law the bound holds: nothing of the column is left to fit by.
    assert predictor.parameters(fitted_there.model)[at] == 0.0
    assert not fitted_there.columns[:, at].any()
    told = robot_of(predictor, fitted_there, work.robot).robot
    assert told.cylinders[1].viscous_friction == 0.0
    assert "tilt_cylinder.viscous_friction" not in told.standard_deviations
    rows = model_rows(Diagnosis(MATCHES, work.robot, told, whole=fitted_there), {})
    (row,) = [r for r in rows if r.name == "tilt_cylinder.viscous_friction"]
    assert (row.value, row.interval, row.off) == (0.0, None, True)
    assert row.below.startswith("held at the end of what is possible")
    law = _term("stribeck_friction", "tilt_cylinder", force=2500.0, stribeck_velocity=0.03)
    whole = settled(work.training, fit(work.training, work.base.model.with_term(law), passes=8))
    assert predictor.parameters(whole.model)[at] > 0.0
    assert whole.squares < 0.5 * fitted_there.squares


def test_a_step_that_leads_nowhere_is_taken_nearer(
    lay_out: Callable[..., Residuals], make_run: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A load-holding valve of which setting and range go together, from a base that had it."""
    law = {"restriction": 1.4, "setting": 4e5, "range": 4e7, "pilot_ratio": 2.0}
    work = _laid_out(lay_out, make_run, EffectSpec("counterbalance_valve", "lift_cylinder/a", law))
    known = _term("counterbalance_valve", "lift_cylinder/a", **law)
    further = {"restriction": 5.0, "setting": 1e7, "range": 1e8, "pilot_ratio": 5.0}
    start = _term("counterbalance_valve", "lift_cylinder/a", **further)
    noise = work.base.bench.noise

    def left(term: ActiveEffect) -> float:
        return fit(work.training, work.base.model.with_term(term), noise, 12).start_squares

    least = left(known)
    assert left(start) < 1.02 * least
    monkeypatch.setattr("hydro_ident.mismatch.fitting.fitting._SHARES", (1.0,))
    assert left(start) > 1.1 * least
