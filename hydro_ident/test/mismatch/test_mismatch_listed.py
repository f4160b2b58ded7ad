"""Effects of the robot file whose numbers come out far from the file's: both are told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_ident.mismatch.answer.answering import answered, base_to_search
from hydro_ident.mismatch.answer.notes import listed_notes
from hydro_ident.mismatch.answer.outcome import MATCHES, Diagnosis
from hydro_ident.mismatch.fitting.as_listed import as_listed_notes, relisted
from hydro_ident.mismatch.fitting.fitting import fit, settled
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.report.model_parameters import model_rows
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Any], Callable[..., Any]]
LIFT = "lift_cylinder"
LIFT_SHAPES = {("valve_spool_lag", LIFT, name) for name in ("frequency", "damping")}
BIAS = EffectSpec("valve_null_bias", "lift_valve", {"bias": 0.02})


def _rubbing(force: float, target: str = LIFT) -> EffectSpec:
    return EffectSpec("coulomb_friction", target, {"force": force, "velocity_scale": 0.005})


@pytest.fixture(scope="module")
def fitted(make_run: Make, lay_out: Callable[..., Residuals]) -> Callable[..., Residuals]:
    """Refitted base and listed effects, of a crane whose lift rubs with 2500 N."""
    true_crane, simulated_run = make_run
    run = simulated_run(replace(true_crane(), effects=(_rubbing(2500.0),)), 14.0)

    return lambda *listed: lay_out(run, listed=listed)


def test_numbers_far_from_the_files_are_told_with_the_files(
    fitted: Callable[..., Residuals],
) -> None:
    work = fitted(_rubbing(900.0))
    (note,) = listed_notes(work.robot, work.base)
    assert note.startswith(f"coulomb_friction of {LIFT} is in the robot file with other numbers")
    assert note.endswith(" N, listed 900 N")
    force, std = (float(v) for v in note.split("force ")[1].split(" N")[0].split(" +- "))
    assert force == pytest.approx(2500.0, rel=0.05)
    assert 0.0 < std < 0.1 * force


def test_numbers_that_agree_are_not(fitted: Callable[..., Residuals]) -> None:
    """A robot's list says them of all cylinders: of the one that has no friction it is told."""
    work = fitted(_rubbing(2300.0))
    assert listed_notes(work.robot, work.base) == []
    whole = fitted(_rubbing(2300.0, "xs031"))
    (note,) = listed_notes(whole.robot, whole.base)
    assert note.startswith("coulomb_friction of tilt_cylinder is in the robot file")


def _lag(hz: float, damping: float, joint: str) -> EffectSpec:
    shape = {"frequency": hz, "damping": damping}
    return EffectSpec("valve_spool_lag", f"{joint}_valve", shape)


@pytest.fixture(scope="module")
def slow_valves(make_run: Make, lay_out: Callable[..., Residuals]) -> Callable[..., Residuals]:
    """Refitted base, of a crane with a quick and a slow spool, its commands 1.4 ms late."""
    true_crane, simulated_run = make_run
    lags = _lag(60.0, 0.9, "lift"), _lag(9.0, 0.8, "tilt")
    crane = replace(true_crane(), command_delay_s=1.4e-3, effects=lags)
    runs = {
        biased: simulated_run(replace(crane, effects=(*lags, BIAS)[: 3 if biased else 2]), 14.0)
        for biased in (False, True)
    }

    return lambda *listed, biased=False: lay_out(runs[biased], listed=listed)


@pytest.mark.thorough
def test_of_a_quick_spool_the_data_sheet_tells_more_than_a_recording(
    slow_valves: Callable[..., Residuals],
) -> None:
    """How late it is in all is told; that it is this frequency and not some delay is not."""
    work = slow_valves(_lag(60.0, 0.9, "lift"), _lag(9.0, 0.8, "tilt"))
    assert work.training.as_listed >= LIFT_SHAPES
    lift = work.base.model.terms[0]
    assert list(lift.parameters) == [60.0, 0.9]
    assert work.base.model.delays_s == pytest.approx([1.4e-3] * 2, abs=1.5e-4)
    (note,) = as_listed_notes(work.base, work.training)
    assert f"valve_spool_lag of {LIFT} (frequency, damping)" in note
    written = robot_of(work.training.predictor, work.base, work.robot).robot
    assert f"{LIFT}.valve_spool_lag.frequency" not in written.standard_deviations


@pytest.mark.thorough
def test_a_shape_that_is_listed_wrongly_is_fitted(slow_valves: Callable[..., Residuals]) -> None:
    work = slow_valves(_lag(60.0, 0.9, "lift"), _lag(16.0, 0.8, "tilt"))
    assert work.training.as_listed == LIFT_SHAPES
    hz, damping = work.base.model.terms[1].parameters
    assert hz == pytest.approx(9.0, rel=0.03)
    assert damping == pytest.approx(0.8, rel=0.05)


def test_the_report_has_what_came_out_of_what_was_listed(
    slow_valves: Callable[..., Residuals],
) -> None:
    work = slow_valves(_lag(60.0, 0.9, "lift"), _lag(16.0, 0.8, "tilt"))
    told = robot_of(work.training.predictor, work.base, work.robot).robot
    rows = {
        row.name: row
        for row in model_rows(Diagnosis(MATCHES, work.robot, told, whole=work.base), {})
        if "spool_lag" in row.name
    }
    kept = rows[f"{LIFT}.valve_spool_lag.frequency"]
    assert (kept.value, kept.datasheet, kept.off) == (60.0, 60.0, True)
    assert kept.below == "not fitted: as given"
    moved = rows["tilt_cylinder.valve_spool_lag.frequency"]
    assert (moved.datasheet, moved.off) == (16.0, False)
    assert moved.interval is not None
    low, high = moved.interval
    assert low < moved.value < high
    assert moved.value == pytest.approx(9.0, rel=0.03)


@pytest.mark.thorough
def test_shapes_that_took_up_what_was_not_named_go_back_once_it_is(
    slow_valves: Callable[..., Residuals],
) -> None:
    work = slow_valves(_lag(60.0, 0.9, "lift"), _lag(9.0, 0.8, "tilt"), biased=True)
    assert not work.training.as_listed & LIFT_SHAPES
    assert list(work.base.model.terms[0].parameters) != [60.0, 0.9]
    (bias,) = resolve(replace(load_robot("xs031"), effects=(BIAS,)))
    whole = settled(work.training, fit(work.training, work.base.model.with_term(bias)))
    training, found = relisted(work.training, whole)
    assert training.as_listed >= LIFT_SHAPES
    assert list(found.model.terms[0].parameters) == [60.0, 0.9]
    assert found.model.terms[-1].parameters[0] == pytest.approx(0.02, abs=1e-4)
    assert found.model.delays_s[0] == pytest.approx(1.4e-3, abs=1.5e-4)


@pytest.mark.thorough
def test_an_answer_has_them_back(slow_valves: Callable[..., Residuals]) -> None:
    work = slow_valves(_lag(60.0, 0.9, "lift"), _lag(9.0, 0.8, "tilt"), biased=True)
    answer = answered(work, base_to_search(work))
    assert ("valve_null_bias", 0) in answer.names
    assert answer.work.training.as_listed >= LIFT_SHAPES
    assert answer.work.scan is answer.work.training
    assert list(answer.whole.model.terms[0].parameters) == [60.0, 0.9]


def test_what_a_file_leaves_out_is_fitted(fitted: Callable[..., Residuals]) -> None:
    """A friction's rounding that nobody listed is no data sheet's: it comes out as it is."""
    left_out = EffectSpec("coulomb_friction", LIFT, {"force": 2500.0})
    work = fitted(left_out)
    assert not work.training.as_listed
    assert as_listed_notes(work.base, work.training) == []
    given = fitted(replace(left_out, parameters={**left_out.parameters, "velocity_scale": 0.02}))
    shape = ("coulomb_friction", LIFT, "velocity_scale")
    assert shape not in given.training.as_listed
    (note,) = listed_notes(given.robot, given.base)
    assert "velocity_scale" in note
    assert "velocity_scale" not in "".join(listed_notes(work.robot, work.base))
