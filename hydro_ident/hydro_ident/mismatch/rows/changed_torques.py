"""Torques that a changed machine takes beyond the plain one, kept while both are asked about."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hydro_ident.estimate.forces.force_rows import Motion
from hydro_ident.mismatch.rows.material import Stretch
from hydro_model.effects.bending import Load, bears
from hydro_model.effects.targets import ActiveEffect, joint_of
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot

#: Changes whose torques are kept at a time, per stretch: what is scanned in many instants is
#: the same mass again and again.
_KEPT_CHANGES = 4
#: Deflection, rad, and rate, rad/s, of which a mode's answer is a multiple: far from `LARGEST`.
_SMALL = 1.0e-3


@dataclass(slots=True)
class _Kept:
    """What is kept of a robot over a motion: its torques, its joints' loads, what changes add."""

    robot: Robot
    moved: Motion
    plain: FloatArray | None = None
    loads: dict[int, Load] = field(default_factory=dict)
    extra: dict[tuple[object, ...], FloatArray] = field(default_factory=dict)
    free: dict[tuple[object, ...], FloatArray] = field(default_factory=dict)


@dataclass(slots=True)
class ChangedTorques:
    """Torques of a robot with a change at work less those without it, over stretches."""

    _stretches: dict[int, _Kept] = field(default_factory=dict)

    def extra(self, robot: Robot, one: ActiveEffect, stretch: Stretch) -> FloatArray:
        """What the whole change adds, whenever it begins, (N, n); not to be changed.

        Parameters
        ----------
        robot : Robot
            Without the change.
        one : ActiveEffect
            With a change of the robot.
        stretch : Stretch
            With its motion.
        """
        moved = stretch.moved
        if moved is None:
            return np.zeros_like(stretch.trace.q)
        kept = self._kept(robot, moved, stretch)
        key = _whenever(one)
        if key not in kept.extra:
            _make_room(kept.extra)
            kept.extra[key] = _taken(kept, one, stretch.trace.step_s)
        return kept.extra[key]

    def free(self, robot: Robot, one: ActiveEffect, stretch: Stretch, moved: Motion) -> FloatArray:
        """What a mode adds by being under way at the first sample, (2, N, n); not to be changed.

        Per rad of deflection beyond where it rests, and per rad/s.

        Parameters
        ----------
        robot : Robot
        one : ActiveEffect
            With torques that a recording tells.
        stretch : Stretch
        moved : Motion
            Of the stretch.
        """
        kept, key = self._kept(robot, moved, stretch), _whenever(one)
        if key not in kept.free:
            _make_room(kept.free)
            at_rest, step_s = self.extra(robot, one, stretch), stretch.trace.step_s
            kept.free[key] = np.stack(
                [
                    (_taken(kept, one, step_s, begun) - at_rest) / _SMALL
                    for begun in ((_SMALL, 0.0), (0.0, _SMALL))
                ]
            )
        return kept.free[key]

    def _kept(self, robot: Robot, moved: Motion, stretch: Stretch) -> _Kept:
        kept = self._stretches.get(stretch.number)
        if kept is None or kept.robot is not robot or kept.moved is not moved:
            kept = self._stretches[stretch.number] = _Kept(robot, moved)
        return kept


def _make_room(kept: dict[tuple[object, ...], FloatArray]) -> None:
    if len(kept) >= _KEPT_CHANGES:
        kept.pop(next(iter(kept)))


def _taken(
    kept: _Kept, one: ActiveEffect, step_s: float, begun: tuple[float, float] = (0.0, 0.0)
) -> FloatArray:
    """Torques (N, n) that an effect takes beyond the plain robot's."""
    robot, moved, effect = kept.robot, kept.moved, one.effect
    if effect.known_torques is not None:
        joint = joint_of(robot, one)
        if joint not in kept.loads:
            kept.loads[joint] = Load.of(robot, joint, moved.q, moved.qd, moved.qdd)
        # A base that the rows hardly tell may have no inertia there: nothing swings on it.
        if not bears(kept.loads[joint], one.parameters):
            return np.zeros_like(moved.q)
        return effect.known_torques(kept.loads[joint], one.parameters, step_s, begun)
    if kept.plain is None:
        kept.plain = _torques(robot, moved)
    changed = robot if effect.change is None else effect.change(robot, one.target, one.parameters)
    return _torques(changed, moved) - kept.plain


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
    return effect.name, one.target, *values
