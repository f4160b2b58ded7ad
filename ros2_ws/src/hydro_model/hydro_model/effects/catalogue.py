"""The catalogue by name, and the effects of a robot resolved against it."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_model.effects.chamber import CHAMBER_EFFECTS
from hydro_model.effects.effect import Effect
from hydro_model.effects.friction import FRICTION_EFFECTS
from hydro_model.effects.supply import SUPPLY_EFFECTS
from hydro_model.effects.valve_effects import VALVE_EFFECTS
from hydro_model.errors import RobotError
from hydro_model.robot import EffectSpec, FloatArray, Robot

#: Every effect by its name. Within a stage they act in this order.
CATALOGUE: dict[str, Effect] = {
    effect.name: effect
    for effect in (*FRICTION_EFFECTS, *VALVE_EFFECTS, *CHAMBER_EFFECTS, *SUPPLY_EFFECTS)
}


@dataclass(frozen=True, slots=True)
class ActiveEffect:
    """An effect at work on one cylinder of a robot, or on all of it.

    Attributes
    ----------
    effect : Effect
    cylinder : int or None
        Index in `Robot.cylinders`; None where the effect acts on the whole robot.
    parameters : (k,) array
        In the order of `Effect.parameters`.
    """

    effect: Effect
    cylinder: int | None
    parameters: FloatArray


def resolve(robot: Robot) -> tuple[ActiveEffect, ...]:
    """The effects a robot lists, found in the catalogue and checked.

    A target is a cylinder, its valve or its joint; the robot's own name means every cylinder,
    or, for effects of supply and tank, the whole robot.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of ActiveEffect
        In catalogue order, then by cylinder.

    Raises
    ------
    RobotError
        Unknown name, target or parameter (the message lists the known ones), a value outside
        its bounds, or an effect listed twice for one target.
    """
    active = [one for spec in robot.effects for one in _resolve_one(robot, spec)]
    seen: set[tuple[str, int | None]] = set()
    for one in active:
        key = (one.effect.name, one.cylinder)
        if key in seen:
            raise RobotError(
                f"{_where(robot)}: effect '{one.effect.name}' is listed twice for"
                f" {_target_name(robot, one.cylinder)}"
            )
        seen.add(key)
    order = list(CATALOGUE)
    return tuple(sorted(active, key=lambda a: (order.index(a.effect.name), _rank(a.cylinder))))


def _resolve_one(robot: Robot, spec: EffectSpec) -> list[ActiveEffect]:
    where = _where(robot)
    if spec.name not in CATALOGUE:
        raise RobotError(
            f"{where}: no effect '{spec.name}' in the catalogue (known: {', '.join(CATALOGUE)})"
        )
    effect = CATALOGUE[spec.name]
    values = effect.values(spec.parameters, where)
    return [ActiveEffect(effect, index, values) for index in _targets(robot, spec, effect)]


def _targets(robot: Robot, spec: EffectSpec, effect: Effect) -> list[int | None]:
    if effect.robot_wide:
        if spec.target != robot.name:
            raise RobotError(
                f"{_where(robot)}: effect '{spec.name}' acts on the whole robot, expected target"
                f" '{robot.name}', found '{spec.target}'"
            )
        return [None]
    if spec.target == robot.name and robot.cylinders:
        return list(range(len(robot.cylinders)))
    known: dict[str, int] = {}
    for index, cylinder in enumerate(robot.cylinders):
        known |= {cylinder.name: index, cylinder.joint: index}
        known |= {v.name: index for v in robot.valves if v.cylinder == cylinder.name}
    if spec.target not in known:
        names = ", ".join([robot.name, *known])
        raise RobotError(
            f"{_where(robot)}: effect '{spec.name}' has unknown target '{spec.target}'"
            f" (known: {names})"
        )
    return [known[spec.target]]


def _where(robot: Robot) -> str:
    return str(robot.source or f"robot {robot.name}")


def _rank(cylinder: int | None) -> int:
    return -1 if cylinder is None else cylinder


def _target_name(robot: Robot, cylinder: int | None) -> str:
    return f"'{robot.name if cylinder is None else robot.cylinders[cylinder].name}'"
