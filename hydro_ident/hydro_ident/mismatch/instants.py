"""What begins at an instant begins at another one in other recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.check import Check
from hydro_ident.mismatch.modelled import Model, same
from hydro_ident.mismatch.onset import beginning, begins, settled
from hydro_ident.mismatch.places import instant_spacing, instants_of
from hydro_ident.mismatch.training import Training
from hydro_model.effects.catalogue import start_s
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import Robot


def at_own_instants(training: Training, check: Check, model: Model) -> tuple[Model, int]:
    """A model as other recordings have it: what begins there begins when it predicts them best.

    Parameters
    ----------
    training : Training
    check : Check
    model : Model
        As fitted to the training rows.

    Returns
    -------
    model : Model
        The same where the check is of the recordings that were fitted, or nothing begins.
    tried : int
        Instants that were looked at for each effect that begins: p-values pay for them.
    """
    tried = 1
    if check.predictor is training.predictor:
        return model, tried
    for term in (t for t in model.terms if t.effect.start):
        model, tried = _placed(check, model, term)
    return model, tried


def _placed(check: Check, model: Model, mine: ActiveEffect) -> tuple[Model, int]:
    """The model with one effect's instant that predicts the check best, of how many."""
    used, material = check.mask & check.moving, check.predictor.material
    spacing_s = instant_spacing(material)

    def with_it(one: ActiveEffect) -> Model:
        return replace(model, terms=tuple(one if same(t, mine) else t for t in model.terms))

    def left(one: ActiveEffect) -> float:
        return float(np.sum(check.residual(with_it(one))[used] ** 2))

    instants = [start_s(mine), 0.0, *instants_of(material)]
    tried = [mine, *(beginning(mine, instant, spacing_s) for instant in instants[1:])]
    best = min(tried, key=left)
    if begins(best):
        best = settled(best, spacing_s, left)
    return with_it(best), len(instants)


def begun(robot: Robot, terms: Sequence[ActiveEffect]) -> Robot:
    """A robot whose effects begin when those of a model do.

    Parameters
    ----------
    robot : Robot
        With effects of the same names and targets.
    terms : sequence of ActiveEffect
    """
    starts: dict[tuple[str, str], dict[str, float]] = {}
    for term in terms:
        names = [p.name for p in term.effect.parameters]
        if term.effect.start:
            value = float(term.parameters[names.index(term.effect.start)])
            starts[term.effect.name, term.target] = {term.effect.start: value}
    effects = tuple(
        replace(e, parameters={**e.parameters, **starts.get((e.name, e.target), {})})
        for e in robot.effects
    )
    return replace(robot, effects=effects) if starts else robot
