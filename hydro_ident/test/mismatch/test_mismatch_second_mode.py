"""Another mode beside one that was found: the first one's form is not all of it."""

from __future__ import annotations

from dataclasses import replace

from hydro_ident.mismatch.naming.worth import _explained
from hydro_ident.mismatch.split.residuals import Residuals
from hydro_model.effects.catalogue import resolve
from hydro_model.robot import EffectSpec
from hydro_model.robot_files import load_robot

MODE = {"inertia": 400.0, "frequency": 6.0, "damping": 0.05}


def _share_of(work: Residuals, name: str, target: str, parameters: dict[str, float]) -> float:
    """What an effect of the model explains, a share of which what is found beside it has to."""
    robot = replace(load_robot("xs031"), effects=(EffectSpec(name, target, parameters),))
    current = replace(work.base, model=work.base.model.with_term(resolve(robot)[0]))
    channels = range(len(work.training.predictor.material.channels))
    return _explained(work.training, current, current.bench, channels)


def test_the_form_of_a_mode_may_be_left_over_that_of_a_load_not(rubbing: Residuals) -> None:
    assert _share_of(rubbing, "structural_flexibility", "lift_cylinder", MODE) > 100.0
    assert _share_of(rubbing, "payload_change", "xs031", {"mass": 50.0}) == 0.0
