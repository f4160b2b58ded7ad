"""From what was found to a robot: the model file's numbers with their covariance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.estimate.flows.chambers import INVERSE_BULK
from hydro_ident.estimate.forces.inertial import parameter_scales
from hydro_ident.identify.identified_robot import has_definite_mass
from hydro_ident.mismatch.fitting.fitted import Fitted
from hydro_ident.mismatch.fitting.prior import movable
from hydro_ident.mismatch.fitting.stepping import with_edges
from hydro_ident.mismatch.fitting.zeros import of_zeros
from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.rows.prediction import Predictor
from hydro_ident.mismatch.rows.skew import TORQUES
from hydro_model.effects.targets import ActiveEffect
from hydro_model.multibody.base_parameters import with_base
from hydro_model.robot import BaseParameter, Cylinder, EffectSpec, FloatArray, Joint, Robot

#: Difference between valves' delays that is worth a note.
_SAME_DELAY_S = 3.0e-4
#: A skew of pressures that is: so long, and so many deviations; of delays as many.
_SKEW_S, _DEVIATIONS = 5.0e-5, 3.0


@dataclass(frozen=True, slots=True)
class Modelled:
    """A robot with the findings in it.

    Attributes
    ----------
    robot : Robot
    notes : tuple of str
        What could not be taken over.
    """

    robot: Robot
    notes: tuple[str, ...]


def spec_of(term: ActiveEffect) -> EffectSpec:
    """An effect as a robot file lists it."""
    pairs = zip(term.effect.parameters, term.parameters, strict=True)
    return EffectSpec(term.effect.name, term.target, {p.name: float(v) for p, v in pairs})


def robot_of(
    predictor: Predictor, fitted: Fitted, given: Robot, fixed_base: bool = False
) -> Modelled:
    """The robot that a fit describes.

    Parameters
    ----------
    predictor : Predictor
    fitted : Fitted
    given : Robot
        Keeps what the fit does not determine.
    fixed_base : bool
        The base was kept within its deviations: it is written as the effects were fitted beside
        it, and what it states no deviation of stays as given (`prior.movable`).

    Returns
    -------
    Modelled
        Deviations are with the zeros of the transducers, which the fit's own covariance lacks.
    """
    effects = tuple(spec_of(term) for term in fitted.model.terms)
    covariance, names = fitted.covariance + of_zeros(predictor, fitted), predictor.names
    free = movable(predictor, given) if fixed_base else names
    refitted = not fixed_base or bool(set(free) & set(predictor.material.forces.base.names))
    kept = (given, ())
    robot, notes = _with_base(predictor, fitted, given, covariance) if refitted else kept
    sizes = np.sqrt(np.maximum(np.diag(covariance)[: len(names)], 0.0))
    values, std = (
        {name: float(own) for name, own in zip(names, found, strict=True) if name in free}
        for found in (predictor.parameters(fitted.model), sizes)
    )
    cylinders, fitted_std, refused = _cylinders(robot, values, std)
    deviations = dict(given.standard_deviations) if fixed_base else {}
    deviations |= fitted_std | _own_deviations(robot, std)
    told, held = _told_delays(predictor, fitted, std)
    delay_s, differ = _delay(fitted, told, held, given)
    if told and not held:
        deviations[DELAY] = max(told.values())
    deviations |= _effect_deviations(fitted, covariance)
    whole = replace(
        robot,
        joints=_joints(robot, values),
        cylinders=cylinders,
        valves=tuple(with_edges(valve, values) for valve in robot.valves),
        command_delay_s=delay_s,
        standard_deviations={k: v for k, v in deviations.items() if math.isfinite(v) and v > 0.0},
        effects=effects,
    )
    skews = _skew_notes(predictor, fitted, std)
    return Modelled(whole, (*notes, *refused, *differ, *_late_notes(whole), *skews))


def _cylinders(
    robot: Robot, values: Mapping[str, float], std: Mapping[str, float]
) -> tuple[tuple[Cylinder, ...], dict[str, float], tuple[str, ...]]:
    """Cylinders with fitted friction and moduli, their deviations, and what was not taken over."""
    cylinders, deviations, notes = list[Cylinder](), dict[str, float](), list[str]()
    for cylinder in robot.cylinders:
        viscous, bulk = f"{cylinder.name}.viscous_friction", f"{cylinder.name}.{INVERSE_BULK}"
        if values.get(viscous, 0.0) < 0.0:
            # No piston pushes itself: the motion did not tell.
            notes.append(
                f"{viscous} comes out negative ({values[viscous]:.3g} +- {std[viscous]:.2g}): the"
                " given one stays"
            )
        elif viscous in values:
            cylinder = replace(cylinder, viscous_friction=values[viscous])
            deviations[viscous] = std[viscous]
        if values.get(bulk, 0.0) > 0.0:
            modulus = 1.0 / values[bulk]
            cylinder = replace(cylinder, bulk_modulus_pa=modulus)
            deviations[f"{cylinder.name}.bulk_modulus"] = std[bulk] * modulus**2
        cylinders.append(cylinder)
    return tuple(cylinders), deviations, tuple(notes)


def _joints(robot: Robot, values: Mapping[str, float]) -> tuple[Joint, ...]:
    """Joints with fitted friction where they are without cylinder."""
    friction = [values.get(f"{j.name}.viscous_friction", j.viscous_friction) for j in robot.joints]
    return tuple(
        replace(joint, viscous_friction=float(own))
        for joint, own in zip(robot.joints, friction, strict=True)
    )


def _own_deviations(robot: Robot, std: Mapping[str, float]) -> dict[str, float]:
    """Deviations of the valves' edges, and of friction without a cylinder, that were fitted."""
    names = [
        f"{valve.name}.{e}" for valve in robot.valves for e in ("c_pa", "c_at", "c_pb", "c_bt")
    ]
    names += [f"{robot.joint_names[j]}.viscous_friction" for j in robot.dry_joints]
    return {name: std[name] for name in names if name in std}


def _told_delays(
    predictor: Predictor, fitted: Fitted, std: Mapping[str, float]
) -> tuple[dict[int, float], bool]:
    """Deviations of the delays that were fitted, by cylinder, and whether any is at a bound.

    A delay that no row tells stays at the robot file's, without a deviation. One at a bound has
    none either, nor the one that stays beside an effect of the same name.
    """
    beside = [term.cylinder for term in fitted.model.terms if term.effect.name == DELAY]
    told, held = dict[int, float](), False
    for index, at in predictor.delay_columns.items():
        name = predictor.names[at]
        bound = name in fitted.held
        if name in std and (std[name] > 0.0 or bound or None in beside or index in beside):
            told[index] = std[name]
            held |= bound
    return told, held


def _delay(
    fitted: Fitted, told: Mapping[int, float], held: bool, given: Robot
) -> tuple[float, tuple[str, ...]]:
    """One command delay for all valves, and a note where theirs differ."""
    if not told:
        return given.command_delay_s, ()
    own = [fitted.model.delays_s[index] for index in told]
    sizes = np.array(list(told.values()))
    doubt_s = _DEVIATIONS * float(np.hypot(sizes[np.argmin(own)], sizes[np.argmax(own)]))
    if max(own) - min(own) <= max(_SAME_DELAY_S, doubt_s):
        # Of one and the same the valve that was hardly moved says as little as it knows.
        weights = None if held or not sizes.all() else sizes**-2.0
        return float(np.average(own, weights=weights)), ()
    found = ", ".join(f"{1e3 * value:.2g}" for value in own)
    note = f"the valves' command delays differ ({found} ms): the model has their mean"
    return float(np.mean(own)), (note,)


def _late_notes(robot: Robot) -> tuple[str, ...]:
    """How late commands are in all: of it a finding has what goes beyond the base's own delay."""
    base_s = robot.command_delay_s
    return tuple(
        f"commands of {one.target} are {1e3 * (base_s + one.parameters['delay']):.3g} ms late in"
        f" all: {1e3 * base_s:.3g} ms of command_delay_s, which is fitted and no finding, and what"
        " command_delay adds"
        for one in robot.effects
        if one.name == DELAY
    )


def _skew_notes(predictor: Predictor, fitted: Fitted, std: Mapping[str, float]) -> tuple[str, ...]:
    """Which readings come earlier or later than positions: no model file knows."""
    notes, robot = [], predictor.material.robot
    for reading, at in predictor.skew_columns.items() if fitted.model.skews_s else ():
        skew_s, error_s = fitted.model.skews_s[reading], std[predictor.names[at]]
        held = predictor.names[at] in fitted.held
        if abs(skew_s) >= (_SKEW_S if held else max(_SKEW_S, _DEVIATIONS * error_s)):
            what = "torques are"
            if reading != TORQUES:
                cylinder = robot.cylinders[reading // 2].name
                what = f"pressure of {cylinder}/{'ab'[reading % 2]} is"
            when = "after" if skew_s > 0.0 else "before"
            how_well = "ms or more" if held else f"+- {1e3 * error_s:.2f} ms"
            end = ", as far as a base goes" if held else ""
            notes.append(
                f"the {what} read {1e3 * abs(skew_s):.2f} {how_well} {when} positions{end}: taken"
                " out, not in the model"
            )
    return tuple(notes)


def _effect_deviations(fitted: Fitted, covariance: FloatArray) -> dict[str, float]:
    """Deviations of the effects' fitted parameters, by `<target>.<effect>.<parameter>`."""
    names = {
        f"{term.target}.{term.effect.name}.{spec.name}"
        for term in fitted.model.terms
        for spec in term.effect.parameters
    }
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    pairs = zip(fitted.names, std, strict=True)
    return {name: float(size) for name, size in pairs if name in names and size > 0.0}


def _with_base(
    predictor: Predictor, fitted: Fitted, given: Robot, covariance: FloatArray
) -> tuple[Robot, tuple[str, ...]]:
    """Base parameters where they make a possible machine; else the given ones."""
    forces = predictor.material.forces
    if forces.names[0] not in predictor.names:
        return given, ()
    base, count = forces.base, len(forces.base.names)
    std = np.sqrt(np.maximum(np.diag(covariance)[:count], 0.0))
    theta = fitted.model.theta[:count]
    # A number without deviation is none that was fitted.
    known = (std > 0.0) & (std < parameter_scales(forces, theta, std)[:count])
    values = np.where(known, theta, base.combination @ given.parameter_vector)
    robot = replace(
        with_base(given, base, values),
        base_parameters=tuple(
            BaseParameter(name, base.coefficients(i), float(values[i]))
            for i, name in enumerate(base.names)
        ),
        base_covariance=np.where(np.outer(known, known), covariance[:count, :count], 0.0),
        # Those reproduce the base parameters that they were made with, and no others.
        standard_parameters={},
    )
    if has_definite_mass(robot):
        return robot, ()
    text = (
        "the refitted base parameters make no positive definite mass matrix: the given ones stay"
    )
    return given, (text,)


def summary_of(terms: Sequence[ActiveEffect]) -> str:
    """Effects in a line, for notes."""
    return ", ".join(f"{t.effect.name} of {t.target}" for t in terms) or "none"
