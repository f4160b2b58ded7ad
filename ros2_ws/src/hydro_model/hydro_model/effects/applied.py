"""Effects that are no law: the robot that has them, and what its sensors show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_model.effects.catalogue import acts_at, resolve
from hydro_model.effects.readings import Readings
from hydro_model.effects.targets import ActiveEffect
from hydro_model.robot import Robot


def with_changes(robot: Robot, time_s: float = float("inf")) -> Robot:
    """The robot with the masses, gravity and delays that its listed effects say.

    Effects whose physics is a change alone have done their part and are listed no more, so that
    applying this twice changes nothing. Effects that are a law, too (`structural_flexibility`),
    stay listed: where their law acts, `changed_for_laws` makes the room for it.

    Parameters
    ----------
    robot : Robot
    time_s : float
        Changes that start later are left out, and stay listed, as are those that are over.

    Returns
    -------
    Robot

    Raises
    ------
    RobotError
        An effect does not resolve.
    """
    done = [
        one
        for one in resolve(robot)
        if one.effect.change is not None and not one.terms and acts_at(one, time_s)
    ]
    if not done:
        return robot
    listed = robot.effects
    for one in done:
        robot = _applied(robot, one)
    names = {one.effect.name for one in done}
    others = tuple(
        spec
        for spec in listed
        if spec.name not in names or _not_at(replace(robot, effects=(spec,)), time_s)
    )
    return replace(robot, effects=others)


def changed_for_laws(robot: Robot, active: Sequence[ActiveEffect]) -> Robot:
    """The robot without what the laws of the given effects carry in its place."""
    for one in active:
        if one.effect.change is not None and one.terms:
            robot = _applied(robot, one)
    return robot


def _not_at(robot: Robot, time_s: float) -> bool:
    return not any(acts_at(one, time_s) for one in resolve(robot))


def _applied(robot: Robot, one: ActiveEffect) -> Robot:
    change = one.effect.change
    return robot if change is None else change(robot, one.target, one.parameters)


def read_with(robot: Robot, readings: Readings) -> Readings:
    """What the sensors show of true signals, with the robot's listed effects of instruments.

    Parameters
    ----------
    robot : Robot
    readings : Readings
        The true signals, such as of a roll-out.

    Returns
    -------
    Readings

    Raises
    ------
    RobotError
        An effect does not resolve.
    """
    for one in resolve(robot):
        if one.effect.reading is not None:
            readings = one.effect.reading(readings, one.index, one.parameters)
    return readings
