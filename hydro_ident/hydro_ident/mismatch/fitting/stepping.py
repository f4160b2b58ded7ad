"""Steps of a fit: a model's numbers moved within their physical bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.mismatch.fitting.limits import Limits
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.ripple import largest_ripple
from hydro_ident.mismatch.rows.skew import TORQUES, is_listed, largest_skew
from hydro_ident.mismatch.settings import LEAST_EXCESS
from hydro_model.effects.flexibility import CARRIED, PLACE
from hydro_model.effects.friction import BEND, VELOCITY_SCALE
from hydro_model.effects.targets import ActiveEffect
from hydro_model.effects.valve_effects import KNEE, TRAVEL
from hydro_model.multibody.base_parameters import with_base
from hydro_model.robot import FloatArray, Robot, Valve

#: A shape parameter moves by no more than this factor per pass.
_FACTOR = 2.0
#: Parameters that only round a law's corners: fitted, they would turn it into another one. Of a
#: play, from what force on the pin lies: samples pass that or do not. Of a drift, those that its
#: size says as well. Of a load, over what it is taken up: searched for with the instant.
HELD = {
    ("valve_rate_limit", "time_constant"),
    ("valve_hysteresis", "time_constant"),
    ("backlash", "contact_force"),
    ("backlash", "drag"),
    ("counterbalance_spring", "about"),
    ("external_contact", "way"),
    ("external_contact", "exponent"),
    ("temperature_drift", "halving_temperature"),
    ("temperature_drift", "rise"),
    ("temperature_drift", "reference"),
}
#: What a law turns around over: the one that is in use is fitted.
WAYS = (BEND.name, VELOCITY_SCALE.name)
#: How the names of viscous friction end.
VISCOUS = ".viscous_friction"
#: A delay of less than this share of a cycle is none: a step to less is no step.
_NO_DELAY = 0.05
#: Steps of the delay below this change nothing that could be measured.
_LEAST_DELAY_S = 1.0e-7
_BULK_BOUNDS = (1.0e-10, 1.0e-7)


def moved(training: Training, model: Model, step: FloatArray) -> Model:
    """The model after a Gauss-Newton step, within physical bounds."""
    predictor = training.predictor
    values = dict(zip(predictor.names, predictor.parameters(model), strict=True))
    count = len(values)
    for name, change in zip(predictor.names, step[:count], strict=True):
        values[name] += float(change)
        if name.endswith(VISCOUS):
            values[name] = max(values[name], 0.0)
    robot = with_values(model.robot, values)
    forces = predictor.material.forces.names
    theta = np.array([values.get(n, t) for n, t in zip(forces, model.theta, strict=True)])
    robot = _with_inertia(predictor, robot, theta)
    delays = _delays(training, model, step)
    terms, at = [], count
    for term in model.terms:
        width = sum(is_free(term, i) for i in range(len(term.effect.parameters)))
        terms.append(stepped(term, step[at : at + width]))
        at += width
    most, now = largest_ripple(training.cycle_s), predictor.parameters(model)
    ripples = list(model.ripples or (0.0,) * len(robot.cylinders))
    for index, k in predictor.ripple_columns.items():
        ripples[index] = float(np.clip(now[k] + step[k], -most, most))
    skews = _skews(training, model, step)
    return Model(robot, theta, delays, tuple(terms), tuple(ripples), skews)


def _skews(training: Training, model: Model, step: FloatArray) -> tuple[float, ...]:
    """How late readings are after a step; none beside an effect that says so."""
    now = training.predictor.parameters(model)
    readings = [*range(2 * len(model.robot.cylinders)), TORQUES]
    result = dict(zip(readings, model.skews_s or (0.0,) * len(readings), strict=True))
    for reading, at in training.predictor.skew_columns.items():
        most = largest_skew(reading, training.cycle_s)
        result[reading] = float(np.clip(now[at] + step[at], -most, most))
    return tuple(0.0 if is_listed(model.terms, one) else s for one, s in result.items())


def _delays(training: Training, model: Model, step: FloatArray) -> tuple[float, ...]:
    """Delays of the valves after a step, of up to the base's own and what fits err by."""
    result = list(model.delays_s)
    for index, at in training.predictor.delay_columns.items():
        longest = longest_delay(training, index)
        fresh = min(max(result[index] + float(step[at]), 0.0), longest)
        if abs(fresh - result[index]) >= _LEAST_DELAY_S:
            result[index] = fresh
    return tuple(result)


def stepped(term: ActiveEffect, step: FloatArray) -> ActiveEffect:
    """A term after a step of its free parameters, as far as that may go (`term_limits`)."""
    parameters, limits = term.parameters.copy(), term_limits(term)
    changes = iter(np.clip(step, limits.lower, limits.upper))
    for i, spec in enumerate(term.effect.parameters):
        if is_free(term, i):
            value = float(parameters[i] + next(changes))
            parameters[i] = min(max(value, spec.lower), spec.upper)
    return replace(term, parameters=parameters)


def _with_inertia(predictor: Predictor, robot: Robot, theta: FloatArray) -> Robot:
    """A robot whose links carry the base parameters: changes of it start from there."""
    base = predictor.material.forces.base
    return with_base(robot, base, theta[: len(base.names)])


def with_values(robot: Robot, values: Mapping[str, float]) -> Robot:
    """A robot with fitted bulk moduli and edges; impossible ones stay as they were."""
    cylinders = []
    for cylinder in robot.cylinders:
        inverse = values.get(f"{cylinder.name}.{INVERSE_BULK}", 0.0)
        if _BULK_BOUNDS[0] < inverse < _BULK_BOUNDS[1]:
            cylinder = replace(cylinder, bulk_modulus_pa=1.0 / inverse)
        cylinders.append(cylinder)
    valves = []
    for valve in robot.valves:
        valves.append(with_edges(valve, values))
    return replace(robot, cylinders=tuple(cylinders), valves=tuple(valves))


def with_edges(valve: Valve, values: Mapping[str, float]) -> Valve:
    """A valve with fitted edges; impossible ones stay as they were."""
    c_pa, c_at, c_pb, c_bt = (
        value if (value := values.get(f"{valve.name}.{edge}", 0.0)) > 0.0 else own
        for edge, own in (
            ("c_pa", valve.c_pa),
            ("c_at", valve.c_at),
            ("c_pb", valve.c_pb),
            ("c_bt", valve.c_bt),
        )
    )
    return replace(valve, c_pa=c_pa, c_at=c_at, c_pb=c_pb, c_bt=c_bt)


def limits_of(training: Training, model: Model) -> Limits:
    """How far a step may go in every column, either way.

    Delays and skews go no further than their range, viscous friction no further than to none, an
    effect's numbers as `term_limits`.
    """
    predictor = training.predictor
    now = predictor.parameters(model)
    lower, upper = np.full(now.size, -np.inf), np.full(now.size, np.inf)
    for index, at in predictor.delay_columns.items():
        lower[at] = -model.delays_s[index]
        upper[at] = max(longest_delay(training, index) - model.delays_s[index], lower[at])
    for at in _viscous(training):
        lower[at] = -max(float(now[at]), 0.0)
    largest = dict.fromkeys(predictor.ripple_columns.values(), largest_ripple(training.cycle_s))
    for reading, at in predictor.skew_columns.items():
        largest[at] = largest_skew(reading, training.cycle_s)
    for at, most in largest.items():
        lower[at], upper[at] = min(-most - now[at], 0.0), max(most - now[at], 0.0)
    parts = [term_limits(term) for term in model.terms]
    return Limits(
        np.concatenate([lower, *(part.lower for part in parts)]),
        np.concatenate([upper, *(part.upper for part in parts)]),
    )


def term_limits(term: ActiveEffect) -> Limits:
    """How far a step of an effect's free parameters may go: within bounds, shapes by factors.

    What can be 0, such as a null bias, has either sign: factors would hold it to its first one.
    """
    ends = list[tuple[float, float]]()
    for i, spec in enumerate(term.effect.parameters):
        if is_free(term, i):
            value = float(term.parameters[i])
            most = np.inf
            if not spec.linear and value != 0.0 and not spec.lower < 0.0 < spec.upper:
                most = abs(value) * (_FACTOR - 1.0) / _FACTOR
            ends.append((max(spec.lower - value, -most), min(spec.upper - value, most)))
    lower, upper = np.array(ends).reshape(-1, 2).T
    return Limits(np.minimum(lower, 0.0), np.maximum(upper, 0.0))


def said_columns(training: Training, model: Model) -> list[int]:
    """Columns that can take no step beside an effect that is the same."""
    predictor = training.predictor
    delays = [i for i in predictor.delay_columns if _is_quickest(training, model, i)]
    skews = [one for one in predictor.skew_columns if is_listed(model.terms, one)]
    return [
        *(predictor.delay_columns[i] for i in delays),
        *(predictor.skew_columns[one] for one in skews),
    ]


def bounded_columns(training: Training, model: Model, step: FloatArray) -> list[int]:
    """Columns that can take no step for their bound."""
    held = [
        at
        for index, at in training.predictor.delay_columns.items()
        if (step[at] > 0.0 and at_longest_delay(training, model, index))
        or (step[at] < 0.0 and model.delays_s[index] < _NO_DELAY * training.cycle_s)
    ]
    predictor, cycle_s = training.predictor, training.cycle_s
    now = predictor.parameters(model)
    # What rubs the less the faster it goes has no viscous friction, but a law of its own.
    held += [at for at in _viscous(training) if now[at] <= 0.0 and step[at] < 0.0]
    bounds = dict.fromkeys(predictor.ripple_columns.values(), largest_ripple(cycle_s))
    bounds |= {at: largest_skew(one, cycle_s) for one, at in predictor.skew_columns.items()}
    ends = [k for k, most in bounds.items() if abs(now[k]) >= most and now[k] * step[k] > 0.0]
    return held + ends


def listed_columns(training: Training, model: Model) -> list[int]:
    """Columns of shapes that stay as the robot file lists them.

    Parameters
    ----------
    training : Training
    model : Model
    """
    free = [
        (term, i)
        for term in model.terms
        for i in range(len(term.effect.parameters))
        if is_free(term, i)
    ]
    count = len(training.predictor.names)
    return [count + k for k, (term, i) in enumerate(free) if training.stays(term, i)]


def _viscous(training: Training) -> list[int]:
    """Columns of viscous friction, which takes energy and gives none."""
    return [k for k, name in enumerate(training.predictor.names) if name.endswith(VISCOUS)]


def longest_delay(training: Training, index: int) -> float:
    """The base's own command delay at a cylinder, s, and what is no finding yet beyond it.

    Exactly its own is left where the effect of the same name is in the model, and to a valve that
    is held to what the others have (`odd_valve`).
    """
    if index in training.latest_s:
        return training.latest_s[index]
    return training.own_delay_s + LEAST_EXCESS * training.cycle_s


def at_longest_delay(training: Training, model: Model, index: int) -> bool:
    """Whether a cylinder's valve is as late as a base may make it."""
    return bool(model.delays_s[index] >= longest_delay(training, index) - _LEAST_DELAY_S)


def _is_quickest(training: Training, model: Model, index: int) -> bool:
    """Whether a valve is the one that the effect of the same name leaves at its delay."""
    terms = [t for t in model.terms if t.effect.name == DELAY]
    if any(t.cylinder == index for t in terms):
        return True
    if all(t.cylinder is not None for t in terms):
        return False
    columns = training.predictor.delay_columns
    return index == min(columns, key=lambda one: model.delays_s[one])


def form_of(term: ActiveEffect) -> tuple[float, ...]:
    """The values of an effect that every fit leaves as they are."""
    held = [(term.effect.name, spec.name) in HELD for spec in term.effect.parameters]
    return tuple(term.parameters[held].tolist())


def is_shape(term: ActiveEffect, index: int) -> bool:
    """Whether a parameter is fitted, and not in proportion to what the effect does.

    Parameters
    ----------
    term : ActiveEffect
    index : int
    """
    return is_free(term, index) and not term.effect.parameters[index].linear


def is_free(term: ActiveEffect, index: int) -> bool:
    """Whether a parameter is fitted; instants are scanned, corners stay as they are."""
    spec = term.effect.parameters[index]
    name = spec.name
    if spec.lower == spec.upper:
        return False
    if name in WAYS and BEND in term.effect.parameters:
        bends = bool(term.parameters[term.effect.parameters.index(BEND)] > 0.0)
        return bends == (name == BEND.name)
    if spec is TRAVEL or spec is KNEE:
        # A play stays one, and a parabola: other branches start from theirs.
        return bool(term.parameters[index] > 0.0)
    if spec is CARRIED or spec is PLACE:
        # A mode that its own joint alone sets going stays one.
        return bool(term.parameters[term.effect.parameters.index(CARRIED)] > 0.0)
    return name not in term.effect.edges and (term.effect.name, name) not in HELD
