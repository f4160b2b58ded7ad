"""Rows, base columns and contributions against the simulated machine they are of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.slopes import start_at
from hydro_ident.mismatch.fitting.stepping import moved
from hydro_ident.mismatch.fitting.training import Training, start_model
from hydro_ident.mismatch.rows.law_signals import dry_rows
from hydro_ident.mismatch.rows.laying import material_of
from hydro_ident.mismatch.rows.modelled import on_signals
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.rests import moving_rows
from hydro_ident.mismatch.rows.shaping import Signals
from hydro_ident.mismatch.rows.testable import untestable
from hydro_ident.mismatch.split.parts import spread_parts
from hydro_ident.mismatch.trials.candidates import trials
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.hydraulics.cylinder import lever
from hydro_model.robot import EffectSpec, Robot


def test_the_true_model_leaves_noise_alone(true_model: tuple[Predictor, Model]) -> None:
    predictor, model = true_model
    residual, material = predictor.residual(model), predictor.material
    y, _ = predictor.base(model)
    moving = moving_rows(material)
    for k, name in enumerate(material.channels):
        own = (material.channel == k) & moving
        share = residual[own].std() / y[own].std()
        assert share < (0.02 if "force" in name else 0.01), name


def test_leaving_an_effect_out_leaves_its_contribution(
    true_model: tuple[Predictor, Model],
) -> None:
    predictor, model = true_model
    whole = predictor.residual(model)
    for term in model.terms:
        rest = replace(model, terms=tuple(t for t in model.terms if t is not term))
        contribution = predictor.contribution(model, term)
        assert contribution.any(), term.effect.name
        left = predictor.residual(rest)
        assert left == pytest.approx(whole + contribution, rel=1e-6, abs=1e-9 * np.ptp(left))


def test_contributions_are_linear_in_linear_parameters(
    true_model: tuple[Predictor, Model],
) -> None:
    predictor, model = true_model
    for term in model.terms:
        linear = list(term.effect.linear)
        if not linear:
            continue
        double = term.parameters.copy()
        double[linear] *= 2.0
        once = predictor.contribution(model, term)
        assert predictor.contribution(model, term, double) == pytest.approx(2.0 * once, rel=1e-9)


def test_a_cylinder_whose_position_is_unknown_has_no_cushions_to_try(
    make_run: tuple, predictor_of: Callable[[Robot, Recording], Predictor]
) -> None:
    true_crane, simulated_run = make_run
    given = simulated_run(true_crane(), 6.0).recording()
    lost = replace(given, q=np.where([False, True], np.nan, given.q))
    predictor = predictor_of(given.robot, lost)
    assert {c for c in predictor.material.channels if "flow" in c} == {
        "lift/flow_a",
        "lift/flow_b",
    }
    model = start_model(given.robot, predictor, ())
    tried = list(trials(predictor, model, ("end_cushion",)))
    assert {t.target for t in tried} == {"lift_cylinder"}


def test_a_load_adds_the_same_whatever_was_asked_before(
    true_model: tuple[Predictor, Model],
) -> None:
    """What is kept of one load's torques is neither another load's nor another instant's."""
    predictor, model = true_model
    robot = model.robot
    loads = [(30.0, 2.0), (30.0, 6.0), (-12.0, 6.0), (55.0, 1.0), (8.0, 3.0), (30.0, 2.0)]
    others = [(robot, mass, start) for mass, start in loads]
    tilted = replace(robot, gravity_m_s2=(0.4, 0.0, -9.8))
    others += [(tilted, 30.0, 2.0), (robot, 30.0, 2.0)]
    for given, mass, start in others:
        at = EffectSpec("payload_change", robot.name, {"mass": mass, "start_s": start})
        [load] = resolve(replace(given, effects=(at,)))
        changed = replace(model, robot=given)
        fresh = Predictor(predictor.material).contribution(changed, load)
        assert fresh.any()
        assert np.array_equal(predictor.contribution(changed, load), fresh)


def test_below_a_mode_nothing_changes(true_model: tuple[Predictor, Model]) -> None:
    """A mode far above the motion takes nothing from either joint, whichever one accelerates."""
    predictor, model = true_model
    (first,) = predictor.material.stretches
    assert first.moved is not None
    stiff = {"inertia": 300.0, "frequency": 40.0, "damping": 0.7}
    spec = EffectSpec("structural_flexibility", "tilt_cylinder", stiff)
    (mode,) = resolve(replace(model.robot, effects=(spec,)))
    added = predictor.contribution(model, mode)
    turned = 300.0 * float(np.std(first.moved.qdd[:, 0]))
    for k, cylinder in enumerate(model.robot.cylinders):
        force = turned / float(np.abs(lever(cylinder, first.moved.q[:, k])).max())
        assert float(np.std(added[predictor.material.channel == k])) < 0.05 * force


def test_a_refit_of_everything_finds_the_truth(true_model: tuple[Predictor, Model]) -> None:
    predictor, model = true_model
    training = Training.of(predictor, moving_rows(predictor.material))
    off = tuple(
        replace(t, parameters=np.where([p.optional for p in t.effect.parameters], 1.0, 0.7)
                * t.parameters)
        for t in model.terms
    )  # fmt: skip
    found = fit(training, replace(model, terms=off), passes=4)
    values = {t.effect.name: t.parameters for t in found.model.terms}
    assert values["coulomb_friction"][0] == pytest.approx(2500.0, rel=0.03)
    assert values["valve_null_bias"][0] == pytest.approx(0.006, rel=0.03)
    assert values["internal_leakage"][0] == pytest.approx(4e-13, rel=0.1)
    assert values["dead_volume"] == pytest.approx([9e-4, 1.1e-3], rel=0.1)


def test_a_null_bias_finds_its_sign(true_model: tuple[Predictor, Model]) -> None:
    predictor, model = true_model
    training = Training.of(predictor, moving_rows(predictor.material))
    wrong = tuple(
        replace(t, parameters=-0.3 * t.parameters) if t.effect.name == "valve_null_bias" else t
        for t in model.terms
    )
    found = fit(training, replace(model, terms=wrong), passes=4)
    bias = next(t for t in found.model.terms if t.effect.name == "valve_null_bias")
    assert bias.parameters[0] == pytest.approx(0.006, rel=0.03)


def test_every_testable_effect_has_finite_columns(true_model: tuple[Predictor, Model]) -> None:
    predictor, model = true_model
    bare = replace(model, terms=())
    seen = set()
    for trial in trials(predictor, bare):
        if trial.name not in seen:
            seen.add(trial.name)
            columns = trial.columns(predictor, bare)
            assert columns.shape == (predictor.material.size, len(trial.units))
            assert np.isfinite(columns).all(), trial.name
    missing = {n for n, e in CATALOGUE.items() if not untestable(predictor.material, e)} - seen
    assert not missing


def test_forces_alone_show_late_pressures_and_no_late_command(
    true_model: tuple[Predictor, Model],
) -> None:
    """Bags without commands: the piston's force is of the pressures' instant, as it is read."""
    material = true_model[0].material
    forces = [k for k in range(len(material.channels)) if not material.is_flow(k)]
    seen = replace(material, channels=tuple(material.channels[k] for k in forces))
    assert untestable(seen, CATALOGUE["pressure_delay"]) == ""
    assert "no flow channel" in untestable(seen, CATALOGUE["command_delay"])


def test_effects_of_a_recorded_rail_are_candidates(true_model: tuple[Predictor, Model]) -> None:
    """Its transducer may sit at the pump or the reservoir, a line away from the valves."""
    predictor, _ = true_model
    material = predictor.material
    stretch = material.stretches[0]
    rails = {"supply": stretch.trace.supply + 1e5, "tank": stretch.trace.tank + 1e3}
    trace = replace(stretch.trace, **rails)
    seen = replace(material, stretches=(replace(stretch, trace=trace),))
    for name in ("supply_droop", "tank_back_pressure"):
        assert not untestable(seen, CATALOGUE[name])


def test_a_sensor_that_is_corrected_reads_the_truth(true_model: tuple[Predictor, Model]) -> None:
    predictor, model = true_model
    spec = EffectSpec("pressure_sensor_bias", "lift_cylinder/a", {"bias": 5.0e4})
    one = resolve(replace(model.robot, effects=(spec,)))[0]
    stretch = predictor.signals.readings.stretches(model.with_term(one))[0]
    true = predictor.material.stretches[0].trace
    assert stretch.trace.p_a[:, 0] == pytest.approx(true.p_a[:, 0] - 5.0e4)
    area = model.robot.cylinders[0].area_a_m2
    force = predictor.contribution(model, one)[predictor.material.channel == 0]
    assert force == pytest.approx(np.full(force.size, 5.0e4 * area), rel=1e-6)


def test_parts_of_a_long_recording_keep_its_time_axis(
    true_model: tuple[Predictor, Model],
) -> None:
    trace = true_model[0].material.stretches[0].trace
    assert spread_parts((trace,), 150.0)[0] is trace
    long = replace(trace, step_s=0.1, time_s=np.arange(trace.samples) * 0.1)
    parts = spread_parts((long,), 150.0)
    assert len(parts) == 15
    assert sum(p.samples for p in parts) * 0.1 == pytest.approx(150.0, rel=0.01)
    for part in parts:
        assert part.time_s[0] == pytest.approx(part.cycle * 0.1)
        assert part.recording == long.recording


def test_numbers_of_a_cylinder_are_its_own_wherever_it_is_alone(
    true_model: tuple[Predictor, Model],
) -> None:
    """Recordings to check on may lack the first cylinder: the second keeps its own numbers."""
    predictor, model = true_model
    robot, (stretch,) = predictor.material.robot, predictor.material.stretches
    trace = stretch.trace
    unknown = np.where([True, False], np.nan, np.ones((trace.samples, 1)))
    alone = replace(
        trace, p_a=trace.p_a * unknown, p_b=trace.p_b * unknown,
        valve_signal=trace.valve_signal * unknown,
    )  # fmt: skip
    own = predictor.material
    there = Predictor(
        material_of(robot, own.forces, [alone], own.filters, own.windows, {}, own.rest_speed)
    )
    assert set(there.names) < set(predictor.names)
    # As a fit leaves them: a step from a model that has none yet.
    training = Training.of(predictor, moving_rows(own))
    step = np.zeros(len(predictor.names))
    for columns in (predictor.ripple_columns, predictor.skew_columns):
        for k, at in enumerate(columns.values()):
            step[at] = 1e-5 * (k + 1)
    fitted = moved(training, replace(model, terms=()), step)
    everywhere = dict(zip(predictor.names, predictor.parameters(fitted), strict=True))
    told = dict(zip(there.names, there.parameters(fitted), strict=True))
    assert everywhere["lift_cylinder.pressure_skew_b"] == pytest.approx(2e-5)
    assert everywhere["tilt_cylinder.pressure_skew_a"] == pytest.approx(3e-5)
    assert told == {name: everywhere[name] for name in there.names}


@pytest.mark.parametrize(
    ("name", "target", "parameters"),
    [
        ("encoder_offset", "lift", {"offset": 0.01}),
        ("pressure_sensor_gain", "tilt_cylinder/b", {"error": 0.02}),
        ("valve_spool_lag", "lift_valve", {"frequency": 40.0, "damping": 0.7}),
        ("supply_droop", "xs031", {"resistance": 2e9, "time_constant": 0.05}),
    ],
)
def test_a_change_of_what_is_in_the_signals_is_that_of_its_contribution(
    true_model: tuple[Predictor, Model], name: str, target: str, parameters: dict[str, float]
) -> None:
    """Beside a sensor and a spool that are off as well."""
    predictor, model = true_model
    specs = (
        EffectSpec("pressure_sensor_bias", "lift_cylinder/a", {"bias": 5.0e4}),
        EffectSpec("valve_deadband", "tilt_valve", {"width": 0.02}),
        EffectSpec(name, target, parameters),
    )
    *others, one = resolve(replace(model.robot, effects=specs))
    whole = replace(model, terms=(*model.terms, *others, one))
    moved = one.parameters * 1.2
    expected = predictor.contribution(whole, one, moved) - predictor.contribution(whole, one)
    assert np.abs(expected).max() > 0.0
    found = predictor.change(whole, one, moved)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert on_signals(one)


@pytest.mark.parametrize("name", [n for n, e in CATALOGUE.items() if e.change and not e.reading])
def test_a_change_of_the_robot_is_in_no_signal(name: str) -> None:
    effect = CATALOGUE[name]
    values = np.array([spec.typical for spec in effect.parameters])
    assert not on_signals(ActiveEffect(effect, "xs031", values))


@pytest.mark.parametrize("other", ["edges", "pressures"])
def test_signals_of_a_model_stay_its_own_beside_another_ones_valves(
    true_model: tuple[Predictor, Model], other: str
) -> None:
    """What another model's laws make of a valve's signal is asked for in between."""
    predictor, model = true_model
    signals, [stretch] = Signals(predictor.material), predictor.material.stretches
    before = signals.wet(model, stretch, 0).copy()
    specs = [EffectSpec("valve_deadband", "lift_valve", {"width": 0.02})]
    specs += [EffectSpec("pressure_sensor_bias", "lift_cylinder/a", {"bias": 5.0e4})]
    valves = tuple(replace(v, c_pa=1.5 * v.c_pa) for v in model.robot.valves)
    robot = replace(model.robot, valves=valves) if other == "edges" else model.robot
    terms = resolve(replace(robot, effects=tuple(specs if other == "pressures" else specs[:1])))
    beside = replace(model, robot=robot, terms=tuple(terms))
    signals.shaped(beside, signals.readings.stretches(beside)[0])
    np.testing.assert_array_equal(signals.wet(model, stretch, 0), before)


def test_a_start_has_what_all_terms_contribute(true_model: tuple[Predictor, Model]) -> None:
    """Friction, a null bias, a leak, a volume and a load: what is left is the residual."""
    predictor, model = true_model
    spec = EffectSpec("payload_change", "xs031", {"mass": 40.0, "start_s": 5.0})
    whole = model.with_term(resolve(replace(model.robot, effects=(spec,)))[0])
    start = start_at(predictor, whole)
    assert np.array_equal(start.residual, predictor.residual(whole))
    assert not np.allclose(start.residual, predictor.residual(model))


@pytest.mark.parametrize("changed", ["q", "joint_torque", "oil_c", "moved"])
def test_kept_signals_of_a_dry_joint_follow_what_they_are_made_of(
    true_model: tuple[Predictor, Model], changed: str
) -> None:
    predictor, _ = true_model
    signals, [stretch, *_] = Signals(predictor.material), predictor.material.stretches
    count = len(stretch.trace.q)
    torque, oil_c = np.full((count, 2), 60.0), np.full(count, 40.0)
    trace = replace(stretch.trace, joint_torque=torque, oil_c=oil_c)
    # Corrected positions bring a motion of their own: these are asked without one.
    own_motion = None if changed == "q" else stretch.moved
    stretch = replace(stretch, trace=trace, moved=own_motion)
    before = signals.dry(stretch, 0)
    assert signals.dry(stretch, 0) is before
    if changed == "moved":
        assert stretch.moved is not None
        other = replace(stretch, moved=replace(stretch.moved, q=stretch.moved.q + 0.1))
    else:
        value = getattr(trace, changed) + 0.1
        other = replace(stretch, trace=replace(trace, **{changed: value}))
    after = signals.dry(other, 0)
    np.testing.assert_array_equal(after, dry_rows(predictor.material.robot, other, 0))
    assert np.any(after != before)
