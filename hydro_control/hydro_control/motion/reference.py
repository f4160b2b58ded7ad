"""What the controller follows: a hold, a path, a trajectory, a stop. Pure; time is the stamp."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hydro_control.errors import ControlError, names_in_short
from hydro_control.motion.approach import APPROACH_CHECKS, approach_to
from hydro_control.motion.motion_limits import TIP_SPEED_M_S
from hydro_control.motion.path_limits import refuse_beyond
from hydro_control.motion.posture import is_redundant, posture_at_tip
from hydro_control.motion.required_motion import Reference
from hydro_control.motion.some_joints import for_all_joints
from hydro_control.motion.stopping import Slowing
from hydro_control.motion.trajectory import Waypoint, segments_through
from hydro_model.errors import RobotError
from hydro_model.motion.paths import JointPath, Path, TipPath
from hydro_model.motion.paths_check import CHECK_STEP_S
from hydro_model.motion.paths_joints import joints_at_tip
from hydro_model.motion.paths_segments import Hold, Segment
from hydro_model.motion.row_pieces import always
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import FloatArray, Robot

STOP_S = 0.5
_REST_HINT = " (a point without velocities is one of rest: give velocities)"


@dataclass(frozen=True, slots=True)
class Plan:
    """A checked motion, ready to be played.

    Attributes
    ----------
    space : {"tip", "joint"}
    path : Path
        Of the tip, or of all joints of the robot.
    start_s : float or None
        When it begins, its approach included; None for when it is taken up.
    """

    space: Literal["tip", "joint"]
    path: Path
    start_s: float | None = None


class ReferencePlayer:
    """Plays one plan at a time; at rest before and after.

    Parameters
    ----------
    robot : Robot
    q : (n,) array
        Joint positions to hold first.
    tip_speed_m_s : float
        Paths on which the tip is faster are refused.
    """

    def __init__(self, robot: Robot, q: FloatArray, tip_speed_m_s: float = TIP_SPEED_M_S) -> None:
        self.robot = robot
        self._tip_speed_m_s = tip_speed_m_s
        self._plan = _hold("joint", np.array(q, dtype=float))
        self._start_s = 0.0
        self._free: bool | None = False
        self._held: FloatArray | None = None

    def play(self, plan: Plan, start_s: float) -> None:
        """Play a plan from a stamp on."""
        self._plan, self._start_s = plan, start_s
        self._free, self._held = None, None

    def hold(self, q: FloatArray, stamp_s: float) -> None:
        """Stand at joint positions from a stamp on, whatever was played."""
        self.play(_hold("joint", np.array(q, dtype=float)), stamp_s)

    def settle(self, q: FloatArray, stamp_s: float) -> None:
        """Before, after and between motions of the tip hold the joints that its place leaves free.

        Along the joints' motions that leave the tip where it is nothing but their speed is
        controlled: held by its tip, a redundant chain creeps along them for as long as it stands.

        Parameters
        ----------
        q : (n,) array
            Measured joint positions, rad or m.
        stamp_s : float
            Of the sample.
        """
        if self._free is None:
            self._free = self._plan.space == "tip" and is_redundant(self.robot, q)
        if not self._free:
            return
        if not self._rests(stamp_s):
            self._held = None
        elif self._held is None:
            place = self._plan.path.sample(stamp_s - self._start_s)[0]
            self._held = posture_at_tip(self.robot, place, q)

    def _rests(self, stamp_s: float) -> bool:
        """Whether what is played waits: for its start, in a pause, or at its end."""
        path, at_s = self._plan.path, stamp_s - self._start_s
        if not path.start_delay_s <= at_s < path.duration_s:
            return True
        return isinstance(path.segments[bisect_right(path.breaks_s, at_s) - 1], Hold)

    def moving(self, stamp_s: float) -> bool:
        """A plan is not played to its end yet.

        `stamp_s` is the time of the sample.
        """
        return stamp_s < self._start_s + self._plan.path.duration_s

    def sample(self, stamp_s: float) -> Reference:
        """The reference at a stamp."""
        held = self._held
        if held is not None:
            return Reference("joint", held, np.zeros_like(held), np.zeros_like(held))
        return Reference(self._plan.space, *self._plan.path.sample(stamp_s - self._start_s))

    def stop(self, stamp_s: float) -> None:
        """Come to rest within `STOP_S` along what is played: nothing else has been checked.

        `stamp_s` is the time from which on.
        """
        now, path = self.sample(stamp_s), self._plan.path
        if not (np.any(now.velocity) or np.any(now.acceleration)):
            # At rest, or still waiting for its start: it does not set out any more.
            self.play(_hold(now.space, now.position), stamp_s)
        elif not isinstance(path.segments[0], Slowing):
            slowing = Slowing(path, stamp_s - self._start_s, STOP_S)
            self.play(Plan(now.space, Path((slowing,))), stamp_s)

    def plan_path(
        self,
        path: TipPath | JointPath,
        stamp_s: float,
        q: FloatArray,
        delay_s: float = 0.0,
        *,
        path_checked: bool = False,
        go_on: Callable[[], None] = always,
    ) -> Plan:
        """A plan of a path, approached from where the reference stands.

        Parameters
        ----------
        path : TipPath or JointPath
        stamp_s : float
        q : (n,) array
            Measured joint positions.
        delay_s : float
            Hold at the start of the path, the approach included.
        path_checked : bool
            Check only the approach: the path itself has been checked before.
        go_on : callable
            Called again and again while it is checked: what it raises ends the check.

        Returns
        -------
        Plan

        Raises
        ------
        ControlError
            A motion is going on, the start is too far away, or the robot cannot follow it.
        """
        space: Literal["tip", "joint"] = "tip" if isinstance(path, TipPath) else "joint"
        at = self._standing(space, stamp_s, q)
        segments, first = path.segments, path.sample(0.0)[0]
        if isinstance(path, JointPath):
            segments, first = for_all_joints(self.robot, path, at)
        approach = self._approach(space, at, first, q)
        wait = path.start_delay_s + delay_s - sum(s.duration_s for s in approach)
        pause = (Hold(first, wait),) if wait > 0.0 else ()
        whole = (*approach, *pause, *segments)
        if not path_checked:
            self._check(space, whole, q, go_on=go_on)
        elif approach:
            self._check(space, approach, q, approach[0].duration_s / APPROACH_CHECKS)
        return Plan(space, Path(whole))

    def plan_trajectory(
        self,
        space: Literal["tip", "joint"],
        names: Sequence[str],
        waypoints: Sequence[Waypoint],
        stamp_s: float,
        q: FloatArray,
        start_s: float | None = None,
        go_on: Callable[[], None] = always,
    ) -> Plan:
        """A plan of a trajectory message.

        Parameters
        ----------
        space : {"tip", "joint"}
        names : sequence of str
            The joints, or the tip link alone.
        waypoints : sequence of Waypoint
        stamp_s : float
        q : (n,) array
            Measured joint positions.
        start_s : float, optional
            Stamp of its time 0, to which its start is approached before; by default it begins
            with the approach when it is taken up.
        go_on : callable
            As of `plan_path`.

        Returns
        -------
        Plan

        Raises
        ------
        ControlError
            A name is not the robot's, the trajectory is malformed, a motion is going on, the
            start is too far away in distance or too near in time, or the robot cannot follow it.
        """
        at = self._standing(space, stamp_s, q)
        known = (self.robot.tip_link,) if space == "tip" else self.robot.joint_names
        unknown = [name for name in names if name not in known]
        if unknown or not names or len(set(names)) != len(names):
            raise ControlError(
                f"a trajectory of {space} space should name {', '.join(known)}, each once,"
                f" found {names_in_short(names) or 'no name'}"
            )
        if space == "tip":
            segments = segments_through(at, waypoints)
            first = segments[0].sample(0.0)[0]
        else:
            columns = [self.robot.joint_index(name) for name in names]
            path = JointPath(segments_through(at[columns], waypoints), joints=tuple(names))
            segments, first = for_all_joints(self.robot, path, at)
        approach = self._approach(space, at, first, q)
        begin_s = _begin(start_s, stamp_s, sum(s.duration_s for s in approach))
        whole = (*approach, *segments)
        resting = any(np.size(point.velocity) == 0 for point in waypoints[:-1])
        self._check(space, whole, q, hint=_REST_HINT if resting else "", go_on=go_on)
        return Plan(space, Path(whole), begin_s)

    def _standing(self, space: str, stamp_s: float, q: FloatArray) -> FloatArray:
        """Where the reference stands in a space; refused while it moves."""
        if self.moving(stamp_s):
            left = self._start_s + self._plan.path.duration_s - stamp_s
            raise ControlError(
                f"a motion is being played for another {left:.2f} s: wait, or stop it with an"
                " empty trajectory (send_path --stop)"
            )
        now = self.sample(stamp_s)
        if now.space == space:
            return now.position
        if space == "tip":
            return np.asarray(tip_position(self.robot, now.position))
        try:
            return joints_at_tip(self.robot, now.position, q)
        except RobotError as error:
            raise ControlError(f"the present reference has no joint positions: {error}") from error

    def _approach(
        self, space: Literal["tip", "joint"], at: FloatArray, first: FloatArray, q: FloatArray
    ) -> tuple[Segment, ...]:
        try:
            return approach_to(self.robot, space, at, first, q, self._tip_speed_m_s)
        except RobotError as error:
            raise ControlError(f"the robot cannot go to the path's start: {error}") from error

    def _check(
        self,
        space: str,
        segments: tuple[Segment, ...],
        q: FloatArray,
        step_s: float = CHECK_STEP_S,
        *,
        hint: str = "",
        go_on: Callable[[], None] = always,
    ) -> None:
        path: TipPath | JointPath
        if space == "tip":
            path = TipPath(segments, tip_link=self.robot.tip_link)
        else:
            path = JointPath(segments, joints=self.robot.joint_names)
        start = segments[0].sample(0.0)[0]
        try:
            pose = start if space == "joint" else joints_at_tip(self.robot, start, q)
            reaching = _reaching(self.robot, pose)
            given = reaching, path, self._tip_speed_m_s, q
            refuse_beyond(*given, step_s=step_s, hint=hint, go_on=go_on)
        except RobotError as error:
            raise ControlError(f"the robot cannot follow the path: {error}") from error


def _begin(start_s: float | None, stamp_s: float, approach_s: float) -> float | None:
    """When an approach begins that ends at a stamp."""
    if start_s is None:
        return None
    if start_s - approach_s < stamp_s:
        raise ControlError(
            f"it should start in {start_s - stamp_s:.3f} s, but the approach to its first point"
            f" takes {approach_s:.3f} s: ask for it earlier, or begin where the reference stands"
        )
    return start_s - approach_s


def _reaching(robot: Robot, q: FloatArray) -> Robot:
    """The robot with joint limits that take in a pose: from beyond an end the way back is open."""
    poses = q.tolist()
    if all(j.lower <= at <= j.upper for j, at in zip(robot.joints, poses, strict=True)):
        return robot
    joints = tuple(
        replace(joint, lower=min(joint.lower, at), upper=max(joint.upper, at))
        for joint, at in zip(robot.joints, poses, strict=True)
    )
    return replace(robot, joints=joints)


def _hold(space: Literal["tip", "joint"], position: FloatArray) -> Plan:
    return Plan(space, Path((Hold(position, 0.0),)))
