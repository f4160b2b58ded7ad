"""What base and effect both say, said by the effect alone.

A base has a delay per valve, of up to its own (a cycle, or what the robot file states beyond it)
and what is no finding yet, and a skew per pressure. Where the model has the effect that is the
same thing, the effect has what all valves have beyond the base's own delay, and what pressures are
late: the quickest valve keeps that delay, the others what they are later than it, and no skew is
left. A single valve's delay leaves it what the others have. A fit has to begin there. From a base
at the end of its range what one effect says of all valves fits worse than an own delay for each of
them, so that no step towards it would be taken, and the effect would lack what the base has kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.skew import PRESSURE_DELAY, is_listed
from hydro_model.effects.targets import ActiveEffect


def handed_over(
    predictor: Predictor, model: Model, own_delay_s: float, longest_s: Mapping[int, float]
) -> Model:
    """A model whose delays beyond the base's own, and whose skews, are in their effects.

    Parameters
    ----------
    predictor : Predictor
    model : Model
    own_delay_s : float
        Of the base: the recordings' interval, or what the robot file states beyond it, s.
    longest_s : mapping of int to float
        What steps may make of a cylinder's valve: none is handed more, where one that has become
        quick would have all others be later.

    Returns
    -------
    Model
        The same one where it has no such effect, or nothing to hand over.
    """
    delays_s, skews_s, terms = list(model.delays_s), list(model.skews_s), list(model.terms)
    chambers = list(predictor.skew_columns) if skews_s else []
    for k, term in enumerate(terms):
        late = late_valves(term, predictor.delay_columns)
        if term.effect.name == DELAY and late:
            others = [i for i in predictor.delay_columns if i != term.cylinder]
            if term.cylinder is None or not others:
                least_s, later = min(delays_s[i] for i in predictor.delay_columns), own_delay_s
            else:
                # One valve is later than the others are.
                least_s = delays_s[term.cylinder]
                later = float(np.mean([delays_s[i] for i in others]))
            most = [delays_s[i] - longest_s[i] for i in late]
            more_s = _taken(term, max(least_s - later, *most))
            for index in late:
                delays_s[index] -= more_s
        elif term.effect.name == PRESSURE_DELAY:
            at = [chamber for chamber in chambers if is_listed([term], chamber)]
            more_s = _taken(term, float(np.mean([skews_s[i] for i in at])) if at else 0.0)
            for i in at:
                skews_s[i] = 0.0
        else:
            continue
        terms[k] = _later(term, more_s)
    if all(fresh is term for fresh, term in zip(terms, model.terms, strict=True)):
        return model
    return replace(model, delays_s=tuple(delays_s), skews_s=tuple(skews_s), terms=tuple(terms))


def late_valves(term: ActiveEffect, columns: Iterable[int]) -> list[int]:
    """The cylinders whose valves a delay of commands makes late."""
    return [i for i in columns if term.cylinder in (None, i)]


def _taken(term: ActiveEffect, wanted_s: float) -> float:
    """What an effect takes over: less than it is to at an end of its range; a base keeps that."""
    spec, delay_s = term.effect.parameters[_at(term)], float(term.parameters[_at(term)])
    return min(max(wanted_s, spec.lower - delay_s), spec.upper - delay_s)


def _later(term: ActiveEffect, more_s: float) -> ActiveEffect:
    """An effect that is so much later; the same one where it is no later."""
    if more_s == 0.0:
        return term
    at, parameters = _at(term), term.parameters.copy()
    spec = term.effect.parameters[at]
    parameters[at] = min(max(float(parameters[at]) + more_s, spec.lower), spec.upper)
    return replace(term, parameters=parameters)


def _at(term: ActiveEffect) -> int:
    """Which of an effect's parameters is its delay."""
    (at,) = (i for i, spec in enumerate(term.effect.parameters) if spec.name == "delay")
    return at
