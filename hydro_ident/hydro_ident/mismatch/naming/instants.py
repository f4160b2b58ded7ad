"""What comes or goes at an instant does so at another one in other recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.modelled import Model, same
from hydro_ident.mismatch.rows.onset import Sight, ends
from hydro_ident.mismatch.split.check import Check
from hydro_ident.mismatch.trials.places import ends_of, instant_spacing, instants_of, mean_oil_c
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec, FloatArray, Robot

#: For how long something may have been under way when another recording begins, s, and how often
#: the best of them is made finer.
_HEAD_STARTS_S = (0.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0, 1280.0, 2560.0)
_FINER = 12


def at_own_instants(
    training: Training, check: Check, model: Model
) -> tuple[Model, Mapping[tuple[str, str], int]]:
    """A model as other recordings have it: what comes and goes does when it predicts them best.

    What is under way all along, as oil that warms up, may have been so before they begin.

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
    tried : mapping of (str, str) to int
        By name and target of each effect that was placed, how many instants, or head starts, it
        had to choose from: its p-value pays for them. Where two of one name and target were, every
        choice of the one went with every choice of the other.
    """
    tried: dict[tuple[str, str], int] = {}
    if check.predictor is training.predictor:
        return model, tried
    for term in (t for t in model.terms if t.effect.edges):
        if term.effect.start:
            model, count = _placed(check, model, term)
        elif mean_oil_c(check.predictor.material) is None:
            model, count = _under_way(check, model, term)
        else:
            continue
        own = term.effect.name, term.target
        tried[own] = tried.get(own, 1) * count
    return model, tried


def _sight(check: Check, model: Model, mine: ActiveEffect) -> Sight:
    """What one effect of a model explains of the check, by when it acts."""
    used = check.mask & check.moving
    beside = replace(model, terms=tuple(t for t in model.terms if t is not mine))

    def column(one: ActiveEffect) -> FloatArray:
        return check.predictor.contribution(beside, one)[used]

    return Sight(column, check.residual(beside)[used], sized=True)


def _under_way(check: Check, model: Model, mine: ActiveEffect) -> tuple[Model, int]:
    """The model with one effect under way for as long as predicts the check best, of how many.

    A machine is warm when it is recorded again; what warms it does not begin anew. As between
    instants, what lies between two head starts that were tried is no further choice.
    """
    sight, name = _sight(check, model, mine), mine.effect.head_start

    def loss(at_s: float) -> float:
        return -sight.gain(_at_edges(mine, {name: at_s}))

    best = min(range(len(_HEAD_STARTS_S)), key=lambda k: loss(_HEAD_STARTS_S[k]))
    near = _HEAD_STARTS_S[max(best - 1, 0)], _HEAD_STARTS_S[min(best + 1, len(_HEAD_STARTS_S) - 1)]
    finer = minimize_scalar(loss, bounds=near, method="bounded", options={"maxiter": _FINER})
    at_s = min((_HEAD_STARTS_S[best], float(finer.x)), key=loss)
    terms = tuple(_at_edges(t, {name: at_s}) if t is mine else t for t in model.terms)
    return replace(model, terms=terms), len(_HEAD_STARTS_S)


def _placed(check: Check, model: Model, mine: ActiveEffect) -> tuple[Model, int]:
    """The model with one effect's instants that predict the check best, of how many."""
    material, sight = check.predictor.material, _sight(check, model, mine)
    instants_s, ends_s = instants_of(material), ends_of(material)
    single = sight.first(mine, instants_s)
    found = sight.placed(single, instant_spacing(material), ends_s)
    best = max(mine, found, key=sight.gain)
    # Half of what chance may do is left to either kind.
    pairs, alone = len(ends_s) * (len(ends_s) + 1) // 2, 2 + len(instants_s)
    terms = tuple(best if t is mine else t for t in model.terms)
    return replace(model, terms=terms), 2 * (pairs if ends(best) else alone)


def both_at_own_instants(
    training: Training, check: Check, base: Model, whole: Model
) -> tuple[Model, Model]:
    """Base and model as other recordings have them: what they share comes and goes together there.

    When it does is a matter of the recordings: the model that describes them better says it of
    both, or a base would make up for what it lacks by an instant of its own.

    Parameters
    ----------
    training : Training
    check : Check
    base : Model
    whole : Model
        With the base's effects and others.

    Returns
    -------
    base, whole : Model
        The same where `at_own_instants` moves nothing.
    """
    there, _ = at_own_instants(training, check, whole)
    if there is whole:
        return base, whole
    waiting, terms = [t for t in there.terms if t.effect.edges], list[ActiveEffect]()
    for term in base.terms:
        at = next((k for k, t in enumerate(waiting) if same(t, term)), None)
        terms.append(term if at is None else _at_edges(term, _edges(waiting.pop(at))))
    return replace(base, terms=tuple(terms)), there


def begun(robot: Robot, terms: Sequence[ActiveEffect]) -> Robot:
    """A robot whose effects come and go when those of a model do.

    Parameters
    ----------
    robot : Robot
        With effects of the same names and targets.
    terms : sequence of ActiveEffect
    """
    waiting = sorted(robot.effects, key=_listed_start)
    own: dict[int, EffectSpec] = {}
    for term in (t for t in terms if t.effect.edges):
        # Two loads of one tip are told apart by which comes first.
        mine = (e for e in waiting if (e.name, e.target) == (term.effect.name, term.target))
        if one := next(mine, None):
            waiting.remove(one)
            own[id(one)] = replace(one, parameters={**one.parameters, **_edges(term)})
    if not own:
        return robot
    return replace(robot, effects=tuple(own.get(id(e), e) for e in robot.effects))


def _listed_start(spec: EffectSpec) -> float:
    return float(spec.parameters.get(CATALOGUE[spec.name].start, -np.inf))


def _at_edges(one: ActiveEffect, edges: Mapping[str, float]) -> ActiveEffect:
    parameters = one.parameters.copy()
    for k, parameter in enumerate(one.effect.parameters):
        parameters[k] = edges.get(parameter.name, parameters[k])
    return replace(one, parameters=parameters)


def _edges(one: ActiveEffect) -> dict[str, float]:
    names = [parameter.name for parameter in one.effect.parameters]
    return {name: float(one.parameters[names.index(name)]) for name in one.effect.edges}
