"""Torques that a changed machine takes beyond the plain one, kept while both are asked about."""

from __future__ import annotations

from dataclasses import dataclass, field

from hydro_ident.estimate.force_rows import Motion
from hydro_model.effects.effect import RobotChange
from hydro_model.effects.targets import ActiveEffect
from hydro_model.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot

#: Changes whose torques are kept at a time, per stretch: what is scanned in many instants is
#: the same mass again and again.
_KEPT_CHANGES = 4


@dataclass(slots=True)
class ChangedTorques:
    """Torques of a robot with a change at work less those without it, over stretches."""

    _plain: dict[int, tuple[Robot, Motion, FloatArray]] = field(default_factory=dict)
    _extra: dict[int, dict[tuple[object, ...], FloatArray]] = field(default_factory=dict)

    def extra(
        self, robot: Robot, one: ActiveEffect, change: RobotChange, number: int, moved: Motion
    ) -> FloatArray:
        """What the whole change adds, whenever it begins, (N, n); not to be changed.

        Parameters
        ----------
        robot : Robot
            Without the change.
        one : ActiveEffect
        change : callable
            The effect's own, of the robot.
        number : int
            Of the stretch.
        moved : Motion
            Of the stretch.
        """
        kept = self._plain.get(number)
        if kept is None or kept[0] is not robot or kept[1] is not moved:
            kept = self._plain[number] = robot, moved, _torques(robot, moved)
            self._extra[number] = {}
        changes, key = self._extra[number], _whenever(one)
        if key not in changes:
            if len(changes) >= _KEPT_CHANGES:
                changes.pop(next(iter(changes)))
            other = change(robot, one.target, one.parameters)
            changes[key] = _torques(other, moved) - kept[2]
        return changes[key]


def _torques(robot: Robot, moved: Motion) -> FloatArray:
    return inverse_dynamics(robot, moved.q, moved.qd, moved.qdd)


def _whenever(one: ActiveEffect) -> tuple[object, ...]:
    """What tells changes apart, but for when they come and go."""
    effect = one.effect
    values = [
        float(value)
        for spec, value in zip(effect.parameters, one.parameters, strict=True)
        if spec.name not in effect.edges
    ]
    return effect.change, one.target, *values
