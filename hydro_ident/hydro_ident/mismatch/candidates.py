"""Every effect of the catalogue at every target, in every shape that is tried.

A trial is an effect with its shape parameters set. What is linear in it becomes a column per
linear parameter; an effect without linear parameters becomes one column, the change it makes at
the size that is tried, whose free coefficient stands for its size to first order.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.mismatch.material import Material
from hydro_ident.mismatch.places import (
    FURTHER_FACTORS,
    QUANTILES,
    bounded_bodies,
    bounded_tilt,
    grounds,
    instant_spacing,
    instants_of,
    mean_oil_c,
    passages,
    pilots,
    quantiles,
    rubbing,
    tilts,
    visited,
)
from hydro_ident.mismatch.prediction import Model, Predictor
from hydro_ident.mismatch.testable import untestable
from hydro_model.effects.catalogue import CATALOGUE, ActiveEffect, targets
from hydro_model.effects.effect import Effect
from hydro_model.effects.friction import BEND, VELOCITY_SCALE
from hydro_model.effects.law import ParameterSpec
from hydro_model.effects.readings import EVERY_CHAMBER
from hydro_model.effects.targets import at_work, places
from hydro_model.effects.valve_edges import SHIFT
from hydro_model.effects.valve_effects import KNEE, TRAVEL
from hydro_model.robot import FloatArray
from hydro_model.signals import (
    PISTON_FORCE,
    PISTON_POSITION,
    VALVE_RATE,
    VALVE_SIGNAL,
)

#: Shapes tried around the typical value: of the first needed parameter, of further ones, and of
#: those optional ones that a fit from the typical value alone would not find.
FIRST_FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
#: Sizes tried of effects that do not grow like their size.
SIZE_FACTORS = (0.04, 0.12, 0.35, 1.0, 3.0)
SCANNED_FACTORS = (0.25, 1.0, 4.0)
SCANNED = ("velocity_scale", "time_constant", "contact_force")
#: Effects whose optional shapes of these names are all scanned.
_SCANNED_WHOLE = ("temperature_drift", "backlash")
#: What the size that a scan suggests is multiplied by for the start of a fit.
START_FACTORS = (1.0, 0.25, 0.5, 2.0, 4.0, 8.0)
#: Shapes that no small one leads to: overlaps of proportional valves swallow whole signals.
_WIDE = {("valve_deadband", "width"): (10.0, 20.0)}
#: Slew limits tried, of the rate that the command exceeds for a tenth of the time, either way.
_OF_COMMAND = tuple(0.5 * 1.35**k for k in range(8))
#: Torques over which a gear's flanks come to bear, of the largest that the drive had.
_CONTACT_SHARES = (0.02, 0.05, 0.1, 0.25)
#: A mode that is hardly damped answers to a few percent around its own frequency alone; one whose
#: frequency goes with the posture is, over a recording, like one that is damped more.
_FINE = {
    ("structural_flexibility", "frequency"): tuple(2.0 ** (k / 3.0) for k in range(-6, 7)),
    ("structural_flexibility", "damping"): (1.0, 6.0),
}
#: Of late pressures: what lateness does to quick reversals is no multiple of a shorter one.
_LATE_FACTORS = (1.0, 2.0, 4.0)
#: Most shapes of one effect at one target.
MOST_SHAPES = 75


@dataclass(frozen=True, slots=True)
class Trial:
    """An effect at a target in one shape.

    Attributes
    ----------
    active : ActiveEffect
        With the shape's parameters.
    units : tuple of (k,) array
        Parameters of each column.
    free : tuple of int
        The parameter whose size each column's coefficient is; -1: that of the whole shape.
    signed : tuple of bool
        Whether a coefficient may be negative.
    """

    active: ActiveEffect
    units: tuple[FloatArray, ...]
    free: tuple[int, ...]
    signed: tuple[bool, ...]

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.active.effect.name

    @property
    def target(self) -> str:
        """What it acts on."""
        return self.active.target

    def columns(self, predictor: Predictor, model: Model) -> FloatArray:
        """The trial's columns on the rows, (N, k), per unit of each coefficient."""
        return np.stack(
            [predictor.contribution(model, self.active, unit) for unit in self.units], axis=1
        )

    def at(self, coefficients: Sequence[float] | FloatArray) -> ActiveEffect:
        """The effect with fitted coefficients, within its bounds."""
        effect = self.active.effect
        values = self.active.parameters.copy()
        for which, unit, c in zip(self.free, self.units, coefficients, strict=True):
            if which >= 0:
                values[which] = c * unit[which]
            elif effect.name in _INVERSE_SIZE:
                values[0] = unit[0] / np.clip(c, 0.2, 5.0)
            else:
                size = effect.sizes[0]
                values[size] = unit[size] * c
        low = np.array([p.lower for p in effect.parameters])
        high = np.array([p.upper for p in effect.parameters])
        return replace(self.active, parameters=np.clip(values, low, high))

    def around(self, coefficients: Sequence[float] | FloatArray) -> list[ActiveEffect]:
        """Starts of a fit: where the effect does not grow like its size, several sizes."""
        if self.free != (-1,):
            return [self.at(coefficients)]
        return [self.at(np.asarray(coefficients) * factor) for factor in START_FACTORS]


#: Effects whose first parameter shrinks as the effect grows.
_INVERSE_SIZE = ("valve_spool_lag", "valve_rate_limit")


def trials(
    predictor: Predictor, model: Model, names: Sequence[str] | None = None
) -> Iterator[Trial]:
    """Every trial that the recorded channels could show.

    Parameters
    ----------
    predictor : Predictor
    model : Model
        Effects that are at work in it already are left out at their targets.
    names : sequence of str, optional
        Of the catalogue.
    """
    material = predictor.material
    forms = [form for name in names or CATALOGUE for form in CATALOGUE[name].forms]
    for effect in forms:
        if untestable(material, effect):
            continue
        for one in _at_targets(material, effect):
            if any(t.effect.name == effect.name and t.target == one.target for t in model.terms):
                continue
            yield from _shaped(predictor, model, one)


def _at_targets(material: Material, effect: Effect) -> list[ActiveEffect]:
    robot = material.robot
    result = [
        at_work(robot, effect, p, effect.typical.copy())
        for target in targets(robot, effect)
        for p in places(robot, effect, target, robot.name)
    ]
    if effect.name == "cylinder_inertia":
        result = [bounded_bodies(robot, one) for one in result]
    if effect.name == "base_tilt":
        result = [bounded_tilt(robot, one) for one in result]
    if effect.shared:
        everywhere = ActiveEffect(effect, None, effect.typical.copy(), target=robot.name)
        result.append(replace(everywhere, index=EVERY_CHAMBER))
    return result


def _shaped(predictor: Predictor, model: Model, one: ActiveEffect) -> Iterator[Trial]:
    effect = one.effect
    linear = effect.linear
    shape = [i for i in range(len(effect.parameters)) if i not in linear]
    if effect.name == "counterbalance_valve":
        chosen = pilots(predictor, model, one)
    elif effect.name == "base_tilt":
        chosen = tilts(one)
    elif effect.name == "external_contact":
        chosen = grounds(predictor, model, one)
    elif effect.name == "position_dependent_friction":
        scales = _grid(predictor, model, one, effect.parameters[shape[0]])
        begin, end = visited(predictor, model, one)
        chosen = [(scale, begin, end) for scale in scales]
    else:
        grids = [_grid(predictor, model, one, effect.parameters[i]) for i in shape]
        chosen = list(itertools.product(*grids))
    chosen = _one_way(effect, shape, chosen)
    if len(chosen) > MOST_SHAPES:
        chosen = [chosen[k * len(chosen) // MOST_SHAPES] for k in range(MOST_SHAPES)]
    if effect.end:
        chosen += passages(predictor.material)
    for values in chosen:
        parameters = effect.typical.copy()
        parameters[shape] = values
        active = replace(one, parameters=parameters)
        if not linear:
            yield Trial(active, (parameters,), (-1,), (_signed(effect),))
            continue
        units = []
        for i in linear:
            unit = parameters.copy()
            unit[list(linear)] = 0.0
            unit[i] = effect.parameters[i].typical or 1.0
            units.append(unit)
        # A coefficient counts in units of the typical value, which may be negative.
        signed = tuple(effect.parameters[i].lower < 0.0 for i in linear)
        yield Trial(active, tuple(units), linear, signed)


def _one_way(
    effect: Effect, shape: Sequence[int], chosen: list[tuple[float, ...]]
) -> list[tuple[float, ...]]:
    """Shapes that differ: beside a bristle, over what velocity a sign is rounded does nothing."""
    if BEND not in effect.parameters:
        return chosen
    bend = shape.index(effect.parameters.index(BEND))
    scale = [effect.parameters[i].name for i in shape].index(VELOCITY_SCALE.name)
    typical = effect.parameters[shape[scale]].typical
    return [c for c in chosen if c[bend] == 0.0 or c[scale] == typical]


def _signed(effect: Effect) -> bool:
    return effect.parameters[effect.sizes[0]].lower < 0.0


def _grid(
    predictor: Predictor, model: Model, one: ActiveEffect, spec: ParameterSpec
) -> list[float]:
    effect, material = one.effect, predictor.material
    if spec.name == effect.start:
        # From before the recording on, too: a refit of the base swallows that, a fixed one not.
        always = [] if spec.default is None else [spec.default]
        return always + instants_of(material)
    if spec.name == effect.end:
        # With the instants at which it comes it stays; `passages` go again.
        return [spec.upper]
    if spec.name == effect.duration:
        # Over what lies between two instants: whenever it begins, one of them is near.
        return [instant_spacing(material)]
    if effect.name == "temperature_drift" and (mean_c := mean_oil_c(material)) is not None:
        # A temperature that is known needs no rise with time; roll-outs are at the mean.
        known = {"reference": [mean_c], "rise": [0.0], "time_constant": [spec.typical]}
        if spec.name in known:
            return known[spec.name]
        if spec.name == "halving_temperature":
            return [f * spec.typical for f in (0.5, 1.0, 2.0)]
    if effect.name == "end_cushion" and spec.name == "length":
        # As far from the stops as the piston has been, too: real ones may be longer than usual.
        at = quantiles(predictor, model, one, (PISTON_POSITION,))
        if len(at) < len(QUANTILES):
            return []  # nothing is known of where the piston was
        stroke_m = 0.0 if one.cylinder is None else model.robot.cylinders[one.cylinder].stroke_m
        lengths = [f * spec.typical for f in FIRST_FACTORS]
        lengths += [near for x in (at[0], at[2], at[-3], at[-1]) for near in (x, stroke_m - x)]
        return [x for x in lengths if spec.lower <= x <= 0.5 * stroke_m]
    if effect.name == "valve_rate_limit" and spec.name == "rate":
        # A slow spool saturates at what the command's own rate is, whatever is usual.
        asked = max(abs(rate) for rate in quantiles(predictor, model, one, (VALVE_RATE,)))
        rates = [f * spec.typical for f in SIZE_FACTORS] + [f * asked for f in _OF_COMMAND]
        return list(dict.fromkeys(min(max(r, spec.lower), spec.upper) for r in rates))
    if spec is KNEE:
        # At the ends of the middle fifths of the openings, whichever way.
        at = quantiles(predictor, model, one, (VALVE_SIGNAL,))
        ends = [0.5 * (abs(low) + abs(high)) for low, high in zip(at, at[::-1], strict=True)]
        return [0.0, *(w for w in ends[: len(at) // 2] if 0.0 < w < spec.upper)]
    if spec is BEND or spec is TRAVEL or spec is SHIFT:
        return [0.0, spec.typical]
    if effect.name == "backlash" and spec.name == "contact_torque":
        loads = quantiles(predictor, model, one, (PISTON_FORCE,))
        largest = max(abs(load) for load in loads)
        return [max(share * largest, spec.lower) for share in _CONTACT_SHARES]
    if effect.name == "backlash" and spec.name == "drag":
        return [rubbing(predictor, model, one)]
    if spec.typical == 0.0:
        return [0.0]
    if not effect.linear and spec is effect.parameters[effect.sizes[0]] and _signed(effect):
        return [spec.typical]
    if effect.name == "pressure_delay":
        return [f * spec.typical for f in _LATE_FACTORS]
    if effect.name == "command_delay" or effect.reading is not None:
        return [spec.typical]
    if spec.optional:
        factors: tuple[float, ...] = (1.0,)
        if spec.name == "velocity_scale" or effect.name in _SCANNED_WHOLE:
            factors = _scanned(spec)
    else:
        needed = [p for p in effect.parameters if not (p.linear or p.optional)]
        first = FIRST_FACTORS if effect.linear else SIZE_FACTORS
        factors = first if spec is needed[0] else FURTHER_FACTORS
    factors = _FINE.get((effect.name, spec.name), factors)
    factors += _WIDE.get((effect.name, spec.name), ())
    values = [min(max(f * spec.typical, spec.lower), spec.upper) for f in factors]
    return list(dict.fromkeys(values))


def _scanned(spec: ParameterSpec) -> tuple[float, ...]:
    if spec.name == "rise":
        return (-1.0, 1.0)
    return SCANNED_FACTORS if spec.name in SCANNED else (1.0,)
