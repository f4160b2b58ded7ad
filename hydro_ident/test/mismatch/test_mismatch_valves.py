"""Valves whose opening has a corner, or that open at a pressure: what is tried, and found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.mismatch.answer.reversed_valves import (
    reversed_notes,
    reversed_valves,
    untold,
    with_given_valves,
)
from hydro_ident.mismatch.fitting.stepping import is_free
from hydro_ident.mismatch.locating.locate import dependences
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.naming.name import Search, Searcher
from hydro_ident.mismatch.naming.worth import _opens_beside
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.state_space import SIGNALS, factor_sizes, row_values
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.candidates import trials
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.signals import VALVE_SIGNAL
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
BENT = EffectSpec("valve_gain_nonlinearity", "lift_valve", {"progression": 0.6, "knee": 0.06})


@pytest.fixture(scope="module")
def bent(make_run: Make, lay_out: Callable[..., Residuals]) -> Residuals:
    """A machine whose lift valve opens more than half as much again per volt beyond a knee."""
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(replace(true_crane(), effects=(BENT,)), 13.0))


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_what_no_row_shows_has_no_size(bent: Residuals) -> None:
    """As of a channel of which another machine's recording has nothing."""
    predictor, model = bent.training.predictor, bent.base.model
    values = {name: row_values(predictor, model, 0, name) for name in SIGNALS}
    sizes = factor_sizes(predictor, model, 0, values, np.zeros(bent.training.mask.size, np.bool_))
    assert sizes
    assert set(sizes.values()) == {1.0}


def _searched(work: Residuals) -> Search:
    return Searcher(work.training, work.base).run()


def test_knees_are_tried_where_the_valve_has_been(bent: Residuals) -> None:
    predictor, model = bent.training.predictor, bent.base.model
    chosen = [
        t.active
        for t in trials(predictor, model, ["valve_gain_nonlinearity"])
        if t.target == "lift_cylinder"
    ]
    knees = sorted(float(one.parameters[1]) for one in chosen)
    rows = np.concatenate(
        [
            predictor.signals.of(model, s, chosen[0])
            for s in predictor.signals.readings.stretches(model)
        ]
    )
    assert knees[0] == 0.0
    assert len(knees) > 2
    assert knees[-1] < np.abs(rows[:, VALVE_SIGNAL]).max()
    # A parabola has no corner to move; a corner is moved.
    assert [is_free(one, 1) for one in chosen] == [one.parameters[1] > 0.0 for one in chosen]


@pytest.mark.thorough
def test_a_knee_is_found_where_it_is(bent: Residuals) -> None:
    search = _searched(bent)
    assert [n.names for n in search.named] == [("valve_gain_nonlinearity",)]
    progression, knee = search.named[0].term.parameters
    assert progression == pytest.approx(0.6, rel=0.1)
    assert knee == pytest.approx(0.06, rel=0.1)


@pytest.mark.thorough
def test_what_is_next_to_all_that_is_left_is_no_flaw_of_the_valves_form(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """Little beside how far the valve opens, dead oil in one chamber is what is left there."""
    true_crane, simulated_run = make_run
    more = EffectSpec("valve_gain_nonlinearity", "lift_valve", {"progression": 0.8})
    dead = EffectSpec("dead_volume", "lift_cylinder", {"volume_a": 3e-4, "volume_b": 0.0})
    work = lay_out(simulated_run(replace(true_crane(), effects=(more, dead)), 13.0))
    found = _searched(work).named
    assert [n.names for n in found] == [("valve_gain_nonlinearity",), ("dead_volume",)]
    assert found[1].term.parameters[0] == pytest.approx(3e-4, rel=0.05)


@pytest.mark.thorough
def test_nothing_of_a_null_biass_form_is_left_to_look_like_air(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """A bias is one number: what is small beside it is another law's all the same."""
    true_crane, simulated_run = make_run
    off = EffectSpec("valve_null_bias", "lift_valve", {"bias": 0.06})
    foamy = EffectSpec("entrained_air", "lift_cylinder", {"fraction": 0.01})
    work = lay_out(simulated_run(replace(true_crane(), effects=(off, foamy)), 13.0))
    found = _searched(work).named
    assert [n.names for n in found] == [("valve_null_bias",), ("entrained_air",)]
    assert found[1].term.parameters[0] == pytest.approx(0.01, rel=0.05)


@pytest.mark.thorough
def test_a_load_holding_valve_of_a_low_pilot_ratio_is_found(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    true_crane, simulated_run = make_run
    values = {"restriction": 3.0, "setting": 1.7e7, "range": 8.0e6, "pilot_ratio": 1.0}
    spec = EffectSpec("counterbalance_valve", "lift_cylinder/a", values)
    search = _searched(lay_out(simulated_run(replace(true_crane(), effects=(spec,)), 13.0)))
    assert ("counterbalance_valve",) in [n.names for n in search.named]
    [term] = [n.term for n in search.named if n.names == ("counterbalance_valve",)]
    assert term.target == "lift_cylinder/a"
    assert term.parameters[1] == pytest.approx(1.7e7, rel=0.25)


def test_openings_stand_beside_openings_of_the_same_valve_alone() -> None:
    def one(name: str, valve: str, **values: float) -> Any:
        robot = replace(load_robot("xs031"), effects=(EffectSpec(name, valve, values),))
        return resolve(robot)[0]

    gap = one("valve_deadband", "lift_valve", width=0.01)
    gain = one("valve_gain_nonlinearity", "lift_valve", progression=0.1)
    bias = one("valve_null_bias", "lift_valve", bias=0.01)
    other = one("valve_deadband", "tilt_valve", width=0.01)
    assert _opens_beside(gap, (gain,))
    assert not _opens_beside(gap, (bias, other))
    assert not _opens_beside(bias, (gap, gain))


@pytest.mark.parametrize("name", ["valve_hysteresis", "valve_rate_limit", "valve_spool_lag"])
def test_a_spool_is_as_late_here_as_where_its_numbers_are_fitted(
    name: str, true_model: tuple[Predictor, Model]
) -> None:
    """What is found goes into the robot file: `identify` sees the same opening behind it."""
    predictor, model = true_model
    first = {"valve_hysteresis": "half_width", "valve_rate_limit": "rate"}
    size = {"half_width": 0.02, "rate": 5.0, "frequency": 40.0}
    own = first.get(name, "frequency")
    given = {own: size[own]} | ({"damping": 0.8} if own == "frequency" else {})
    robot = replace(model.robot, effects=(EffectSpec(name, "lift_valve", given),))
    (term,) = resolve(robot)
    [stretch] = predictor.material.stretches
    shaped = predictor.signals.shaped(replace(model, terms=(term,)), stretch)
    listed = ListedEffects.of(robot).with_signal_laws(stretch.trace)
    assert shaped.valve_signal[:, 0] == pytest.approx(listed.valve_signal[:, 0], abs=1e-12)
    assert np.abs(shaped.valve_signal - stretch.trace.valve_signal)[:, 0].max() > 0.001


@pytest.mark.thorough
def test_an_overlap_of_a_third_of_the_command_is_found(
    make_run: Make, lay_out: Callable[..., Residuals]
) -> None:
    """As pilot valves have that are driven by a current; up to 0.3 was taken for possible."""
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 13.0)
    # The commands of a driver whose valve answers beyond 0.36 to either side alone.
    signal = run.voltage / 10.0
    volts = 10.0 * np.where(signal == 0.0, 0.0, signal + np.copysign(0.36, signal))
    volts[:, 1] = run.voltage[:, 1]
    search = _searched(lay_out(replace(run, voltage=volts)))
    (found,) = search.named
    assert found.names[0] == "valve_deadband"
    assert found.term.target == "lift_cylinder"
    assert found.term.parameters[0] == pytest.approx(0.36, rel=0.02)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_signal_of_the_wrong_sign_is_said_and_no_edge_of_it_is_written(
    sign: float, crane_run: Any, lay_out: Callable[..., Residuals]
) -> None:
    """A fit keeps edges above zero, at numbers of no valve: the file's stay."""
    work = lay_out(replace(crane_run, voltage=crane_run.voltage * [sign, 1.0]))
    wrong = reversed_valves(work.training, work.base)
    left = dependences(work.training, work.base)
    told = {one.channel: one for one in untold((), wrong, work.robot, left)}
    if sign > 0.0:
        assert not wrong
        assert not told
        return
    assert list(wrong) == ["lift_valve"]
    assert "the sign of lift_valve's signal is likely reversed" in wrong["lift_valve"]
    assert set(told) == {"lift/flow_a", "lift/flow_b"}
    (note,) = reversed_notes(wrong)
    assert "stay as the robot file has them" in note
    fitted = robot_of(work.training.predictor, work.base, work.robot).robot
    stuck = replace(fitted.valves[0], c_bt=7.0e-9), fitted.valves[1]
    kept = with_given_valves(replace(fitted, valves=stuck), work.robot, tuple(wrong))
    assert kept.valves[0] == work.robot.valves[0]
    assert kept.valves[1] == fitted.valves[1]
    moduli = [c.bulk_modulus_pa for c in kept.cylinders]
    assert moduli[0] == work.robot.cylinders[0].bulk_modulus_pa
    assert moduli[1] == fitted.cylinders[1].bulk_modulus_pa
    assert not [n for n in kept.standard_deviations if n.startswith("lift_valve.c_")]
    assert "lift_cylinder.bulk_modulus" not in kept.standard_deviations
