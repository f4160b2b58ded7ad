"""What is known of the base before a fit, and what that leaves for effects to be told by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.estimate.forces.closed_chain import expected_sizes
from hydro_ident.identify.model_file import write_model
from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.answer.moved_base import moved_base
from hydro_ident.mismatch.fitting.bench import Bench
from hydro_ident.mismatch.fitting.fitted import fitted
from hydro_ident.mismatch.fitting.fitting import _owned, fit
from hydro_ident.mismatch.fitting.prior import (
    Prior,
    fixed_prior,
    left_open,
    open_notes,
    parts_prior,
)
from hydro_ident.mismatch.fitting.training import start_model
from hydro_ident.mismatch.fitting.whitening import Layout, Noise
from hydro_ident.mismatch.locating.precision import drift_of
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.naming.contest import Contest
from hydro_ident.mismatch.naming.worth import worthy
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.held_out import rms
from hydro_ident.mismatch.split.residuals import Residuals, own_forces, residuals
from hydro_ident.mismatch.trials.candidates import trials
from hydro_ident.recordings.sources import sources_of
from hydro_model.effects.catalogue import resolve
from hydro_model.multibody.base_parameters import base_map, with_base
from hydro_model.robot import BaseParameter, EffectSpec, Robot
from hydro_model.robot_files import load_robot

SPRING = EffectSpec("counterbalance_spring", "lift_cylinder", {"force": -2e3, "stiffness": 5e3})
OFFSET = EffectSpec("constant_force_offset", "lift_cylinder", {"force": 2e3})
MakeRun = tuple[Callable[..., Robot], Callable[..., Any]]


@pytest.fixture(scope="module")
def work(make_run: MakeRun, lay_out: Callable[..., Residuals]) -> Residuals:
    """A machine with a spring in its lift cylinder that the datasheet lacks."""
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(replace(true_crane(), effects=(SPRING,)), 13.0))


# Bodies of cylinders --------------------------------------------------------------------------


@pytest.mark.thorough
def test_barrels_and_rods_keep_about_their_size(work: Residuals) -> None:
    """Free they would take a spring up, at many times what steel of that size weighs."""
    base = work.training.predictor.material.forces.base
    sizes = expected_sizes(work.robot, base)
    own = np.flatnonzero(np.isfinite(sizes))
    given = base.combination @ work.robot.parameter_vector
    free = fit(replace(work.training, prior=None), work.base.model)
    assert own.size
    off = {
        name: np.max(np.abs(one.model.theta[own] - given[own]) / sizes[own])
        for name, one in (("known", work.base), ("free", free))
    }
    assert off["free"] > 8.0 * off["known"]


def test_a_spring_is_not_taken_up_by_a_barrel(work: Residuals) -> None:
    """What a refit leaves of its force, with what is known of the base and without."""
    term = resolve(replace(load_robot("xs031"), effects=(SPRING,)))[0]
    column = work.training.predictor.contribution(work.base.model, term)[work.training.mask]
    left = {}
    for name, training in (("known", work.training), ("free", replace(work.training, prior=None))):
        bench = fitted(training, work.base.model, work.base.bench.noise).bench
        left[name] = float(np.linalg.norm(bench.beyond(column[:, None])))
    assert left["known"] > 3.0 * left["free"]


def test_links_alone_have_no_prior(work: Residuals) -> None:
    base = work.training.predictor.material.forces.base
    values = work.training.predictor.parameters(work.base.model)
    prior = parts_prior(work.training.predictor, work.robot, values)
    assert prior is not None
    assert set(np.flatnonzero(prior.root.any(axis=0))) == set(
        range(base.link_count, len(base.names))
    )


def test_a_kept_base_holds_what_its_file_says_it_knows(work: Residuals) -> None:
    """Masses always; of the rest what has a deviation, by so much."""
    predictor, plain = work.training.predictor, work.robot
    values = predictor.parameters(work.base.model)
    edge = f"{plain.valves[0].name}.c_pa"
    told = replace(plain, standard_deviations={edge: 1e-9, "command_delay": 2e-5})
    for robot, held in ((plain, set()), (told, {edge, *_delays(predictor)})):
        prior = fixed_prior(predictor, robot, values)
        free = [predictor.names.index(name) for name in left_open(predictor, robot)]
        base = predictor.material.forces.base.names
        assert {predictor.names[k] for k in range(values.size) if k not in free} == {*base, *held}
        assert not prior.root[:, free].any()
        known = np.linalg.matrix_rank(prior.root)
        assert known == values.size - len(free)
    at = predictor.names.index(edge)
    assert np.linalg.norm(prior.root[:, at]) == pytest.approx(1e9, rel=1e-3)
    assert "valve edges" in open_notes(predictor, plain)[0]


def test_a_kept_delay_costs_what_it_is_off_by(work: Residuals) -> None:
    """Two milliseconds are two hundred of the deviations that the file states of each valve."""
    predictor, model = work.training.predictor, work.base.model
    robot = replace(work.robot, command_delay_s=1e-3, standard_deviations={"command_delay": 1e-5})
    prior = fixed_prior(predictor, robot, predictor.parameters(model))
    kept = replace(work.training, prior=prior)
    at, off = (replace(model, delays_s=(late_s, late_s)) for late_s in (1e-3, 3e-3))
    cost = [float(np.sum(kept.offset(one) ** 2)) for one in (at, off)]
    assert cost[1] - cost[0] == pytest.approx(2 * 200.0**2, rel=1e-3)
    free = replace(kept, prior=fixed_prior(predictor, work.robot, predictor.parameters(model)))
    assert np.array_equal(free.offset(at), free.offset(off))


def test_a_delay_beyond_a_kept_one_is_an_effects(work: Residuals) -> None:
    """No cycle is granted to what was identified: all that comes beside it is left to be found."""
    predictor, model = work.training.predictor, work.base.model
    known = replace(work.robot, standard_deviations={"command_delay": 1e-5})
    prior = fixed_prior(predictor, known, predictor.parameters(model))
    kept, (late,) = replace(work.training, prior=prior), _delay_of(work.robot, 2e-3)
    stated_s = work.robot.command_delay_s
    owned = _owned(kept, replace(model, delays_s=(stated_s,) * 2, terms=(late,)))
    assert owned.delays_s == pytest.approx((stated_s,) * 2)
    assert kept.own_delay_s == stated_s < work.training.own_delay_s


@pytest.fixture(scope="module")
def identified(work: Residuals) -> Robot:
    """What a fit wrote, every base parameter of it determined."""
    robot = robot_of(work.training.predictor, work.base, work.robot).robot
    assert robot.base_covariance is not None
    assert (np.diag(robot.base_covariance) > 0.0).all()
    return robot


def test_a_kept_base_is_known_by_the_names_of_its_parameters(
    work: Residuals, identified: Robot
) -> None:
    """A file may have them in another order, and of the links alone: a barrel is then unknown."""
    predictor = work.training.predictor
    base, count = predictor.material.forces.base, predictor.material.forces.base.link_count
    turned, covariance = np.arange(count)[::-1], identified.base_covariance
    assert covariance is not None
    robot = replace(
        identified,
        base_parameters=tuple(identified.base_parameters[k] for k in turned),
        base_covariance=covariance[np.ix_(turned, turned)],
    )
    prior = fixed_prior(predictor, robot, predictor.parameters(work.base.model))
    assert not set(left_open(predictor, robot)) & set(base.names)
    own = prior.root[:, : len(base.names)]
    known = np.linalg.inv(own.T @ own)
    assert known[:count, :count] == pytest.approx(covariance[:count, :count], rel=1e-3)
    sizes = expected_sizes(robot, base)[count:]
    assert np.sqrt(np.diag(known))[count:] == pytest.approx(sizes, rel=1e-3)


def test_what_nobody_determined_is_not_kept_at_a_datasheets_value(
    work: Residuals, identified: Robot
) -> None:
    """A joint that rested has no variance: its link's 12 % would pass for a payload."""
    predictor, covariance = work.training.predictor, identified.base_covariance
    base = predictor.material.forces.base
    assert covariance is not None
    at = [k for k, name in enumerate(base.names) if name == "tilt_link.mcx"]
    rested = np.delete(np.arange(len(base.names)), at)
    values = np.array([own.value for own in identified.base_parameters])
    values[at] = (base.combination @ work.robot.parameter_vector)[at]
    known = np.zeros_like(covariance)
    known[np.ix_(rested, rested)] = covariance[np.ix_(rested, rested)]
    robot = replace(with_base(identified, base, values), base_covariance=known)
    assert "tilt_link.mcx" in left_open(predictor, robot)
    assert "base parameters" in open_notes(predictor, robot)[0]
    start = start_model(robot, predictor, resolve(robot))
    prior = fixed_prior(predictor, robot, predictor.parameters(start))
    kept = fit(replace(work.training, prior=prior), start)
    found = work.base.model.theta[at]
    assert np.abs(values[at] / found - 1.0) > 0.05
    assert kept.model.theta[at] == pytest.approx(found, rel=2e-3)
    # And its file then has it, with what is known of it now.
    written = robot_of(predictor, kept, robot, fixed_base=True).robot
    assert written.base_parameters[at[0]].value == pytest.approx(found[0], rel=2e-3)
    assert written.base_covariance is not None
    assert written.base_covariance[at, at] > 0.0


Kept = Callable[[Robot], Residuals]


@pytest.fixture(scope="module")
def kept_as(make_run: MakeRun) -> Kept:
    """The same recording again, under a base that is to be kept as given."""
    true_crane, simulated_run = make_run
    truth = replace(true_crane(), effects=(SPRING,))
    sources = sources_of([simulated_run(truth, 13.0).recording()])

    def laid(given: Robot) -> Residuals:
        surveys = [survey_source(source, given) for source in sources]
        found = residuals(given, sources, [], surveys, DiagnosisSettings(fixed_base=True))
        assert found is not None
        return found

    return laid


@pytest.fixture(scope="module")
def off_its_file(work: Residuals, identified: Robot, kept_as: Kept) -> Residuals:
    """A link's moment eight deviations from what the rows say, which tell it far better."""
    base, covariance = work.training.predictor.material.forces.base, identified.base_covariance
    assert covariance is not None
    at = base.names.index("tilt_link.mcx")
    values = np.array([own.value for own in identified.base_parameters])
    loose = 900.0 * covariance
    values[at] += 8.0 * np.sqrt(loose[at, at])
    return kept_as(replace(with_base(identified, base, values), base_covariance=loose))


def test_a_kept_base_that_rows_move_is_told(
    work: Residuals, identified: Robot, off_its_file: Residuals, kept_as: Kept
) -> None:
    """Nothing of it is left in any residual: what is known of the base alone says so."""
    same = kept_as(identified)
    assert moved_base(same.training, same.base) == {}
    assert moved_base(work.training, work.base) == {}
    told = moved_base(off_its_file.training, off_its_file.base, grossly=True)
    assert any("tilt_link.mcx" in text for text in told.values())
    assert all(name.endswith("/force") for name in told)


def test_an_edge_that_moves_within_its_laws_precision_is_told_and_no_more(
    identified: Robot, kept_as: Kept
) -> None:
    valve, *others = identified.valves
    for share, grossly in ((0.005, False), (0.08, True)):
        off = replace(valve, c_pa=valve.c_pa * (1.0 + share))
        std = {**identified.standard_deviations, f"{valve.name}.c_pa": share / 8.0 * valve.c_pa}
        given = replace(identified, valves=(off, *others), standard_deviations=std)
        own = kept_as(given)
        assert "c_pa" in " ".join(moved_base(own.training, own.base).values())
        told = " ".join(moved_base(own.training, own.base, grossly=True).values())
        assert ("c_pa" in told) is grossly


def test_a_load_that_moves_a_kept_base_counts_by_all_that_it_does(
    work: Residuals, off_its_file: Residuals
) -> None:
    """A refit leaves less of it than drifting transducers make; the file does not allow that."""
    training, base = off_its_file.training, off_its_file.base
    spec = EffectSpec("payload_change", "xs031", {"mass": 1.0})
    (load,) = resolve(replace(work.robot, effects=(spec,)))
    column = base.columns[:, training.predictor.names.index("tilt_link.mcx")]
    channel = training.predictor.material.channel[training.mask]
    own = training.bench(base.bench.noise, column, base.columns)
    left = (column - base.columns @ own.solve())[training.mask]
    drifts = [drift_of(training.predictor.material, k) for k in range(2)]
    whole = min(0.2 * d / rms(left[channel == k]) for k, d in enumerate(drifts)) * column
    assert training.prior is not None
    for kept in (training.prior.kept, 0):
        known = replace(training, prior=replace(training.prior, kept=kept))
        assert worthy(known, base, base, base.bench, load, whole, 1e9) is (kept > 0)


@pytest.mark.parametrize("parts", [False, True])
def test_a_model_that_is_read_back_has_the_base_that_was_written(
    parts: bool, robot: Robot, tmp_path: Path
) -> None:
    """Not parameters of barrels and rods beside it, of which it says nothing."""
    bare = replace(
        robot, cylinders=tuple(replace(c, barrel=None, rod=None) for c in robot.cylinders)
    )
    base = base_map(bare) if parts else base_map(bare).of_links
    values = base.combination @ robot.parameter_vector
    own = [BaseParameter(n, base.coefficients(i), float(values[i]))
           for i, n in enumerate(base.names)]  # fmt: skip
    model = replace(
        bare, base_parameters=tuple(own), base_covariance=np.eye(len(own)), urdf=robot.urdf
    )
    write_model(model, tmp_path / "model.yaml")
    read = load_robot(tmp_path / "model.yaml")
    assert own_forces(read, torque=False).base.names == base.names


def _delay_of(robot: Robot, delay_s: float) -> tuple[Any, ...]:
    return resolve(
        replace(robot, effects=(EffectSpec("command_delay", robot.name, {"delay": delay_s}),))
    )


def _delays(predictor: Any) -> set[str]:
    return {predictor.names[at] for at in predictor.delay_columns.values()}


def test_a_prior_is_taken_over_by_name() -> None:
    prior = Prior(np.array([[2.0, 0.0, 0.0], [0.0, 0.0, 5.0]]), np.array([1.0, 2.0, 3.0]))
    there = prior.taken(("a", "b", "c"), ("c", "x"))
    assert there.root == pytest.approx(np.array([[5.0, 0.0]]))
    assert there.values == pytest.approx([3.0, 0.0])


# Ripples --------------------------------------------------------------------------------------


# What rows do not tell ------------------------------------------------------------------------


def _bench(x: np.ndarray, y: np.ndarray) -> Bench:
    zeros = np.zeros(len(y), dtype=int)
    linked = np.arange(len(y)) > 0
    layout = Layout(zeros, zeros, 0.01 * np.arange(len(y)), linked)
    return Bench(layout, Noise((np.zeros(0),), np.ones(1)), y, x, 1.0)


def test_steps_stay_small_where_rows_tell_nothing() -> None:
    """What is told keeps its least-squares value, in whatever combination it is told."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 400))
    x = np.stack([a, a + 1e-5 * b], axis=1)
    y = 50.0 * a + rng.normal(size=400)
    bench = _bench(x, y)
    wild, tame = bench.solve(), bench.solve(np.full(2, 50.0))
    assert np.abs(wild).max() > 1e3
    assert np.abs(tame).max() < 100.0
    assert tame.sum() == pytest.approx(wild.sum(), rel=1e-3)


def test_a_number_that_rows_do_not_tell_costs_nothing(work: Residuals) -> None:
    """A boom of unknown weight does what a spring's slope does; nothing a curve's stations."""
    training, noise = work.training, work.base.bench.noise
    without = fitted(training, work.base.model, noise)
    (curve, *_) = trials(training.predictor, work.base.model, ("position_dependent_friction",))
    terms = [
        *(resolve(replace(load_robot("xs031"), effects=(s,)))[0] for s in (SPRING, OFFSET)),
        curve.at(np.ones(5)),
    ]
    contenders = Contest(training).fitted(without, terms, noise)
    costs = {c.term.effect.name: c.cost for c in contenders}
    plain = costs["constant_force_offset"]
    assert plain == pytest.approx(0.5 * np.log(without.bench.measured))
    assert costs["counterbalance_spring"] == pytest.approx(plain)
    assert costs["position_dependent_friction"] > 4.5 * plain


def test_no_barrel_is_heavier_than_its_steel_can_be(work: Residuals) -> None:
    predictor, model = work.training.predictor, work.base.model
    found = list(trials(predictor, model, ("cylinder_inertia",)))
    assert found
    for trial in found:
        for spec in trial.active.effect.parameters:
            assert 10.0 * spec.typical < spec.upper < 1000.0
