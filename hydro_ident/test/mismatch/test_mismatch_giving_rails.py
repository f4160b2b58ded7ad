"""Rails that give way: whose rows they take, and what the valves' delay has to do with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.training import Training, start_model
from hydro_ident.mismatch.rows.line_flow import line_flow
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.rests import moving_rows
from hydro_ident.mismatch.trials.where import where_of
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot

Lay = Callable[[Robot, Recording], Predictor]


def test_rails_that_give_way_take_no_rows_where_a_transducer_is_lost(
    make_run: tuple, predictor_of: Lay
) -> None:
    """One of another cylinder: with a law on a rail as many rows count as without."""
    true_crane, simulated_run = make_run
    given = simulated_run(true_crane(), 6.0).recording()
    assert given.p_a is not None
    lost = replace(given, p_a=np.where([True, False], np.nan, given.p_a))
    predictor = predictor_of(given.robot, lost)
    model = start_model(given.robot, predictor, ())
    droop = EffectSpec("supply_droop", "xs031", {"resistance": 2e9, "time_constant": 0.05})
    (one,) = resolve(replace(given.robot, effects=(droop,)))
    swept, _ = predictor.base(model)
    assert np.count_nonzero(swept) > 0.9 * swept.size
    assert np.array_equal(predictor.base(model.with_term(one))[0], swept)


@pytest.fixture(scope="module")
def drooping(make_run: tuple, predictor_of: Lay) -> tuple[Predictor, Model]:
    """A run without noise of a machine whose supply gives way and whose valves are 5 ms late."""
    true_crane, simulated_run = make_run
    droop = EffectSpec("supply_droop", "xs031", {"resistance": 4e9, "time_constant": 0.02})
    truth = replace(true_crane(), command_delay_s=0.005, effects=(droop,))
    given = simulated_run(truth, 6.0, noisy=False).recording()
    predictor = predictor_of(truth, given)
    return predictor, replace(start_model(truth, predictor, resolve(truth)), delays_s=(0.005,) * 2)


def test_a_supply_gives_way_when_the_late_valves_draw(drooping: tuple[Predictor, Model]) -> None:
    """Of the true droop nothing is left; by prompt valves half a percent of it was."""
    predictor, model = drooping
    flows = np.isin(predictor.material.channel, np.flatnonzero(
        ["/flow_" in name for name in predictor.material.channels]
    ))  # fmt: skip
    flows &= moving_rows(predictor.material)
    left = predictor.residual(model)[flows]
    own = predictor.contribution(model, model.terms[0])[flows]
    assert left.std() < 5e-4 * own.std()


def test_a_supplys_lag_is_not_the_valves_delay(drooping: tuple[Predictor, Model]) -> None:
    """A fit finds 20 ms; beside prompt valves it had found 26."""
    predictor, model = drooping
    training = Training.of(predictor, np.ones(predictor.material.size, dtype=bool))
    off = tuple(replace(t, parameters=t.parameters * [0.6, 1.8]) for t in model.terms)
    found = fit(training, replace(model, terms=off, delays_s=(0.0035, 0.0035)), passes=6).model
    assert found.terms[0].parameters == pytest.approx([4e9, 0.02], rel=0.03)
    assert found.delays_s == pytest.approx((0.005, 0.005), abs=1e-4)


def test_a_rail_that_gives_way_shows_at_a_flow_of_all_valves(
    drooping: tuple[Predictor, Model],
) -> None:
    """That flow times the law's resistance is what the supply has lost, but for the lag."""
    predictor, model = drooping
    training = Training.of(predictor, np.ones(predictor.material.size, dtype=bool))
    place = where_of(training, model, model.terms[0], "lift/flow_a")
    (stretch,) = predictor.material.stretches
    lost = stretch.trace.supply - predictor.signals.shaped(model, stretch).supply
    assert place.variable == "total_flow"
    assert 0.0 <= place.low < place.high < 1.1 * lost.max() / 4e9
    number = predictor.material.channels.index("lift/flow_a")
    own = predictor.material.channel == number
    flow = line_flow(predictor, model, number, on_tank=False)
    seen = predictor.material.on_rows(stretch, number, lost)
    assert np.abs(4e9 * flow[own] - seen).mean() < 0.1 * seen.mean()
    assert np.isnan(flow[~own]).all()
    # What cylinders give back is another flow than they take, by their areas.
    back = line_flow(predictor, model, number, on_tank=True)[own]
    assert 0.0 < back.mean() != pytest.approx(flow[own].mean(), rel=0.01)


def test_what_is_kept_of_one_delays_rails_is_not_anothers(
    drooping: tuple[Predictor, Model],
) -> None:
    predictor, model = drooping
    spec = EffectSpec("valve_underlap", "lift_valve", {"width": 0.02})
    (lap,) = resolve(replace(model.robot, effects=(spec,)))
    for delay_s in (0.005, 0.002, 0.005):
        late = replace(model, delays_s=(delay_s, delay_s))
        fresh = Predictor(predictor.material)
        assert np.array_equal(predictor.contribution(late, lap), fresh.contribution(late, lap))
        assert np.array_equal(predictor.residual(late), fresh.residual(late))
