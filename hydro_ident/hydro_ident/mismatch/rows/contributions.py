"""What an effect contributes to the prediction, filtered onto the rows.

One definition serves candidates and chosen effects alike. Laws at an additive stage are evaluated
by themselves, those of the valve's flow behind one another; laws on the valve signal or on the
rails re-evaluate the edges and what flow laws leave of them; changes of the robot
re-evaluate the inverse dynamics; readings re-evaluate the whole residual with the sensors' signals
corrected (a reading of the opposite sign undoes it).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from hydro_ident.estimate.effects.listed_laws import middle
from hydro_ident.estimate.flows.chambers import Chamber, edge_integrals
from hydro_ident.estimate.flows.in_series import before, valve_laws
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.rows.flow_laws import held_flows, looks_at_valve
from hydro_ident.mismatch.rows.force_rows import forces_of, measured
from hydro_ident.mismatch.rows.material import Place, Stretch, pressure_of
from hydro_ident.mismatch.rows.modelled import Model, gives_way, reading_key, same, shapes
from hydro_ident.mismatch.rows.shaping import Signals
from hydro_model.effects.catalogue import acting_share
from hydro_model.effects.law import COMPLIANCE, FLOW, VOLUME, Stage
from hydro_model.effects.signals import LEVER
from hydro_model.effects.targets import ActiveEffect, joint_of, parts
from hydro_model.hydraulics.cylinder import chamber_volumes
from hydro_model.robot import FloatArray, Robot

_BALANCE = {*FLOW.values(), *VOLUME.values(), *COMPLIANCE.values()}


def contribution(signals: Signals, model: Model, one: ActiveEffect) -> FloatArray:
    """What the prediction gains by an effect on top of a model's other effects, (N,).

    What it leaves flow laws behind it to restrict is part of that.

    Parameters
    ----------
    signals : Signals
    model : Model
        With or without the effect.
    one : ActiveEffect
    """
    without = replace(model, terms=tuple(t for t in model.terms if not same(t, one)))
    if one.effect.reading is not None:
        plain = replace(without, terms=tuple(t for t in without.terms if t.effect.reading))
        return signals.kept_plain(plain, _plain_residual) - _plain_residual(
            signals, plain.with_term(one)
        )
    result = np.zeros(signals.material.size)
    stages = set(one.effect.stages)
    known = one.effect.known_torques is not None
    if one.effect.change is not None or known:
        _add_change(signals, without, one, result)
    if Stage.FRICTION in stages and not known:
        result += _friction(signals, without, one)
    if shapes(one) or _in_company(without, one):
        _add_edges(signals, one, (without, without.with_term(one)), result)
    elif stages & _BALANCE:
        _add_balance(signals, without, one, result)
    return result


def own_share(signals: Signals, model: Model, one: ActiveEffect) -> FloatArray:
    """What an effect of a model adds to its prediction itself, (N,).

    The shares of all effects that do not act through the edges are, together with these, the
    prediction: of what a flow law adds, those before it have had theirs.

    Parameters
    ----------
    signals : Signals
    model : Model
        With the effect.
    one : ActiveEffect
    """
    if not one.effect.needs_valve:
        return contribution(signals, model, one)
    result = np.zeros(signals.material.size)
    _add_balance(signals, model, one, result)
    return result


def changed(signals: Signals, model: Model, one: ActiveEffect, moved: ActiveEffect) -> FloatArray:
    """What the prediction gains where an effect of a model is another of its name, (N,).

    The difference of their contributions, without what both have in common.

    Parameters
    ----------
    signals : Signals
    model : Model
        With the effect.
    one, moved : ActiveEffect
        A reading, or what acts through the edges and in no other way.
    """
    terms = tuple(moved if t is one else t for t in model.terms)
    if one.effect.reading is not None:
        readings = [tuple(t for t in own if t.effect.reading) for own in (model.terms, terms)]
        now, then = (replace(model, terms=own) for own in readings)
        return signals.kept_plain(now, _plain_residual) - _plain_residual(signals, then)
    result = np.zeros(signals.material.size)
    _add_edges(signals, one, (model, replace(model, terms=terms)), result)
    return result


def compressed(chamber: Chamber, trace: Trace) -> tuple[FloatArray, FloatArray]:
    """A chamber's volume, and its volume times the rise of its pressure per interval."""
    side = 0 if chamber.side == "a" else 1
    volume = chamber_volumes(chamber.cylinder, trace.stroke[:, chamber.index])[side]
    return volume, middle(volume) * np.diff(pressure_of(chamber, trace))


def _plain_residual(signals: Signals, model: Model) -> FloatArray:
    """Residual of the base alone, regressor columns not kept apart."""
    material = signals.material
    result = np.zeros(material.size)
    terms = [term for term in model.terms if term.effect.reading is not None]
    for s, stretch in enumerate(signals.readings.corrected(terms)):
        places = [p for p in material.places if p.stretch == s]
        forced = [p for p in places if not material.is_flow(p.channel)]
        if forced and stretch.moved is not None:
            predicted = signals.regressor(stretch, stretch.moved) @ model.theta
            values = measured(material, stretch) - predicted
            for place in forced:
                result[place.rows] = values[:, material.joint_of(place.channel)]
        for place in places:
            if material.is_flow(place.channel):
                index = material.chamber_index(place.channel)
                chamber = material.chambers[index]
                volume, squeezed = compressed(chamber, stretch.trace)
                inverse = 1.0 / model.robot.cylinders[chamber.index].bulk_modulus_pa
                flow = _edges_at(
                    model.robot, chamber, stretch.trace, model.delays_s[chamber.index]
                )
                steps = np.diff(volume) + inverse * squeezed - flow
                result[place.rows] = material.windowed(stretch, index, steps)
    return result


def _add_change(signals: Signals, model: Model, one: ActiveEffect, into: FloatArray) -> None:
    plain, material = model.robot, signals.material
    for s, stretch in enumerate(signals.readings.stretches(model)):
        places = [p for p in material.places if p.stretch == s]
        places = [p for p in places if not material.is_flow(p.channel)]
        if not places or stretch.moved is None:
            continue
        extra = signals.changes.extra(plain, one, stretch)
        extra = extra * acting_share(one, stretch.trace.time_s)[:, None]
        filtered = forces_of(material, plain, stretch, extra)
        for place in places:
            into[place.rows] += filtered[:, material.joint_of(place.channel)]


def _friction(signals: Signals, model: Model, one: ActiveEffect) -> FloatArray:
    """What an effect's friction comes to, (N,); not to be changed: it is kept.

    It follows from readings and its own numbers alone, and many models hold it at the same ones.
    """
    make = partial(_friction_rows, signals, model, one)
    if one.effect.needs_valve:
        return make()
    own = one.effect, one.target, tuple(one.parameters.tolist())
    return signals.frictions.of((*own, reading_key(model)), make)


def _friction_rows(signals: Signals, model: Model, one: ActiveEffect) -> FloatArray:
    material = signals.material
    into = np.zeros(material.size)
    own = {joint_of(material.robot, part): part for part in parts(material.robot, one)}
    for place in material.places:
        if material.is_flow(place.channel) or material.joint_of(place.channel) not in own:
            continue
        part = own[material.joint_of(place.channel)]
        stretch = signals.readings.stretches(model)[place.stretch]
        rows = signals.of(model, stretch, part)
        force = one.effect.evaluate(rows, one.parameters, Stage.FRICTION, stretch.trace.step_s)
        if material.forces.torque and part.joint is None:
            force = force * rows[:, LEVER]
        into[place.rows] += material.filtered(stretch, force)
    return into


def _add_balance(signals: Signals, model: Model, one: ActiveEffect, into: FloatArray) -> None:
    for place, stretch, chamber in _balances(signals, model, one):
        if one.side and chamber.side != one.side:
            continue
        trace = signals.shaped(model, stretch)
        rows = signals.wet(model, stretch, chamber.index, shaped=True)
        side = 0 if chamber.side == "a" else 1
        volume = chamber_volumes(chamber.cylinder, trace.stroke[:, chamber.index])[side]
        inverse = 1.0 / model.robot.cylinders[chamber.index].bulk_modulus_pa
        rise = -np.diff(pressure_of(chamber, trace))
        steps = np.zeros(trace.samples - 1)
        if FLOW[chamber.side] in one.effect.stages:
            steps = _flow_steps(signals, model, one, stretch, chamber)
        for stages, others, weight in (
            # A volume is as soft, and what is soft as large, as the other effects make them.
            (VOLUME, COMPLIANCE, inverse),
            (COMPLIANCE, VOLUME, volume),
        ):
            stage = stages[chamber.side]
            if stage in one.effect.stages:
                law = one.effect.evaluate(rows, one.parameters, stage, trace.step_s)
                weight = weight + _laws(signals, model, stretch, chamber, others)
                steps = steps + middle(law * weight) * rise
        index = signals.material.chamber_index(place.channel)
        into[place.rows] += signals.material.windowed(stretch, index, steps)


def _flow_steps(
    signals: Signals, model: Model, one: ActiveEffect, stretch: Stretch, chamber: Chamber
) -> FloatArray:
    """Volume into a chamber per sampling interval by the law of an effect."""
    index, side, step_s = chamber.index, chamber.side, stretch.trace.step_s
    if looks_at_valve(one):
        laws = before(valve_laws(model.terms, index, side), one)
        return held_flows([*laws, one], side, signals.held(model, stretch, index), step_s)[-1]
    rows = signals.wet(model, stretch, index, shaped=True)
    return middle(one.effect.evaluate(rows, one.parameters, FLOW[side], step_s)) * step_s


def said_twice(signals: Signals, model: Model) -> FloatArray:
    """What is in two of a model's contributions, and in what it predicts once, (N,).

    The air in the volume of a hose: the volume's, and the air's.

    Parameters
    ----------
    signals : Signals
    model : Model
    """
    material = signals.material
    result = np.zeros(material.size)
    stages = {stage for term in model.terms for stage in term.effect.stages}
    if not all(stages.intersection(both.values()) for both in (VOLUME, COMPLIANCE)):
        return result
    for place in material.places:
        if material.is_flow(place.channel):
            index = material.chamber_index(place.channel)
            chamber, stretch = (
                material.chambers[index],
                signals.readings.stretches(model)[place.stretch],
            )
            both = [_laws(signals, model, stretch, chamber, s) for s in (VOLUME, COMPLIANCE)]
            rise = -np.diff(pressure_of(chamber, stretch.trace))
            steps = middle(both[0] * both[1]) * rise
            result[place.rows] = material.windowed(stretch, index, steps)
    return result


def _laws(
    signals: Signals,
    model: Model,
    stretch: Stretch,
    chamber: Chamber,
    stages: Mapping[str, Stage],
) -> FloatArray:
    """What a model's effects add to a chamber at a stage, (N,)."""
    stage, step_s = stages[chamber.side], stretch.trace.step_s
    result = np.zeros(stretch.trace.samples)
    for term in model.terms:
        if stage in term.effect.stages and term.cylinder in (None, chamber.index):
            rows = signals.wet(model, stretch, chamber.index, shaped=True)
            if term.side in ("", chamber.side):
                result += term.effect.evaluate(rows, term.parameters, stage, step_s)
    return result


def _add_edges(
    signals: Signals, one: ActiveEffect, models: tuple[Model, Model], into: FloatArray
) -> None:
    """What passes the valve more in the second of two models, where an effect acts."""
    for place, stretch, chamber in _balances(signals, models[0], one):
        first = signals.kept_passing(models[0], stretch, chamber, _passing)
        second = _passing(signals, models[1], stretch, chamber)
        index = signals.material.chamber_index(place.channel)
        into[place.rows] += signals.material.windowed(stretch, index, second - first)


def _in_company(model: Model, one: ActiveEffect) -> bool:
    """Whether an effect is a law of a valve's flow beside others of it, or rails that give way."""
    if not one.effect.needs_valve:
        return False
    return any(gives_way(term) or _in_series(term, one) for term in model.terms)


def _in_series(term: ActiveEffect, one: ActiveEffect) -> bool:
    """Whether another effect is a law of the same flow."""
    if not term.effect.needs_valve or same(term, one):
        return False
    near = None in (term.cylinder, one.cylinder) or term.cylinder == one.cylinder
    return near and (not (term.side and one.side) or term.side == one.side)


def _passing(signals: Signals, model: Model, stretch: Stretch, chamber: Chamber) -> FloatArray:
    """Volume through both edges, and what flow laws leave of it, per sampling interval."""
    trace = signals.shaped(model, stretch)
    volume = _edges_at(model.robot, chamber, trace, model.delays_s[chamber.index])
    laws = valve_laws(model.terms, chamber.index, chamber.side)
    if not laws:
        return volume
    held = signals.held(model, stretch, chamber.index)
    return np.asarray(volume + sum(held_flows(laws, chamber.side, held, trace.step_s)))


def _balances(
    signals: Signals, model: Model, one: ActiveEffect
) -> Iterator[tuple[Place, Stretch, Chamber]]:
    """Places of the balances that an effect acts on."""
    material = signals.material
    for place in material.places:
        if material.is_flow(place.channel):
            chamber = material.chambers[material.chamber_index(place.channel)]
            if one.cylinder is None or chamber.index == one.cylinder:
                yield place, signals.readings.stretches(model)[place.stretch], chamber


def _edges_at(robot: Robot, chamber: Chamber, trace: Trace, delay_s: float) -> FloatArray:
    """Volume through both edges per sampling interval."""
    opening, closing = edge_integrals(chamber, trace, delay_s)
    valve = robot.valve_of(chamber.cylinder.name)
    first, second = chamber.edges
    return opening * float(getattr(valve, first)) + closing * float(getattr(valve, second))
