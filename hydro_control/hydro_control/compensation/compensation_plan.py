"""What the controller makes of the effects that a model file lists."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from hydro_control.compensation.doubtful import doubt
from hydro_model.effects import ActiveEffect, resolve
from hydro_model.effects.applied import with_changes
from hydro_model.effects.catalogue import acts_at
from hydro_model.robot import Robot

_MEASURED = "the pressures at the valve are measured, or else the robot file's constants"
_OUTFLOW = "it throttles oil on the way out, which more opening would only fight"

#: Effects left alone, and why. Everything else of the catalogue is compensated.
NOT_COMPENSATED: Mapping[str, str] = MappingProxyType(
    {
        "temperature_drift": "the controller does not know the oil's temperature",
        "structural_flexibility": "its mode stays the load's; the links count as rigid",
        "backlash": "oil cannot be moved across a play before the load turns",
        "external_contact": "a surface in the way is no property of the machine",
        "valve_hysteresis": "noise of the command dithers over it, its branch is not known",
        "cavitation": "a cavity fills no faster for a wider valve",
        "end_cushion": _OUTFLOW,
        "counterbalance_valve": _OUTFLOW,
        "line_dynamics": "the mode of a hose lies above what the loop follows",
        "supply_droop": _MEASURED,
        "tank_back_pressure": _MEASURED,
    }
)


@dataclass(frozen=True, slots=True)
class CompensationPlan:
    """The listed effects, sorted.

    Attributes
    ----------
    robot : Robot
        With the masses, gravity and delays that its effects say (`Effect.change`), as they are
        once all of them have come.
    active : tuple of ActiveEffect
        Laws and readings to compensate, in catalogue order.
    names : tuple of str
        Names of all effects that are compensated, those in `robot` included.
    left_out : mapping of str to str
        Listed effects that are not compensated, and why: by name, or by ``name:target`` where
        what was fitted at one target is too unsure.
    """

    robot: Robot
    active: tuple[ActiveEffect, ...]
    names: tuple[str, ...]
    left_out: Mapping[str, str]


def plan(robot: Robot) -> CompensationPlan:
    """Sort the effects that a robot lists.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    CompensationPlan

    Raises
    ------
    RobotError
        An effect does not resolve.
    """
    doubts = {f"{e.name}:{e.target}": (e, doubt(robot, e)) for e in robot.effects}
    unsure = {key: why for key, (_, why) in doubts.items() if why}
    kept = tuple(e for e in robot.effects if f"{e.name}:{e.target}" not in unsure)
    robot = replace(robot, effects=kept) if unsure else robot
    # A payload that was set down again is listed still, and nothing of it is left to compensate.
    acting = (one for one in resolve(robot) if one.effect.terms or acts_at(one, float("inf")))
    listed = tuple(dict.fromkeys(one.effect.name for one in acting))
    changed = with_changes(robot)
    return CompensationPlan(
        robot=changed,
        active=tuple(a for a in resolve(changed) if a.effect.name not in NOT_COMPENSATED),
        names=tuple(name for name in listed if name not in NOT_COMPENSATED),
        left_out={n: NOT_COMPENSATED[n] for n in listed if n in NOT_COMPENSATED} | unsure,
    )
