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
    """An effect at work on one cylinder of a robot, on a joint without cylinder, or on all of it.

    Attributes
    ----------
    effect : Effect
    cylinder : int or None
        Index in `Robot.cylinders`; None where the effect acts on the whole robot or on a joint.
    parameters : (k,) array
        In the order of `Effect.parameters`.
    joint : int or None
        Index in `Robot.joints` of a joint without cylinder.
    """

    effect: Effect
    cylinder: int | None
    parameters: FloatArray
    joint: int | None = None


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
    seen: set[tuple[str, int | None, int | None]] = set()
    for one in active:
        key = (one.effect.name, one.cylinder, one.joint)
        if key in seen:
            raise RobotError(
                f"{_where(robot)}: effect '{one.effect.name}' is listed twice for"
                f" '{target_name(robot, one)}'"
            )
        seen.add(key)
    order = list(CATALOGUE)
    return tuple(sorted(active, key=lambda a: (order.index(a.effect.name), _rank(robot, a))))


def _resolve_one(robot: Robot, spec: EffectSpec) -> list[ActiveEffect]:
    where = _where(robot)
    if spec.name not in CATALOGUE:
        raise RobotError(
            f"{where}: no effect '{spec.name}' in the catalogue (known: {', '.join(CATALOGUE)})"
        )
    effect = CATALOGUE[spec.name]
    values = effect.values(spec.parameters, where)
    return [
        ActiveEffect(effect, cylinder, values, joint)
        for cylinder, joint in _targets(robot, spec, effect)
    ]


def _targets(
    robot: Robot, spec: EffectSpec, effect: Effect
) -> list[tuple[int | None, int | None]]:
    """Pairs of cylinder and joint without cylinder, one of them or both None."""
    if effect.robot_wide:
        if spec.target != robot.name:
            raise RobotError(
                f"{_where(robot)}: effect '{spec.name}' acts on the whole robot, expected target"
                f" '{robot.name}', found '{spec.target}'"
            )
        return [(None, None)]
    dry = robot.dry_joints if not effect.needs_cylinder else ()
    if spec.target == robot.name and (robot.cylinders or dry):
        return [(i, None) for i in range(len(robot.cylinders))] + [(None, j) for j in dry]
    joints = {robot.joint_names[j]: j for j in dry}
    if spec.target in joints:
        return [(None, joints[spec.target])]
    known: dict[str, int] = {}
    for index, cylinder in enumerate(robot.cylinders):
        known |= {cylinder.name: index, cylinder.joint: index}
        known |= {v.name: index for v in robot.valves if v.cylinder == cylinder.name}
    if spec.target not in known:
        names = ", ".join([robot.name, *known, *joints])
        raise RobotError(
            f"{_where(robot)}: effect '{spec.name}' has unknown target '{spec.target}'"
            f" (known: {names})"
        )
    return [(known[spec.target], None)]


def _where(robot: Robot) -> str:
    return str(robot.source or f"robot {robot.name}")


def _rank(robot: Robot, one: ActiveEffect) -> int:
    """The whole robot, then cylinders, then joints without cylinder."""
    if one.joint is not None:
        return len(robot.cylinders) + one.joint
    return -1 if one.cylinder is None else one.cylinder


def target_name(robot: Robot, one: ActiveEffect) -> str:
    """Name of the cylinder, joint or robot that an effect acts on."""
    if one.joint is not None:
        return robot.joint_names[one.joint]
    return robot.name if one.cylinder is None else robot.cylinders[one.cylinder].name
