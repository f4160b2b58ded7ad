"""Columns of trials that are kept from step to step: beside what has been found since."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_ident.mismatch.trials.candidates import _at_targets, trials
from hydro_ident.mismatch.trials.scoring import Bank, Entry, bank_of
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.signals import JOINT_POSITION, TIP_HEIGHT
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

#: Share of a trial's gain that a column may lose for being that of another model.
LOST = 0.025
#: Share of a column, as a norm, of which a refit leaves too little to compare.
SWALLOWED = 1.0e-2


@pytest.fixture(scope="module")
def laid(make_run: tuple, lay_out: Callable[..., Residuals]) -> Residuals:
    """A run of the true crane, laid out: what a diagnosis knows before it searches."""
    true_crane, simulated_run = make_run
    return lay_out(simulated_run(true_crane(), 12.0))


@pytest.fixture(scope="module")
def bank(laid: Residuals) -> Bank:
    """One that the base asked first: what is evaluated beside an effect is kept under its name."""
    bank = Bank(laid.training.predictor)
    assert bank.entries(laid.base.model)
    return bank


@pytest.mark.parametrize(("valves", "targets"), [(1, {"lift_cylinder"}), (2, None)])
def test_the_delay_of_a_single_valve_is_tried_once(valves: int, targets: set[str] | None) -> None:
    """As that of its valve, which a lag of the spool is weighed against at the same cost."""
    crane = load_robot("xs031")
    robot = replace(crane, cylinders=crane.cylinders[:valves], valves=crane.valves[:valves])
    of: Any = SimpleNamespace(robot=robot)
    tried = [one for form in CATALOGUE["command_delay"].forms for one in _at_targets(of, form)]
    own = targets or {"lift_cylinder", "tilt_cylinder", robot.name}
    assert {one.target for one in tried} == own
    assert len(tried) == len(own)


def test_what_is_hardly_ever_met_is_tried_where_it_would_be(laid: Residuals) -> None:
    """A ground under the tip, and what a joint runs against from either side."""
    predictor, model = laid.training.predictor, laid.base.model
    tried = [t.active for t in trials(predictor, model, ["external_contact"])]
    for signal, own in (
        (TIP_HEIGHT, [t for t in tried if t.everywhere]),
        (JOINT_POSITION, [t for t in tried if t.target == "lift_cylinder"]),
    ):
        (stretch,) = predictor.material.stretches
        at = predictor.signals.of(model, stretch, own[0])[:, signal]
        names = [p.name for p in own[0].effect.parameters]
        values = [dict(zip(names, t.parameters, strict=True)) for t in own]
        for way in {v["way"] for v in values}:
            heights = [v["height"] for v in values if v["way"] == way]
            met = [float(np.mean((way or 1.0) * at < height)) for height in heights]
            assert min(met) == pytest.approx(0.02, abs=0.005)
            assert way == 0.0 or max(met) < 0.51


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "target"),
    [
        # A robot-wide law of a rail, with which every valve's flow is another one.
        ("supply_droop", "xs031"),
        # Readings: the signals that laws look at are others once these are undone.
        ("command_delay", "xs031"),
        ("encoder_offset", "lift"),
        ("pressure_sensor_bias", "lift_cylinder/a"),
        # A law on one valve's signal, as ever.
        ("valve_deadband", "tilt_valve"),
    ],
)
def test_what_is_tried_is_tried_beside_what_was_found(
    laid: Residuals, bank: Bank, name: str, target: str
) -> None:
    base = laid.base
    spec = EffectSpec(name, target, {p.name: p.typical for p in CATALOGUE[name].parameters})
    (found,) = resolve(replace(load_robot("xs031"), effects=(spec,)))
    model = base.model.with_term(found)
    current = fitted(laid.training, model, base.bench.noise)
    lost = [
        (e.trial.name, e.trial.target, round(share, 3))
        for e in bank.entries(model)
        if (share := _lost(laid, current, e)) > LOST
    ]
    assert not lost


def test_on_a_base_without_inertia_no_hinge_swings_and_others_are_tried(
    laid: Residuals,
) -> None:
    """Slow motion hardly tells a base's inertia: fitted, it may be less than none."""
    predictor, model = laid.training.predictor, laid.base.model
    robot = replace(model.robot, link_inertia=-1.0 * model.robot.link_inertia)
    hinge = {"inertia": 400.0, "frequency": 4.0, "damping": 0.05, "carried": 1.0, "place": 0.0}
    spec = EffectSpec("structural_flexibility", "lift_cylinder", hinge)
    (term,) = resolve(replace(load_robot("xs031"), effects=(spec,)))
    assert predictor.contribution(model, term).any()
    assert not predictor.contribution(replace(model, robot=robot), term).any()
    tried = {e.trial.name for e in Bank(predictor).entries(replace(model, robot=robot))}
    assert {"coulomb_friction", "payload_change"} <= tried


def _lost(work: Residuals, current: Fitted, kept: Entry) -> float:
    """What a kept column would lose of the gain of what it stands for, beyond a refit."""
    predictor, mask, bench = work.training.predictor, work.training.mask, current.bench
    anew = bank_of(predictor, current.model, [kept.trial])
    if not anew:
        return 1.0
    both = [e.columns(mask.size)[mask] for e in (kept, anew[0])]
    old, new = (bench.beyond(columns) for columns in both)
    whole = np.linalg.norm(bench.noise.whitened(bench.layout, both[1])[bench.rows], axis=0)
    told = np.linalg.norm(new, axis=0) > SWALLOWED * whole
    sizes = np.linalg.norm(old, axis=0) * np.linalg.norm(new, axis=0)
    cosine = np.sum(old * new, axis=0) / np.maximum(sizes, 1e-300)
    return float(np.max(1.0 - cosine[told] ** 2, initial=0.0))
