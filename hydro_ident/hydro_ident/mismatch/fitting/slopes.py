"""A model on the rows, and the slopes of everything in it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.fitting.stepping import is_free, with_values
from hydro_ident.mismatch.rows.contributions import said_twice
from hydro_ident.mismatch.rows.flow_laws import looks_at_valve
from hydro_ident.mismatch.rows.modelled import Model, on_signals, shapes
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import FloatArray

#: Step of a derivative as a share of a parameter's size.
_STEP = 1.0e-3
#: The same of delays, in sampling intervals.
_LATER = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A model as it is, before any slope of it is asked for.

    Attributes
    ----------
    model : Model
    residual : (N,) array
        Measured less predicted.
    base : (N, p) array
        Base columns.
    own : tuple of (N,) array or None
        What each of the model's terms contributes; None of those that are in its signals.
    shares : tuple of (N,) array or None
        What of it is each one's own share of the prediction.
    """

    model: Model
    residual: FloatArray
    base: FloatArray
    own: tuple[FloatArray | None, ...]
    shares: tuple[FloatArray | None, ...]


def start_at(predictor: Predictor, model: Model) -> Start:
    """A model on a predictor's rows.

    Parameters
    ----------
    predictor : Predictor
    model : Model

    Returns
    -------
    Start
    """
    y, x = predictor.base(model)
    residual = y - x @ predictor.parameters(model)
    own = tuple(None if on_signals(t) else predictor.contribution(model, t) for t in model.terms)
    shares = tuple(
        predictor.share(model, term) if values is not None and term.effect.needs_valve else values
        for term, values in zip(model.terms, own, strict=True)
    )
    for term, values in zip(model.terms, shares, strict=True):
        if values is not None and not shapes(term):
            residual = residual - values
    residual = residual + said_twice(predictor.signals, model)
    return Start(model, residual, x, own, shares)


def slopes_at(predictor: Predictor, start: Start) -> tuple[FloatArray, tuple[str, ...]]:
    """Slopes of everything in a model.

    Parameters
    ----------
    predictor : Predictor
    start : Start

    Returns
    -------
    columns : (N, p) array
        Slopes of the prediction: base parameters, then every effect's.
    names : tuple of str
    """
    columns, names = [_with_laws(predictor, start)], list(predictor.names)
    for term, own in zip(start.model.terms, start.own, strict=True):
        slopes, own_names = slopes_of(predictor, start.model, term, own)
        columns += slopes
        names += own_names
    return np.concatenate(columns, axis=1), tuple(names)


def _with_laws(predictor: Predictor, start: Start) -> FloatArray:
    """Base columns, those of delays and edges with what laws of the valve make of them."""
    model, base = start.model, start.base
    for term, share in zip(model.terms, start.shares, strict=True):
        if share is None or not looks_at_valve(term):
            continue
        base = base.copy() if base is start.base else base
        for at, step, moved in _moved_valves(predictor, model, term):
            base[:, at] += (predictor.share(moved, term) - share) / step
    return base


def _moved_valves(
    predictor: Predictor, model: Model, term: ActiveEffect
) -> Iterator[tuple[int, float, Model]]:
    """Columns of the valves that a law looks at, a step of each, and the model after it."""
    for index, at in predictor.delay_columns.items():
        if term.cylinder in (None, index):
            step_s = _LATER * predictor.material.stretches[0].trace.step_s
            delays = list(model.delays_s)
            delays[index] += step_s
            yield at, step_s, replace(model, delays_s=tuple(delays))
    names = [cylinder.name for cylinder in model.robot.cylinders]
    for valve in model.robot.valves:
        if term.cylinder not in (None, names.index(valve.cylinder)):
            continue
        for edge in ("c_pa", "c_at", "c_pb", "c_bt"):
            name, value = f"{valve.name}.{edge}", float(getattr(valve, edge))
            if name in predictor.names:
                step = _STEP * value
                yield (
                    predictor.names.index(name),
                    step,
                    replace(model, robot=with_values(model.robot, {name: value + step})),
                )


def linearised(
    predictor: Predictor, model: Model
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Residual of a model and the slopes of everything in it.

    Parameters
    ----------
    predictor : Predictor
    model : Model

    Returns
    -------
    residual : (N,) array
    columns : (N, p) array
        As `slopes_at`.
    names : tuple of str
    """
    start = start_at(predictor, model)
    return (start.residual, *slopes_at(predictor, start))


def slopes_of(
    predictor: Predictor, model: Model, term: ActiveEffect, own: FloatArray | None
) -> tuple[list[FloatArray], list[str]]:
    """Slopes of a term's contribution in its free parameters.

    Parameters
    ----------
    predictor : Predictor
    model : Model
        With or without the term.
    term : ActiveEffect
    own : (N,) array or None
        Its contribution; None of what is in the model's signals.

    Returns
    -------
    slopes : list of (N, 1) array
    names : list of str
    """
    slopes, names = [], []
    for i, spec in enumerate(term.effect.parameters):
        if is_free(term, i) and own is not None and _grows_with(term, i):
            slopes.append((own / term.parameters[i])[:, None])
            names.append(f"{term.target}.{term.effect.name}.{spec.name}")
        elif is_free(term, i):
            step, moved = _step(term, i), term.parameters.copy()
            moved[i] += step
            change = (
                predictor.change(model, term, moved)
                if own is None
                else predictor.contribution(model, term, moved) - own
            )
            slopes.append((change / step)[:, None])
            names.append(f"{term.target}.{term.effect.name}.{spec.name}")
    return slopes, names


def _grows_with(term: ActiveEffect, index: int) -> bool:
    """Whether all of a contribution is in proportion to a parameter, which is not near zero."""
    effect, spec = term.effect, term.effect.parameters[index]
    alone = effect.linear == (index,) and effect.reading is None and effect.change is None
    told = abs(term.parameters[index]) > _STEP * abs(spec.typical)
    return alone and told and not shapes(term)


def _step(term: ActiveEffect, index: int) -> float:
    """Step of a derivative, inwards from a bound."""
    spec = term.effect.parameters[index]
    size = abs(term.parameters[index]) or abs(spec.typical) or 1.0
    step = size * (1.0 if spec.linear else _STEP)
    if term.parameters[index] + step > spec.upper:
        return -step
    return step
