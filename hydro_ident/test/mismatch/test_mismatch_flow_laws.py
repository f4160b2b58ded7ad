"""Laws of the valve's edges: they act with the command, as late as that and as long held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.slopes import slopes_at, start_at
from hydro_ident.mismatch.fitting.stepping import with_values
from hydro_ident.mismatch.fitting.training import Training, start_model
from hydro_ident.mismatch.rows.flow_laws import looks_at_valve
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.rests import moving_rows
from hydro_ident.mismatch.trials.where import where_of
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.effect import Stage
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot

Make = tuple[Callable[..., Robot], Callable[..., Any]]
Lay = Callable[[Robot, Recording], Predictor]
LAWS = (
    EffectSpec("valve_underlap", "lift_valve", {"width": 0.03}),
    EffectSpec("pressure_compensation", "lift_valve", {"share": 1.0, "margin": 7e5}),
    EffectSpec(
        "counterbalance_valve", "lift_cylinder",
        {"restriction": 2.0, "setting": 5e6, "range": 2e7, "pilot_ratio": 1.0},
    ),
    EffectSpec("end_cushion", "lift_cylinder", {"strength": 0.7, "length": 0.5}),
    EffectSpec(
        "line_dynamics", "lift_cylinder", {"inertance": 2e7, "compliance": 2e-12, "damping": 0.2}
    ),
)  # fmt: skip


def _exact(make_run: Make, laid: Lay, spec: EffectSpec, delay_s: float) -> tuple[Predictor, Model]:
    """A machine with one law, without sensors' noise, and the model that knows all of it."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), effects=(spec,), command_delay_s=delay_s)
    predictor = laid(truth, simulated_run(truth, 8.0, noisy=False).recording())
    start = start_model(truth, predictor, resolve(truth))
    return predictor, replace(start, delays_s=(delay_s,) * len(truth.cylinders))


def _flows(predictor: Predictor) -> np.ndarray:
    names = predictor.material.channels
    own = [k for k, n in enumerate(names) if n.startswith("lift/flow")]
    return np.isin(predictor.material.channel, own)


@pytest.mark.parametrize("delay_s", [0.0, 0.0013, 0.006])
@pytest.mark.parametrize("spec", LAWS, ids=lambda spec: spec.name)
def test_a_law_of_the_edges_comes_with_the_command(
    spec: EffectSpec, delay_s: float, make_run: Make, predictor_of: Lay
) -> None:
    """The model that knows all leaves next to nothing of what the law does, however late."""
    predictor, model = _exact(make_run, predictor_of, spec, delay_s)
    rows, (term,) = _flows(predictor), model.terms
    left = predictor.residual(model)[rows].std()
    there = predictor.contribution(model, term)[rows].std()
    # A hose is driven by the mean of either part of an interval; the others are exact in both.
    assert left < (2e-3 if term.effect.states else 3e-4) * there
    assert there > 0.003 * predictor.base(model)[0][rows].std()


def test_slopes_of_a_delay_have_what_a_law_makes_of_it(make_run: Make, predictor_of: Lay) -> None:
    """A valve that is all compensated has no flow by its drop: nor has that a delay."""
    predictor, model = _exact(make_run, predictor_of, LAWS[1], 0.0013)
    columns, names = slopes_at(predictor, start_at(predictor, model))
    at, by_s = names.index("lift_valve.command_delay"), 2e-4
    delays = (model.delays_s[0] + by_s, *model.delays_s[1:])
    later = predictor.residual(replace(model, delays_s=delays))
    change, rows = (predictor.residual(model) - later) / by_s, _flows(predictor)
    assert np.std((change - columns[:, at])[rows]) < 0.02 * np.std(change[rows])
    base = predictor.base(model)[1][:, at]
    assert np.std((change - base)[rows]) > 0.2 * np.std(change[rows])


@pytest.mark.parametrize("edge", ["c_pa", "c_bt"])
@pytest.mark.parametrize("spec", LAWS, ids=lambda spec: spec.name)
def test_slopes_of_an_edge_have_what_a_law_makes_of_it(
    spec: EffectSpec, edge: str, make_run: Make, predictor_of: Lay
) -> None:
    predictor, model = _exact(make_run, predictor_of, spec, 0.0013)
    columns, names = slopes_at(predictor, start_at(predictor, model))
    name = f"lift_valve.{edge}"
    step = 1e-4 * getattr(model.robot.valves[0], edge)
    wider = with_values(model.robot, {name: getattr(model.robot.valves[0], edge) + step})
    later = predictor.residual(replace(model, robot=wider))
    change, rows = (predictor.residual(model) - later) / step, _flows(predictor)
    own = columns[:, names.index(name)]
    assert np.std((change - own)[rows]) < 0.02 * np.std(change[rows])


def test_delay_and_compensation_are_found_together(make_run: Make, predictor_of: Lay) -> None:
    predictor, model = _exact(make_run, predictor_of, LAWS[1], 0.0013)
    training = Training.of(predictor, moving_rows(predictor.material))
    off = replace(model.terms[0], parameters=np.array([0.7, 5e5, 0.0]))
    found = fit(training, replace(model, terms=(off,), delays_s=(0.0, 0.0)), passes=12).model
    assert found.delays_s[0] == pytest.approx(0.0013, abs=1e-5)
    share, margin_pa, outflow = found.terms[0].parameters
    assert (share, outflow) == pytest.approx((1.0, 0.0), abs=2e-3)
    # What a compensator that never lets go tells is the flow alone: c times its margin's root.
    for edge in ("c_pa", "c_pb"):
        own, known = (getattr(m.robot.valves[0], edge) for m in (found, model))
        assert own * np.sqrt(margin_pa) == pytest.approx(known * np.sqrt(7e5), rel=5e-3)


def test_what_looks_at_the_valve_is_told_by_its_laws() -> None:
    """What follows from pressures alone, or is read off a recording, is not held."""
    flows = {Stage.FLOW_A, Stage.FLOW_B}
    acting = [e for e in CATALOGUE.values() if flows & set(e.stages)]
    told = {e.name: looks_at_valve(ActiveEffect(e, 0, e.typical)) for e in acting}
    assert {name for name, looks in told.items() if looks} == {spec.name for spec in LAWS}
    assert {n for n, looks in told.items() if not looks} >= {"internal_leakage", "cavitation"}


@pytest.mark.parametrize("side", ["a", "b"])
def test_a_leak_shows_at_the_pressure_of_the_chamber_that_leaks(
    side: str, make_run: Make, predictor_of: Lay
) -> None:
    values = {"coefficient_a": 0.0, "coefficient_b": 0.0, f"coefficient_{side}": 1e-12}
    spec = EffectSpec("external_leakage", "lift_cylinder", values)
    predictor, model = _exact(make_run, predictor_of, spec, 0.0)
    training = Training.of(predictor, np.ones(predictor.material.size, dtype=bool))
    place = where_of(training, model, model.terms[0], f"lift/flow_{side}")
    assert place.variable == f"pressure_{side}"
    trace = predictor.material.stretches[0].trace
    own = (trace.p_a if side == "a" else trace.p_b)[:, 0]
    assert own.min() < place.low < place.high < own.max()
