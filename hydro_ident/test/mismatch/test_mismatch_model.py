"""What a diagnosis writes of its fit: numbers that agree, and how well each is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.identify.model_file import write_model
from hydro_ident.identify.survey import survey_source
from hydro_ident.mismatch.fitting.prior import left_open
from hydro_ident.mismatch.modelling.model import robot_of
from hydro_ident.mismatch.settings import DiagnosisSettings
from hydro_ident.mismatch.split.residuals import Residuals, residuals
from hydro_ident.recordings.sources import sources_of
from hydro_ident.transducers import zero_pa
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec, Robot
from hydro_model.robot_files import load_robot

MASS_KG, VISCOUS = 95.0, 215.0


def _carriage(robot: Robot, crane: Recording) -> Recording:
    """An axis that is driven along sines, its force measured."""
    time = 0.002 * np.arange(5000)
    omega = 2.0 * np.pi * np.array([0.3, 0.7, 1.9])
    size, angle = np.array([0.06, 0.03, 0.005]), np.outer(time, omega)
    q, qd = np.sin(angle) @ size, np.cos(angle) @ (size * omega)
    force = MASS_KG * (-np.sin(angle) @ (size * omega**2)) + VISCOUS * qd
    rng, none = np.random.default_rng(0), np.zeros((time.size, 0))
    return replace(
        crane, robot=robot, stamp_ns=crane.stamp_ns[: time.size], supply=None, tank=None,
        q=(q + rng.normal(0.0, 1e-6, time.size))[:, None], p_a=none, p_b=none, valve_v=None,
        effort=(force + rng.normal(0.0, 2.0, time.size))[:, None], command_v=None,
        latched=crane.latched[: time.size],
    )  # fmt: skip


def test_friction_of_a_joint_without_cylinder_is_known_as_well_as_it_was_fitted(
    crane_run: Any, tmp_path: Path
) -> None:
    """A base that is kept then keeps it: it was identified."""
    robot = replace(load_robot("emps"), effects=())
    sources = sources_of([_carriage(robot, crane_run.recording())])
    surveys = [survey_source(source, robot) for source in sources]
    work = residuals(robot, sources, [], surveys, DiagnosisSettings())
    assert work is not None
    predictor, name = work.training.predictor, "carriage.viscous_friction"
    write_model(robot_of(predictor, work.base, robot).robot, tmp_path / "model.yaml")
    read = load_robot(tmp_path / "model.yaml")
    assert read.joints[0].viscous_friction == pytest.approx(VISCOUS, rel=0.02)
    off = abs(read.joints[0].viscous_friction - VISCOUS)
    assert 0.0 < read.standard_deviations[name] < 0.02 * VISCOUS
    assert off < 5.0 * read.standard_deviations[name]
    assert name in left_open(predictor, robot)
    assert name not in left_open(predictor, read)


def test_bodies_of_another_base_go_with_it(laid_crane: Residuals) -> None:
    """They reproduce the parameters that they were found with, and are references for the next."""
    work = laid_crane
    bodies = dict.fromkeys((*work.robot.standard_names, *work.robot.part_names), 1.0)
    given = replace(work.robot, standard_parameters=bodies)
    assert robot_of(work.training.predictor, work.base, given).robot.standard_parameters == {}
    kept = robot_of(work.training.predictor, work.base, given, fixed_base=True).robot
    assert kept.standard_parameters == bodies


def test_deviations_have_what_zeros_of_transducers_move_the_base_by(make_run: Any) -> None:
    """A zero off by its usual deviation moves first moments by many of the noise's."""
    true_crane, simulated_run = make_run
    run = simulated_run(true_crane(), 20.0).recording()
    robot = load_robot("xs031")
    models, fits = [], []
    for off_pa in (0.0, zero_pa(robot)):
        given = replace(run, p_a=run.p_a + np.array([off_pa, 0.0]))
        sources = sources_of([given])
        surveys = [survey_source(source, robot) for source in sources]
        work = residuals(robot, sources, [], surveys, DiagnosisSettings())
        assert work is not None
        models.append(robot_of(work.training.predictor, work.base, robot).robot)
        fits.append(work.base)
    names = [one.name for one in models[0].base_parameters]
    values = np.array([[one.value for one in model.base_parameters] for model in models])
    covariance = models[0].base_covariance
    assert covariance is not None
    noise = fits[0].covariance[: len(names), : len(names)]
    moved = np.abs(values[1] - values[0])
    moments = [k for k, name in enumerate(names) if name.endswith((".mcx", ".mcz"))]
    assert np.max(moved[moments] / np.sqrt(np.diag(noise)[moments])) > 5.0
    # One of four zeros, of the usual size: no more than a deviation of what all of them make.
    with_them = np.sqrt(np.diag(covariance))
    known = with_them > 0.0
    assert np.all(moved[known] < 1.1 * with_them[known])
    assert np.max(moved[known] / with_them[known]) > 0.3


@pytest.mark.thorough
def test_a_kept_base_is_written_as_far_as_it_moved(make_run: Any) -> None:
    """Effects are fitted beside it; what its file states no deviation of stays as it is there."""
    true_crane, simulated_run = make_run
    sources = sources_of([simulated_run(true_crane(), 20.0).recording()])
    robot, name = load_robot("xs031"), "lift_cylinder.viscous_friction"
    surveys = [survey_source(source, robot) for source in sources]
    work = residuals(robot, sources, [], surveys, DiagnosisSettings())
    assert work is not None
    known = robot_of(work.training.predictor, work.base, robot).robot
    lift, *others = known.cylinders
    off = replace(lift, viscous_friction=lift.viscous_friction + 900.0)
    stated = {**known.standard_deviations, name: 900.0}
    given = replace(known, cylinders=(off, *others), standard_deviations=stated)
    fixed = DiagnosisSettings(fixed_base=True)
    work = residuals(given, sources, [], surveys, fixed)
    assert work is not None
    predictor = work.training.predictor
    written = robot_of(predictor, work.base, given, fixed_base=True).robot
    at = predictor.names.index(name)
    moved = written.cylinders[0].viscous_friction
    assert moved == pytest.approx(predictor.parameters(work.base.model)[at], rel=1e-12)
    assert abs(moved - lift.viscous_friction) < 0.1 * 900.0
    assert 0.0 < written.standard_deviations[name] < 0.1 * 900.0
    assert written.standard_deviations.keys() == stated.keys()
    silent = replace(given, base_covariance=None)
    held = robot_of(predictor, work.base, silent, fixed_base=True).robot
    assert held.base_parameters == given.base_parameters


def test_a_delay_that_was_found_is_told_with_what_the_base_has_of_it(rubbing: Residuals) -> None:
    """Up to a cycle is fitted and no finding: the two stand in two places of the model."""
    robot = load_robot("xs031")
    late = resolve(
        replace(robot, effects=(EffectSpec("command_delay", "xs031", {"delay": 4e-3}),))
    )
    whole = replace(rubbing.base, model=rubbing.base.model.with_term(late[0]))
    found = robot_of(rubbing.training.predictor, whole, robot)
    [told] = [note for note in found.notes if note.startswith("commands of xs031")]
    base_s = found.robot.command_delay_s
    assert f"are {1e3 * (base_s + 4e-3):.3g} ms late in all: {1e3 * base_s:.3g} ms of" in told
    assert not any(
        "late in all" in n for n in robot_of(rubbing.training.predictor, rubbing.base, robot).notes
    )
