"""Rows, base columns and contributions against the simulated machine they are of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.estimate.chambers import WindowSettings
from hydro_ident.estimate.derivatives import FilterSettings
from hydro_ident.estimate.force_rows import force_model
from hydro_ident.estimate.traces import traces_of
from hydro_ident.mismatch.candidates import trials
from hydro_ident.mismatch.fitting import fit
from hydro_ident.mismatch.handover import handed_over
from hydro_ident.mismatch.laying import material_of
from hydro_ident.mismatch.material import Material
from hydro_ident.mismatch.modelled import on_signals
from hydro_ident.mismatch.parts import spread_parts
from hydro_ident.mismatch.prediction import Model, Predictor
from hydro_ident.mismatch.shaping import Signals
from hydro_ident.mismatch.skew import least_skew
from hydro_ident.mismatch.slopes import start_at
from hydro_ident.mismatch.stepping import moved
from hydro_ident.mismatch.testable import untestable
from hydro_ident.mismatch.training import Training, start_model
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, Robot

EFFECTS = (
    EffectSpec("coulomb_friction", "lift_cylinder", {"force": 2500.0}),
    EffectSpec("valve_null_bias", "tilt_valve", {"bias": 0.006}),
    EffectSpec("internal_leakage", "lift_cylinder", {"coefficient": 4e-13}),
    EffectSpec("dead_volume", "tilt_cylinder", {"volume_a": 9e-4, "volume_b": 1.1e-3}),
)


def _material(robot: Robot, given: Recording) -> Material:
    windows = WindowSettings(max_delay_cycles=6.0)
    forces = force_model(robot)
    return material_of(robot, forces, traces_of([given]), FilterSettings(), windows, {})


@pytest.fixture(scope="module")
def true_model(make_run: tuple) -> tuple[Predictor, Model]:
    """A run of a machine with effects, and the model that knows all of it."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), effects=EFFECTS)
    given = simulated_run(truth, 12.0).recording()
    predictor = Predictor(_material(truth, given))
    start = start_model(truth, predictor, resolve(truth))
    delays = (truth.command_delay_s,) * len(truth.cylinders)
    return predictor, replace(start, delays_s=delays)


def test_the_true_model_leaves_noise_alone(true_model: tuple[Predictor, Model]) -> None:
    predictor, model = true_model
    residual, material = predictor.residual(model), predictor.material
    y, _ = predictor.base(model)
    moving = material.moving()
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
    make_run: tuple,
) -> None:
    true_crane, simulated_run = make_run
    given = simulated_run(true_crane(), 6.0).recording()
    lost = replace(given, q=np.where([False, True], np.nan, given.q))
    predictor = Predictor(_material(given.robot, lost))
    assert {c for c in predictor.material.channels if "flow" in c} == {
        "lift/flow_a",
        "lift/flow_b",
    }
    model = start_model(given.robot, predictor, ())
    tried = list(trials(predictor, model, ("end_cushion",)))
    assert {t.target for t in tried} == {"lift_cylinder"}


def test_rails_that_give_way_take_no_rows_where_a_transducer_is_lost(make_run: tuple) -> None:
    """One of another cylinder: with a law on a rail as many rows count as without."""
    true_crane, simulated_run = make_run
    given = simulated_run(true_crane(), 6.0).recording()
    assert given.p_a is not None
    lost = replace(given, p_a=np.where([True, False], np.nan, given.p_a))
    predictor = Predictor(_material(given.robot, lost))
    model = start_model(given.robot, predictor, ())
    droop = EffectSpec("supply_droop", "xs031", {"resistance": 2e9, "time_constant": 0.05})
    (one,) = resolve(replace(given.robot, effects=(droop,)))
    swept, _ = predictor.base(model)
    assert np.count_nonzero(swept) > 0.9 * swept.size
    assert np.array_equal(predictor.base(model.with_term(one))[0], swept)


@pytest.fixture(scope="module")
def drooping(make_run: tuple) -> tuple[Predictor, Model]:
    """A run without noise of a machine whose supply gives way and whose valves are 5 ms late."""
    true_crane, simulated_run = make_run
    droop = EffectSpec("supply_droop", "xs031", {"resistance": 4e9, "time_constant": 0.02})
    truth = replace(true_crane(), command_delay_s=0.005, effects=(droop,))
    given = simulated_run(truth, 6.0, noisy=False).recording()
    predictor = Predictor(_material(truth, given))
    return predictor, replace(start_model(truth, predictor, resolve(truth)), delays_s=(0.005,) * 2)


def test_a_supply_gives_way_when_the_late_valves_draw(drooping: tuple[Predictor, Model]) -> None:
    """Of the true droop nothing is left; by prompt valves half a percent of it was."""
    predictor, model = drooping
    flows = np.isin(predictor.material.channel, np.flatnonzero(
        ["/flow_" in name for name in predictor.material.channels]
    ))  # fmt: skip
    flows &= predictor.material.moving()
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


def test_a_refit_of_everything_finds_the_truth(true_model: tuple[Predictor, Model]) -> None:
    predictor, model = true_model
    training = Training.of(predictor, predictor.material.moving())
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
    training = Training.of(predictor, predictor.material.moving())
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
    stretch = predictor.signals.stretches(model.with_term(one))[0]
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
    training = Training.of(predictor, own.moving())
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


def test_what_a_late_pressure_takes_over_is_its_own_chambers(
    true_model: tuple[Predictor, Model],
) -> None:
    predictor, model = true_model
    skews_s = (1e-4, 2e-4, 3e-4, 4e-4)
    spec = EffectSpec("pressure_delay", "tilt_cylinder/a", {"delay": 0.004})
    (late,) = resolve(replace(model.robot, effects=(spec,)))
    later = handed_over(predictor, replace(model, terms=(late,), skews_s=skews_s), 0.002, {})
    assert later.skews_s == (1e-4, 2e-4, 0.0, 4e-4)
    assert later.terms[0].parameters[0] == pytest.approx(0.0043)
    assert least_skew(late, predictor.skew_columns, skews_s) == 3e-4
    # Where the first cylinder was not recorded, the chamber is still the same one.
    assert least_skew(late, (2, 3), skews_s) == 3e-4
    assert least_skew(late, (2, 3), ()) == 0.0


@pytest.mark.parametrize(
    ("delays_s", "handed_s", "late_s"),
    [
        ((0.0030, 0.0026), (0.0024, 0.0020), 0.0046),
        # A valve that another law has made quick makes no other later than a step may.
        ((0.0025, 0.0011), (0.0025, 0.0011), 0.0040),
        ((0.0022, 0.0011), (0.0025, 0.0014), 0.0037),
    ],
)
def test_no_valve_is_handed_more_than_a_base_may_have(
    true_model: tuple[Predictor, Model],
    delays_s: tuple[float, float],
    handed_s: tuple[float, float],
    late_s: float,
) -> None:
    predictor, model = true_model
    spec = EffectSpec("command_delay", "xs031", {"delay": 0.004})
    (late,) = resolve(replace(model.robot, effects=(spec,)))
    longest_s = dict.fromkeys(predictor.delay_columns, 0.0025)
    given = replace(model, terms=(late,), delays_s=delays_s)
    handed = handed_over(predictor, given, 0.002, longest_s)
    assert handed.delays_s == pytest.approx(handed_s)
    assert handed.terms[0].parameters[0] == pytest.approx(late_s)


@pytest.mark.parametrize("target", ["xs031", "lift_valve"])
@pytest.mark.parametrize(
    ("late_s", "delays_s"),
    [(0.004, (0.003, 0.0026)), (0.001, (0.0002, 0.0004)), (0.0999, (0.0025, 0.0024))],
)
def test_valves_are_as_late_after_a_handover_as_before(
    true_model: tuple[Predictor, Model], target: str, late_s: float, delays_s: tuple[float, float]
) -> None:
    """Also where the effect comes to an end of its range: the base keeps what it cannot take."""
    predictor, model = true_model
    spec = EffectSpec("command_delay", target, {"delay": late_s})
    (late,) = resolve(replace(model.robot, effects=(spec,)))
    longest_s = dict.fromkeys(predictor.delay_columns, 0.0025)
    given = replace(model, terms=(late,), delays_s=delays_s)
    handed = handed_over(predictor, given, 0.002, longest_s)
    for i in predictor.delay_columns if target == "xs031" else (0,):
        before, after = (m.delays_s[i] + m.terms[0].parameters[0] for m in (given, handed))
        assert after == pytest.approx(before, abs=1e-12)


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
    signals.shaped(beside, signals.stretches(beside)[0])
    np.testing.assert_array_equal(signals.wet(model, stretch, 0), before)


def test_a_start_has_what_all_terms_contribute(true_model: tuple[Predictor, Model]) -> None:
    """Friction, a null bias, a leak, a volume and a load: what is left is the residual."""
    predictor, model = true_model
    spec = EffectSpec("payload_change", "xs031", {"mass": 40.0, "start_s": 5.0})
    whole = model.with_term(resolve(replace(model.robot, effects=(spec,)))[0])
    start = start_at(predictor, whole)
    assert np.array_equal(start.residual, predictor.residual(whole))
    assert not np.allclose(start.residual, predictor.residual(model))
