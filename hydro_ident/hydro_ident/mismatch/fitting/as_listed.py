"""Shapes of listed effects: as the robot file has them, unless the recordings tell others.

How late a quick spool is in all, a recording tells well. What of that is the spool's frequency,
what its damping and what the command's delay, it hardly tells: a fit of all three goes along their
valley to wherever what else is left in the flows is served a little by it. Whoever lists a spool
has looked into a data sheet, so that its numbers are changed only where that takes out more than
chance does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.fitting.fitted import Fitted, fitted
from hydro_ident.mismatch.fitting.fitting import fit
from hydro_ident.mismatch.fitting.stepping import is_shape
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.modelled import Model
from hydro_model.effects.catalogue import resolve
from hydro_model.effects.targets import ActiveEffect

#: What an effect's shapes have to take out to be changed, five deviations of one squared.
LISTED_GAIN = 25.0


def key_of(term: ActiveEffect) -> tuple[str, str]:
    """Name and target, which no two effects of a model share.

    Parameters
    ----------
    term : ActiveEffect
    """
    return term.effect.name, term.target


def listed_effects(training: Training) -> dict[tuple[str, str], ActiveEffect]:
    """Effects of the robot file as they stand there, by name and target.

    Parameters
    ----------
    training : Training
    """
    return {key_of(one): one for one in resolve(training.predictor.material.robot)}


def shapes_of(term: ActiveEffect) -> frozenset[tuple[str, str, str]]:
    """Shapes of an effect, those that a robot file leaves out as well.

    Parameters
    ----------
    term : ActiveEffect

    Returns
    -------
    frozenset of (str, str, str)
        As `Training.as_listed`.
    """
    specs = enumerate(term.effect.parameters)
    return frozenset((*key_of(term), spec.name) for i, spec in specs if is_shape(term, i))


def given_shapes(training: Training, term: ActiveEffect) -> frozenset[tuple[str, str, str]]:
    """Shapes of an effect that the robot file lists with numbers of its own.

    What it leaves out has the catalogue's usual number, which nobody has looked up.

    Parameters
    ----------
    training : Training
    term : ActiveEffect

    Returns
    -------
    frozenset of (str, str, str)
        As `Training.as_listed`.
    """
    listed = listed_effects(training).get(key_of(term))
    if listed is None:
        return frozenset()
    rows = zip(term.effect.parameters, listed.parameters, strict=True)
    given = {(*key_of(term), spec.name) for spec, value in rows if not spec.left_out(value)}
    return shapes_of(term) & given


def as_in_file(
    model: Model, listed: ActiveEffect, shapes: frozenset[tuple[str, str, str]]
) -> Model:
    """A model with shapes of a listed effect as the robot file has them.

    Parameters
    ----------
    model : Model
    listed : ActiveEffect
        As listed, with the usual numbers of what the file leaves out.
    shapes : frozenset of (str, str, str)
        Which, as `Training.as_listed`.
    """
    key = key_of(listed)
    there = np.array([(*key, spec.name) in shapes for spec in listed.effect.parameters])
    terms = (
        replace(t, parameters=np.where(there, listed.parameters, t.parameters))
        if key_of(t) == key
        else t
        for t in model.terms
    )
    return replace(model, terms=tuple(terms))


def with_listed(training: Training, start: Model) -> tuple[Training, Fitted]:
    """The base fitted beside the effects that are listed, of which shapes stay if nothing speaks.

    Parameters
    ----------
    training : Training
    start : Model
        With the listed effects, as listed.

    Returns
    -------
    training : Training
        With the effects whose shapes stay.
    base : Fitted
    """
    shaped = [own for term in start.terms if (own := given_shapes(training, term))]
    if not shaped:
        return training, fit(training, start)
    training = replace(training, as_listed=frozenset[tuple[str, str, str]]().union(*shaped))
    base = fit(training, start)
    moved = [own for own in shaped if _gains(training, base, own)]
    if not moved:
        return training, base
    training = replace(training, as_listed=training.as_listed.difference(*moved))
    return training, fit(training, base.model)


def _gains(training: Training, base: Fitted, own: frozenset[tuple[str, str, str]]) -> bool:
    """Whether an effect's own shapes, when freed, take out more than chance does."""
    free, noise = replace(training, as_listed=training.as_listed - own), base.bench.noise
    # What a linear step does not promise, no fit keeps; and most promise nothing.
    if base.squares - fitted(free, base.model, noise).squares <= LISTED_GAIN:
        return False
    return base.squares - fit(free, base.model, noise).squares > LISTED_GAIN


def relisted(training: Training, whole: Fitted) -> tuple[Training, Fitted]:
    """The final fit, with shapes back as listed that were freed for what has been found since.

    Beside an effect that nobody had named, a spool's shapes took up a part of it.

    Parameters
    ----------
    training : Training
    whole : Fitted
        The final model.

    Returns
    -------
    training : Training
    whole : Fitted
        The same where shapes other than those listed take out more than chance does, still.
    """
    for key, listed in listed_effects(training).items():
        term = next((t for t in whole.model.terms if key_of(t) == key), None)
        own = frozenset() if term is None else given_shapes(training, term)
        if own <= training.as_listed:
            continue
        held = replace(training, as_listed=training.as_listed | own)
        model = as_in_file(whole.model, listed, own)
        fresh = fit(held, model, whole.bench.noise)
        if fresh.squares - whole.squares <= LISTED_GAIN:
            training, whole = held, fresh
    return training, whole


def as_listed_notes(whole: Fitted, training: Training) -> list[str]:
    """What stays as it is listed, in words.

    Parameters
    ----------
    whole : Fitted
        The final model.
    training : Training
    """
    kept = [
        f"{term.effect.name} of {term.target} ({', '.join(names)})"
        for term in whole.model.terms
        if (names := _kept(training, term))
    ]
    if not kept:
        return []
    return [f"as the robot file lists them, as nothing here speaks for others: {'; '.join(kept)}"]


def _kept(training: Training, term: ActiveEffect) -> list[str]:
    """Names of an effect's parameters that stay as listed; not of what the file leaves out."""
    given = {name for *_, name in given_shapes(training, term) & training.as_listed}
    return [spec.name for spec in term.effect.parameters if spec.name in given]
