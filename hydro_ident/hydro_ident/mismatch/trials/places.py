"""Where along what was recorded the shapes of a law are tried: positions, pilots, instants."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro_ident.estimate.forces.closed_chain import LARGEST_SHARE, steel_masses
from hydro_ident.mismatch.rows.law_signals import wet_rows
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.onset import spacing
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.recorded_time import spread_instants
from hydro_model.effects.bending import next_parallel, usual_inertia
from hydro_model.effects.catalogue import CATALOGUE, ActiveEffect
from hydro_model.effects.flexibility import CARRIED, PLACE, hinged
from hydro_model.effects.signals import (
    JOINT_POSITION,
    PISTON_POSITION,
    PRESSURE_A,
    PRESSURE_B,
    TIP_HEIGHT,
    TRAVEL_HIGH,
    TRAVEL_LOW,
    VALVE_SIGNAL,
)
from hydro_model.effects.targets import joint_of
from hydro_model.multibody.rigid_body import inverse_dynamics, mass_matrix
from hydro_model.robot import Robot
from hydro_model.simulation.hinge_kernels import MOST_SWUNG

FURTHER_FACTORS = (0.4, 1.0, 2.5)
#: Places along a range at which positions and times are tried.
QUANTILES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
#: Shares of a recording in which something is run against: what a joint meets most of the time is
#: a spring, while a ground may be ploughed as long.
_MET, _PLOUGHED = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5), (0.7, 0.9)
#: Pilot ratios tried, over the usual one: from another's ratio a fit does not come to them.
_PILOT_RATIOS = (0.25, 0.5, 1.0, 2.0)
#: Instants tried for something that begins within a recording.
MOST_INSTANTS = 60
#: Fewer of them, two of which are tried together: every pair of them is paid for.
_MOST_ENDS = 8
#: Exponents of a ground: a spring's, and that of a body which is pressed in (Hertz).
_EXPONENTS = (1.0, 1.5)
#: Inertia of a mode, of what its joint moves in the middle of all ranges.
_LEAST_OF_JOINT, _MOST_OF_JOINT = 0.005, 2.0
#: Recorded poses that are looked at.
_MOST_POSES = 500
#: What a steel structure is damped by at most, and the frequency in Hz up to which rows of forces
#: (up to 10 Hz) show more of a mode than that it gives way.
_MODE_ENDS = {"frequency": 15.0, "damping": 0.5}
#: Poses at which a base is tilted, by how much in rad, and the share of the larger effect of the
#: two tilts from which one shows.
_POSES, _SMALL_TURN, _SHOWS = 8, 1.0e-3, 1.0e-2
#: Share of positions, at either end, that are too lone to put a station at.
_LONE = 0.005


def visited(predictor: Predictor, model: Model, one: ActiveEffect) -> tuple[float, float]:
    """Where along its travel the piston has been, but for single readings; shares of it."""
    rows = np.concatenate(
        [predictor.signals.of(model, s, one) for s in predictor.signals.readings.stretches(model)]
    )
    share = (rows[:, PISTON_POSITION] - rows[:, TRAVEL_LOW]) / (
        rows[:, TRAVEL_HIGH] - rows[:, TRAVEL_LOW]
    )
    share = share[np.isfinite(share)]
    if not share.size:
        return 0.0, 1.0
    begin, end = np.clip(np.quantile(share, (_LONE, 1.0 - _LONE)), 0.0, 1.0).tolist()
    return begin, end


def stations(begin: float, end: float) -> list[tuple[float, float]]:
    """Where five stations begin and end: along all that was visited, or half of it.

    A hump that is narrower than a quarter of the way lies between stations along the whole.
    """
    half = 0.5 * (end - begin)
    return [(begin, end), *((begin + k * half, begin + (k + 1.0) * half) for k in (0.0, 0.5, 1.0))]


def rubbing(predictor: Predictor, model: Model, one: ActiveEffect) -> float:
    """Viscous friction that the model has at a cylinder, N s/m; 0 where it has none."""
    name = f"{one.target}.viscous_friction"
    values = dict(zip(predictor.names, predictor.parameters(model).tolist(), strict=True))
    return float(max(values.get(name, 0.0), 0.0))


def pilots(predictor: Predictor, model: Model, one: ActiveEffect) -> list[tuple[float, ...]]:
    """Load-holding valves that open somewhere in the range that their pilot has gone through."""
    restriction, _, _, ratio = one.effect.typical.tolist()
    shapes: list[tuple[float, ...]] = [(restriction, 0.0, one.effect.parameters[2].lower, ratio)]
    own, other = (PRESSURE_A, PRESSURE_B) if one.side == "a" else (PRESSURE_B, PRESSURE_A)
    rows = np.concatenate(
        [predictor.signals.of(model, s, one) for s in predictor.signals.readings.stretches(model)]
    )
    outwards = rows[:, VALVE_SIGNAL] < 0.0 if one.side == "a" else rows[:, VALVE_SIGNAL] > 0.0
    for factor in _PILOT_RATIOS:
        pilot = rows[outwards, own] + factor * ratio * rows[outwards, other]
        pilot = pilot[np.isfinite(pilot)]
        if not pilot.size:
            continue
        low, middle, high = np.quantile(pilot, (QUANTILES[0], 0.5, QUANTILES[-1])).tolist()
        for begin, end in ((2.0 * low - middle, high), (low, middle), (middle, high)):
            span = max(end - begin, one.effect.parameters[2].lower)
            shapes.append((restriction, max(begin, 0.0), span, factor * ratio))
    return shapes


def bounded_bodies(robot: Robot, one: ActiveEffect) -> ActiveEffect:
    """Barrel and rod with masses of no more than such a cylinder's can be."""
    if one.cylinder is None:
        return one
    steel = steel_masses(robot.cylinders[one.cylinder])
    specs = tuple(
        replace(spec, upper=min(spec.upper, LARGEST_SHARE * mass_kg))
        for spec, mass_kg in zip(one.effect.parameters, steel, strict=True)
    )
    return replace(one, effect=replace(one.effect, parameters=specs))


def bounded_bend(robot: Robot, one: ActiveEffect) -> ActiveEffect:
    """A mode of some of what its joint moves, bent at that where no parallel joint follows.

    What is less than a two-hundredth of it, quicker than the rows of forces or damped like oil is
    no link that bends; of a joint without cylinder it is the rotor's (`contender.DRIVE_LIMITS`).
    """
    joint = joint_of(robot, one)
    usual, along = usual_inertia(robot, joint), next_parallel(robot, joint) >= 0
    specs = []
    for spec in one.effect.parameters:
        if (spec is PLACE and not along) or (spec is CARRIED and usual <= 0.0):
            spec = replace(spec, lower=0.0, upper=0.0)
        elif spec.name == "inertia" and usual > 0.0:
            least = 0.0 if one.cylinder is None else _LEAST_OF_JOINT * usual
            spec = replace(spec, lower=least, upper=_MOST_OF_JOINT * usual)
        elif spec.name in _MODE_ENDS and one.cylinder is not None:
            spec = replace(spec, upper=_MODE_ENDS[spec.name])
        specs.append(spec)
    return replace(one, effect=replace(one.effect, parameters=tuple(specs)))


def most_inertia(material: Material, robot: Robot, joint: int) -> float:
    """Most that a mode can take from a joint's own inertia in all recorded poses, kg m^2.

    With the other joints free to follow, a joint shows no more than ``1 / (M^-1)_ii``: with less
    than nothing left of it, no roll-out could begin. 0 where links are not those of any machine.

    Parameters
    ----------
    material : Material
    robot : Robot
        With the links that count.
    joint : int
    """
    q = np.concatenate([stretch.trace.q for stretch in material.stretches])
    q = q[np.isfinite(q).all(axis=1)]
    if not len(q):
        return 0.0
    mass = mass_matrix(robot, q[:: max(len(q) // _MOST_POSES, 1)])
    if np.linalg.eigvalsh(mass).min() <= 0.0:
        return 0.0
    return float(MOST_SWUNG / np.linalg.inv(mass)[:, joint, joint].max())


def own_mode(one: ActiveEffect, most: float) -> ActiveEffect:
    """A mode that its joint's own acceleration alone sets going, with no more than it can take.

    Parameters
    ----------
    one : ActiveEffect
        As `bounded_bend`; a hinge is left as it is.
    most : float
        As `most_inertia`.
    """
    if hinged(one.parameters):
        return one
    specs = tuple(
        replace(s, lower=min(s.lower, most), upper=min(s.upper, most))
        if s.name == "inertia"
        else s
        for s in one.effect.parameters
    )
    return replace(one, effect=replace(one.effect, parameters=specs))


def bounded_tilt(robot: Robot, one: ActiveEffect) -> ActiveEffect:
    """A tilt of the base of which only what turns gravity onto the drives is free.

    Of a planar machine the other part does nothing but scale gravity by its cosine, and would
    take whatever else does that.
    """
    change = one.effect.change
    if change is None:
        return one
    poses = np.random.default_rng(0).uniform(-1.0, 1.0, (_POSES, robot.dof))
    still = np.zeros_like(poses)
    level = inverse_dynamics(robot, poses, still, still)
    tilted = [change(robot, one.target, turn) for turn in _SMALL_TURN * np.eye(2)]
    loads = [inverse_dynamics(other, poses, still, still) for other in tilted]
    shown = np.array([np.abs(load - level).max() for load in loads])
    if not shown.any():
        return one
    specs = tuple(
        spec if shows else replace(spec, lower=0.0, upper=0.0)
        for spec, shows in zip(one.effect.parameters, shown > _SHOWS * shown.max(), strict=True)
    )
    return replace(one, effect=replace(one.effect, parameters=specs))


def tilts(one: ActiveEffect) -> list[tuple[float, ...]]:
    """Tilts to either side of every direction that is free, (roll, pitch)."""
    roll, pitch = one.effect.parameters
    size = CATALOGUE[one.effect.name].parameters[1].typical
    if roll.lower == roll.upper:
        return [(0.0, size)]
    if pitch.lower == pitch.upper:
        return [(size, 0.0)]
    return [(0.0, size), (size, size), (-size, size), (size, 0.0)]


def instants_of(material: Material) -> list[float]:
    """Instants at which something may begin within recordings, in s."""
    return spread_instants(material, MOST_INSTANTS)


def ends_of(material: Material) -> list[float]:
    """Fewer instants, at two of which something may begin and end; in s."""
    return spread_instants(material, _MOST_ENDS)


def passages(material: Material) -> list[tuple[float, float, float, float]]:
    """Shapes of what begins at one of those and ends at a later one.

    A step alone explains little of what comes and goes, and not the same in every block.

    Returns
    -------
    list of (float, float, float, float)
        When it comes, over what time, when it goes, over what time; in s.
    """
    instants = ends_of(material)
    wide_s = spacing(instants)
    return [(come, wide_s, go, wide_s) for come, go in itertools.combinations(instants, 2)]


def instant_spacing(material: Material) -> float:
    """What lies between two of `instants_of`, in s; 0 where there is a single one."""
    return spacing(instants_of(material))


def mean_oil_c(material: Material) -> float | None:
    """Mean oil temperature in deg C; None where not every recording has it."""
    seen = [s.trace.oil_c for s in material.stretches]
    known = [oil for oil in seen if oil is not None]
    if not known or len(known) < len(seen):
        return None
    return round(float(np.mean(np.concatenate(known))), 1)


def quantiles(
    predictor: Predictor,
    model: Model,
    one: ActiveEffect,
    signals: Sequence[int],
    shares: Sequence[float] = QUANTILES,
) -> list[float]:
    """Places along a law's signals at which its shapes are tried.

    Parameters
    ----------
    predictor : Predictor
    model : Model
    one : ActiveEffect
    signals : sequence of int
        Of `hydro_model.effects.signals`, taken together.
    shares : sequence of float
        Of the rows, below each of them.
    """
    values = []
    for stretch in predictor.signals.readings.stretches(model):
        if one.cylinder is not None:
            rows = wet_rows(model.robot, stretch, one.cylinder)
        else:
            rows = predictor.signals.of(model, stretch, one)
        values += [rows[:, signal] for signal in signals]
    together = np.concatenate(values)
    together = together[np.isfinite(together)]
    return [float(v) for v in np.quantile(together, shares)] if together.size else [0.0]


def grounds(predictor: Predictor, model: Model, one: ActiveEffect) -> list[tuple[float, ...]]:
    """Heights of a ground under the tip, or places that a joint runs against from either side.

    Parameters
    ----------
    predictor : Predictor
    model : Model
    one : ActiveEffect
        Of the whole robot, on all of whose joints a ground presses at once, or of one joint.

    Returns
    -------
    list of (float, float, float, float)
        Height (or place), way, exponent and damping.
    """
    if one.everywhere:
        under = quantiles(predictor, model, one, (TIP_HEIGHT,), _MET + _PLOUGHED)
        return [(z, 0.0, exponent, 0.0) for z in under for exponent in _EXPONENTS]
    below = quantiles(predictor, model, one, (JOINT_POSITION,), _MET)
    above = quantiles(predictor, model, one, (JOINT_POSITION,), [1.0 - s for s in _MET])
    sides = ((1.0, below), (-1.0, above))
    return [(way * q, way, 1.0, 0.0) for way, places in sides for q in places]
