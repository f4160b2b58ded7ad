"""Laws of one valve's flow, in series: rows and contributions are those of the roll-out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.mismatch.fitting.slopes import slopes_at, start_at
from hydro_ident.mismatch.fitting.stepping import with_values
from hydro_ident.mismatch.fitting.training import start_model
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.rests import moving_rows
from hydro_ident.mismatch.trials.scoring import Bank
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, FloatArray, Robot

Lay = Callable[[Robot, Recording], Predictor]
LIFT = "lift_cylinder"
HOLDING = EffectSpec(
    "counterbalance_valve", LIFT,
    {"restriction": 5.0, "setting": 2e6, "range": 2e7, "pilot_ratio": 1.0},
)  # fmt: skip
CUSHION = EffectSpec("end_cushion", LIFT, {"strength": 0.9, "length": 0.45})
HELD_OUT = EffectSpec(
    "pressure_compensation", LIFT, {"share": 0.5, "margin": 1e6, "outflow": 0.6}
)  # fmt: skip
GIVING = (
    EffectSpec("supply_droop", "xs031", {"resistance": 4e9, "time_constant": 0.02}),
    EffectSpec("tank_back_pressure", "xs031", {"resistance": 4e12, "time_constant": 0.01}),
)
BAND = EffectSpec("valve_deadband", LIFT, {"width": 0.03})


def _machine(
    make_run: tuple, predictor_of: Lay, effects: tuple[EffectSpec, ...]
) -> tuple[Predictor, Model]:
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), effects=effects)
    given = simulated_run(truth, 6.0, noisy=False).recording()
    predictor = predictor_of(truth, given)
    return predictor, start_model(truth, predictor, resolve(truth))


@pytest.fixture(scope="module")
def in_series(make_run: tuple, predictor_of: Lay) -> tuple[Predictor, Model]:
    """A run without noise of a machine with three restrictions of one valve's flow."""
    return _machine(make_run, predictor_of, (HOLDING, CUSHION, HELD_OUT, BAND))


@pytest.fixture(scope="module")
def on_soft_rails(make_run: tuple, predictor_of: Lay) -> tuple[Predictor, Model]:
    """One whose rails give way by what three laws leave of the valves' flows."""
    both = replace(HELD_OUT, target="xs031", parameters={**HELD_OUT.parameters, "share": 1.0})
    return _machine(make_run, predictor_of, (*GIVING, both, HOLDING))


def _moving(predictor: Predictor) -> FloatArray:
    """Rows of the lift cylinder's balances while it moves."""
    own = [k for k, name in enumerate(predictor.material.channels) if name.startswith("lift/flow")]
    return np.asarray(np.isin(predictor.material.channel, own) & moving_rows(predictor.material))


def test_the_true_laws_leave_nothing(in_series: tuple[Predictor, Model]) -> None:
    """Added up, each of the undiminished flow, they took more than flows out."""
    predictor, model = in_series
    rows = _moving(predictor)
    assert rows.sum() > 100
    left = predictor.residual(model)[rows]
    for term in model.terms:
        if term.effect.name == "valve_deadband":
            continue
        own = predictor.contribution(model, term)[rows]
        assert left.std() < 0.03 * own.std(), term.effect.name


@pytest.mark.parametrize("machine", ["in_series", "on_soft_rails"])
def test_a_fit_starts_from_the_prediction_itself(
    machine: str, request: pytest.FixtureRequest
) -> None:
    """Contributions of laws in series, added up, count twice what they leave each other."""
    predictor, model = request.getfixturevalue(machine)
    start, rows = start_at(predictor, model), _moving(predictor)
    whole = predictor.residual(model)
    assert start.residual == pytest.approx(whole, rel=1e-9, abs=1e-9 * float(np.ptp(whole)))
    added = [v for v in start.own if v is not None]
    assert np.std((sum(added) - sum(v for v in start.shares if v is not None))[rows]) > (
        10.0 * whole[rows].std()
    )


def test_slopes_of_edges_have_what_laws_in_series_make_of_them(
    in_series: tuple[Predictor, Model],
) -> None:
    predictor, model = in_series
    columns, names = slopes_at(predictor, start_at(predictor, model))
    rows, valve = _moving(predictor), model.robot.valves[0]
    for edge in ("c_pa", "c_bt"):
        name, step = f"lift_valve.{edge}", 1e-4 * getattr(valve, edge)
        wider = with_values(model.robot, {name: getattr(valve, edge) + step})
        later = predictor.residual(replace(model, robot=wider))
        change = ((predictor.residual(model) - later) / step)[rows]
        assert np.std(change - columns[rows, names.index(name)]) < 1e-3 * np.std(change), edge


def test_what_a_law_gains_beside_others_is_what_it_leaves_out(
    in_series: tuple[Predictor, Model],
) -> None:
    """With what the laws behind it then have more to restrict; the overlap's, too."""
    predictor, model = in_series
    whole = predictor.residual(model)
    for term in model.terms:
        without = replace(model, terms=tuple(t for t in model.terms if t is not term))
        gained = predictor.residual(without) - whole
        contribution = predictor.contribution(model, term)
        assert contribution == pytest.approx(gained, rel=1e-6, abs=1e-9 * np.ptp(gained))


def test_trials_are_evaluated_anew_behind_a_law_of_the_same_flow(
    in_series: tuple[Predictor, Model],
) -> None:
    predictor, model = in_series
    plain = replace(model, terms=())
    holding = next(t for t in model.terms if t.effect.name == "counterbalance_valve")
    bank = Bank(predictor)
    excluded = {
        (trial.name, trial.target)
        for trial in (entry.trial for entry in bank.entries(plain))
        if (trial.name, trial.target) != ("end_cushion", LIFT)
    }
    alone, behind = (bank.entries(m, excluded) for m in (plain, plain.with_term(holding)))
    assert len(alone) == len(behind)
    sizes = [np.abs(entries[0].values).sum() for entries in (alone, behind)]
    assert sizes[1] < 0.9 * sizes[0]


def test_rails_that_give_way_by_what_passes_leave_nothing(
    on_soft_rails: tuple[Predictor, Model],
) -> None:
    """By the edges' own flows the supply gave way up to five times too much."""
    predictor, model = on_soft_rails
    rows = _moving(predictor)
    left = predictor.residual(model)[rows]
    own = [term for term in model.terms if term.cylinder != 1]
    assert len(own) == 4
    for term in own:
        without = replace(model, terms=tuple(t for t in model.terms if t is not term))
        gained = (predictor.residual(without) - predictor.residual(model))[rows]
        contribution = predictor.contribution(model, term)[rows]
        assert contribution == pytest.approx(gained, rel=1e-6, abs=1e-9 * np.ptp(gained))
        if term.effect.name == "pressure_compensation":
            assert left.std() < 0.01 * contribution.std()
