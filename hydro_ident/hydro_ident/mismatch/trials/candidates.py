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

from hydro_ident.mismatch.rows.base_columns import DELAY
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.rows.prediction import Model, Predictor
from hydro_ident.mismatch.rows.testable import untestable
from hydro_ident.mismatch.trials.grids import is_signed, tried_at
from hydro_ident.mismatch.trials.places import (
    bounded_bend,
    bounded_bodies,
    bounded_tilt,
    grounds,
    most_inertia,
    own_mode,
    passages,
    pilots,
    stations,
    tilts,
    visited,
)
from hydro_model.effects.catalogue import CATALOGUE, ActiveEffect, targets
from hydro_model.effects.effect import Effect
from hydro_model.effects.flexibility import STRUCTURAL_FLEXIBILITY
from hydro_model.effects.friction import BEND, VELOCITY_SCALE
from hydro_model.effects.readings import EVERY_CHAMBER
from hydro_model.effects.targets import at_work, joint_of, places
from hydro_model.robot import FloatArray

#: What the size that a scan suggests is multiplied by for the start of a fit.
START_FACTORS = (1.0, 0.25, 0.5, 2.0, 4.0, 8.0)
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


#: What is looked for at the rails, too. A constant that a file has for a rail that nobody read is
#: off like a transducer; not so its gain, which a constant does not tell from it.
RAIL_BIAS, RAILS = "pressure_sensor_bias", ("supply", "tank")
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
    if effect.name == DELAY and effect.acts_on == "robot" and len(robot.valves) == 1:
        # One valve's own delay is that of all.
        return []
    named = [*targets(robot, effect), *(RAILS if effect.name == RAIL_BIAS else ())]
    result = [
        at_work(robot, effect, p, effect.typical.copy())
        for target in named
        for p in places(robot, effect, target, robot.name)
    ]
    if effect.name == "cylinder_inertia":
        result = [bounded_bodies(robot, one) for one in result]
    if effect.name == "base_tilt":
        result = [bounded_tilt(robot, one) for one in result]
    if effect.name == "structural_flexibility":
        result = [bounded_bend(robot, one) for one in result]
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
        scales = tried_at(predictor, model, one, effect.parameters[shape[0]])
        spans = stations(*visited(predictor, model, one))
        chosen = [(scale, *span) for span in spans for scale in scales]
    else:
        grids = [tried_at(predictor, model, one, effect.parameters[i]) for i in shape]
        chosen = list(itertools.product(*grids))
    chosen = _one_way(effect, shape, chosen)
    if len(chosen) > MOST_SHAPES:
        chosen = [chosen[k * len(chosen) // MOST_SHAPES] for k in range(MOST_SHAPES)]
    if effect.end:
        chosen += passages(predictor.material)
    bends = effect.name == STRUCTURAL_FLEXIBILITY.name
    robot, material = model.robot, predictor.material
    most = most_inertia(material, robot, joint_of(robot, one)) if bends else 0.0
    for values in chosen:
        parameters = effect.typical.copy()
        parameters[shape] = values
        active = replace(one, parameters=parameters)
        active = own_mode(active, most) if bends else active
        if not linear:
            yield Trial(active, (parameters,), (-1,), (is_signed(effect),))
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
