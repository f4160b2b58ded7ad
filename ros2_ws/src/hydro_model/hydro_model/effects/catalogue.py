"""The catalogue by name, and the effects of a robot resolved against it."""

from __future__ import annotations

import numpy as np

from hydro_model.effects.bodies import BODY_EFFECTS
from hydro_model.effects.chamber import CHAMBER_EFFECTS
from hydro_model.effects.drives import DRIVE_EFFECTS
from hydro_model.effects.effect import Effect
from hydro_model.effects.friction import FRICTION_EFFECTS
from hydro_model.effects.friction_conditions import FRICTION_CONDITION_EFFECTS
from hydro_model.effects.lines import LINE_EFFECTS
from hydro_model.effects.mechanics import MECHANICS_EFFECTS
from hydro_model.effects.sensors import SENSOR_EFFECTS, TIMING_EFFECTS
from hydro_model.effects.supply import SUPPLY_EFFECTS
from hydro_model.effects.targets import ActiveEffect, at_work, known_targets, places, targets
from hydro_model.effects.valve_edges import EDGE_EFFECTS
from hydro_model.effects.valve_effects import VALVE_EFFECTS
from hydro_model.errors import RobotError
from hydro_model.robot import EffectSpec, FloatArray, Robot

__all__ = ["CATALOGUE", "ActiveEffect", "resolve", "target_name", "targets"]

#: Every effect by its name. Within a stage they act in this order.
CATALOGUE: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        *FRICTION_EFFECTS,
        *FRICTION_CONDITION_EFFECTS,
        *MECHANICS_EFFECTS,
        *DRIVE_EFFECTS,
        *BODY_EFFECTS,
        *SENSOR_EFFECTS,
        *VALVE_EFFECTS,
        *EDGE_EFFECTS,
        *LINE_EFFECTS,
        *CHAMBER_EFFECTS,
        *SUPPLY_EFFECTS,
        *TIMING_EFFECTS,
    )
}


def resolve(robot: Robot) -> tuple[ActiveEffect, ...]:
    """The effects a robot lists, found in the catalogue and checked.

    A target is a cylinder, its valve, its joint or one of its chambers (`<cylinder>/a`); a joint;
    a pressure; or the robot's own name, which means every one of them, or the whole robot for
    effects that act on it.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    tuple of ActiveEffect
        In catalogue order; the whole robot, then by cylinder, then joints.

    Raises
    ------
    RobotError
        Unknown name, target or parameter (the message lists the known ones), a value outside
        its bounds, or an effect listed twice for one target. Only `payload_change` may be listed
        again, from another time on.
    """
    active = [one for spec in robot.effects for one in _resolve_one(robot, spec)]
    seen: set[tuple[str, str, float]] = set()
    for one in active:
        # Two changes that start at different times are two events, not one listed twice.
        # A whole cylinder takes both of its chambers, whichever is listed first.
        held = {(one.effect.name, one.target + side, start_s(one)) for side in ("", "/a", "/b")}
        if held & seen:
            raise RobotError(
                f"{_where(robot)}: effect '{one.effect.name}' is listed twice for '{one.target}'"
            )
        seen |= held
    order = list(CATALOGUE)
    return tuple(sorted(active, key=lambda a: (order.index(a.effect.name), _rank(robot, a))))


def parameters_of(name: str, where: str) -> str:
    """What a robot file has to say of an effect, for messages.

    Parameters
    ----------
    name : str
    where : str
        File and place in it, for the message.

    Returns
    -------
    str
        Its parameters with their units; of each form, where they differ.

    Raises
    ------
    RobotError
        There is no such effect; the message lists the known ones.
    """
    forms = [
        ", ".join(
            f"{one.name} in {one.unit}{' (optional)' if one.optional else ''}"
            for one in form.parameters
        )
        for form in _known(name, where).forms
    ]
    return " or, at another kind of target, ".join(dict.fromkeys(forms))


def start_s(one: ActiveEffect) -> float:
    """Time from which an effect's change holds; minus infinity where it always does."""
    return _value(one, one.effect.start, -float("inf"))


def end_s(one: ActiveEffect) -> float:
    """Time from which an effect's change is gone; infinity where it stays."""
    if not one.effect.end:
        return float("inf")
    [spec] = [p for p in one.effect.parameters if p.name == one.effect.end]
    value = _value(one, spec.name, spec.upper)
    return value if value < spec.upper else float("inf")


def acts_at(one: ActiveEffect, time_s: float) -> bool:
    """Whether an effect's change holds at a time, which may be infinity."""
    return start_s(one) <= time_s and (time_s < end_s(one) or end_s(one) == float("inf"))


def acting_share(one: ActiveEffect, time_s: FloatArray) -> FloatArray:
    """How much of an effect's change is there at some times, (N,), from 0 to 1.

    Parameters
    ----------
    one : ActiveEffect
    time_s : (N,) array
        On the recording's time axis.
    """
    effect, times = one.effect, np.asarray(time_s)
    come = _ramp(times - start_s(one), _value(one, effect.duration, 0.0))
    gone = _ramp(times - end_s(one), _value(one, effect.end_duration, 0.0))
    return np.maximum(come - gone, 0.0)


def _ramp(since_s: FloatArray, over_s: float) -> FloatArray:
    """From 0 to 1 over a time whose middle is at 0; at once from 0 on where it takes none."""
    if over_s <= 0.0:
        return np.where(since_s >= 0.0, 1.0, 0.0)
    return np.asarray(np.clip(since_s / over_s + 0.5, 0.0, 1.0))


def _value(one: ActiveEffect, name: str, otherwise: float) -> float:
    names = [parameter.name for parameter in one.effect.parameters]
    return float(one.parameters[names.index(name)]) if name else otherwise


def _resolve_one(robot: Robot, spec: EffectSpec) -> list[ActiveEffect]:
    where = _where(robot)
    effect = _form_at(robot, _known(spec.name, where), spec.target)
    values = effect.values(spec.parameters, where)
    return [
        at_work(robot, effect, place, values)
        for place in places(robot, effect, spec.target, where)
    ]


def _known(name: str, where: str) -> Effect:
    if name not in CATALOGUE:
        raise RobotError(
            f"{where}: no effect '{name}' in the catalogue (known: {', '.join(CATALOGUE)})"
        )
    return CATALOGUE[name]


def _form_at(robot: Robot, effect: Effect, target: str) -> Effect:
    """An effect as it is at a target: the first of its forms that may be there."""
    for form in effect.forms:
        if target in known_targets(robot, form):
            return form
    return effect


def _where(robot: Robot) -> str:
    return str(robot.source or f"robot {robot.name}")


def _rank(robot: Robot, one: ActiveEffect) -> tuple[float, int, str]:
    """The whole robot, then cylinders, then joints; two changes in the order of their times."""
    if one.joint is not None:
        return start_s(one), len(robot.cylinders) + one.joint, one.side
    return start_s(one), -1 if one.cylinder is None else one.cylinder, one.side


def target_name(robot: Robot, one: ActiveEffect) -> str:
    """Name of the cylinder, joint, chamber, pressure or robot that an effect acts on."""
    if one.target:
        return one.target
    if one.joint is not None:
        return robot.joint_names[one.joint]
    return robot.name if one.cylinder is None else robot.cylinders[one.cylinder].name
