"""Listed dry friction that bends before it slides: a bristle in the place of the listed law.

Whoever lists Coulomb friction means all of a seal's, and seals bend over some hundredths of a
millimetre before they slide. Coulomb's law has no travel, so that beside it another friction is
found which is only its bend, and takes most of the listed force with it. Where a bristle fits
better, and bends over no more than what is called dry friction still, it is what is listed in
another form, and no finding.

What is left out beside it may hide that from the base, such as a load that is picked up: where the
bristle is found in the end, beside a listed law of which it has taken the force, it is put in its
place after all. What is put in a listed law's place is held to what it was put there for: fitted
on beside all else it would bend over millimetres where that makes the fit better by a hair.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from hydro_ident.mismatch.fitting.as_listed import LISTED_GAIN, key_of, listed_effects
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.modelled import Model
from hydro_ident.mismatch.trials.contender import BRISTLE, DRY, as_dry, held_dry
from hydro_model.effects.catalogue import CATALOGUE, resolve
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import EffectSpec

#: Travels that fits begin with, over the law's own least.
_FIRST = (2.5, 12.5)


def bristled(training: Training, base: Fitted) -> Fitted:
    """The base with bristles in the place of listed Coulomb friction where these fit better.

    Parameters
    ----------
    training : Training
    base : Fitted
        With the listed effects.
    """
    for key in listed_effects(training):
        term = next((t for t in base.model.terms if key_of(t) == key), None)
        if term is None or term.effect.name != DRY:
            continue
        bent = (BRISTLE, term.target)
        if any(key_of(t) == bent for t in base.model.terms):
            continue
        noise = base.bench.noise
        starts = [_with(base.model, term, _bent(training, term, times)) for times in _FIRST]
        fresh = min((fit(training, one, noise) for one in starts), key=lambda one: one.squares)
        found = next(t for t in fresh.model.terms if key_of(t) == bent)
        if base.squares - fresh.squares > LISTED_GAIN and as_dry(found):
            base = fit(training, _with(fresh.model, found, held_dry(found)))
    return base


def bends_of_listed(training: Training, found: Iterable[ActiveEffect]) -> list[ActiveEffect]:
    """Bristles among what was found that are the bend of a friction that the robot file lists.

    Parameters
    ----------
    training : Training
    found : iterable of ActiveEffect
    """
    listed = listed_effects(training)
    return [
        term
        for term in found
        if term.effect.name == BRISTLE and as_dry(term) and (DRY, term.target) in listed
    ]


def with_bristles(training: Training, base: Fitted, bends: Iterable[ActiveEffect]) -> Fitted:
    """The base with bristles in the place of the friction that is listed there.

    Parameters
    ----------
    training : Training
    base : Fitted
        With the listed effects.
    bends : iterable of ActiveEffect
        As `bends_of_listed`.
    """
    model = base.model
    for bend in bends:
        term = next((t for t in model.terms if key_of(t) == (DRY, bend.target)), None)
        model = model if term is None else _with(model, term, held_dry(bend))
    return fit(training, model)


def bristle_notes(training: Training, whole: Fitted) -> list[str]:
    """Which listed Coulomb friction stands in the model as a bristle, in words.

    Parameters
    ----------
    training : Training
    whole : Fitted
        The final model.
    """
    now = {key_of(term): term for term in whole.model.terms}
    notes = []
    for name, target in listed_effects(training):
        bent = now.get((BRISTLE, target))
        if name != DRY or (name, target) in now or bent is None:
            continue
        force, distance = bent.parameters
        units = bent.units
        travel = f"{1e3 * distance:.2g} m{units[1]}"
        notes.append(
            f"{DRY} of {target}, which the robot file lists, bends over {travel} before it slides:"
            f" it stands in the model as {BRISTLE} of {force:.4g} {units[0]}"
        )
    return notes


def _bent(training: Training, term: ActiveEffect, times: float) -> ActiveEffect:
    """A bristle of the same force at the same place, its travel as often the least one."""
    least = CATALOGUE[BRISTLE].parameters[1].lower
    numbers = {"force": float(term.parameters[0]), "distance": times * least}
    spec = EffectSpec(BRISTLE, term.target, numbers)
    (bent,) = resolve(replace(training.predictor.material.robot, effects=(spec,)))
    return bent


def _with(model: Model, old: ActiveEffect, new: ActiveEffect) -> Model:
    return replace(model, terms=tuple(new if t is old else t for t in model.terms))
