"""Trajectory messages to requests of the core, checked beside whoever takes the messages."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from hydro_control.core.core import ControllerCore
from hydro_control.errors import ControlError
from hydro_control.motion.asking import MOST_POINTS
from hydro_control.motion.path_limits import refuse_frame
from hydro_control.motion.reference_run import Standing
from hydro_control.motion.trajectory import Waypoint
from hydro_msgs_docs.aside import NodeLog
from hydro_msgs_docs.real_time import as_others

Space = Literal["tip", "joint"]


class TrajectoryIntake:
    """What becomes of the messages of `/joint_trajectory` and `/tip_trajectory`.

    A stop is handed over at once. A motion is checked in a thread of its own, as that of minutes
    takes seconds: stops, transitions and signals are heard meanwhile. One that is stopped while it
    is checked is not played, and its check ends: what is asked for next waits for no more of it.

    Parameters
    ----------
    core : ControllerCore
    active : callable
        Whether the controller is, at the moment.
    log : NodeLog
    """

    def __init__(self, core: ControllerCore, active: Callable[[], bool], log: NodeLog) -> None:
        self._core, self._active, self._log = core, active, log
        self._check: threading.Thread | None = None
        self._checked: Standing | None = None

    @property
    def busy(self) -> bool:
        """A trajectory is being checked."""
        return self._check is not None and self._check.is_alive()

    def take(self, space: Space, message: Any) -> None:
        """Take a message: what becomes of it is logged, and a refusal is the core's message.

        Parameters
        ----------
        space : {"tip", "joint"}
        message : trajectory_msgs.msg.JointTrajectory or MultiDOFJointTrajectory
        """
        # Where the reference stands when it is asked for, not when its turn to be checked comes.
        standing = self._core.requests.standing
        try:
            self._refuse_inactive()
            if not message.points:
                self._core.requests.trajectory(space, [], [])
                self._log.info(f"{space} trajectory to stop accepted")
                return
            if standing is None:
                # Not for the first sample: a stop, or an end of driving, may come before it.
                raise self._core.requests.refusal("no sample has come yet")
            ends = self._checked is None or self._checked.overtaken
            if self.busy and not ends:
                raise self._core.requests.refusal(
                    "another trajectory is being checked: wait, or stop it with an empty"
                    " trajectory (send_path --stop)"
                )
        except ControlError as error:
            self._log.error(str(error))
            return
        given = space, message, standing, self._check
        self._checked = standing
        self._check = threading.Thread(
            target=self._ask, args=given, name="trajectory", daemon=True
        )
        self._check.start()

    def _ask(
        self,
        space: Space,
        message: Any,
        standing: Standing,
        before: threading.Thread | None,
    ) -> None:
        as_others()
        if before is not None:
            before.join()  # overtaken, it ends with the step that it is at
        stamp = message.header.stamp
        start_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
        try:
            points = self._points(space, message)
            names = list(message.joint_names)
            self._core.requests.trajectory(space, names, points, start_ns, standing)
            self._refuse_inactive()
            refused = ""
        except ControlError as error:
            refused = str(error)
        if self._checked is standing:
            self._checked = None  # what is written about it keeps nobody waiting
        if refused:
            self._log.error(refused)
        else:
            self._log.info(f"{space} trajectory with {len(points)} points accepted")

    def _refuse_inactive(self) -> None:
        if not self._active():
            raise ControlError("trajectory refused: the controller is not active")

    def _points(self, space: Space, message: Any) -> list[Waypoint]:
        """The points of a message, counted first: a million take seconds and memory to read."""
        count, frame = len(message.points), message.header.frame_id
        if count > MOST_POINTS:
            raise self._core.requests.refusal(
                f"expected at most {MOST_POINTS} points, found {count}: send it in parts, or give"
                " it as the controller's path"
            )
        try:
            if space == "tip" and frame:
                refuse_frame(self._core.robot, frame)
            waypoint = _of_tip if space == "tip" else _of_joints
            return [waypoint(index, point) for index, point in enumerate(message.points)]
        except ControlError as error:
            raise self._core.requests.refusal(str(error)) from error


def _of_joints(_index: int, point: Any) -> Waypoint:
    return _waypoint(point, (point.positions, point.velocities, point.accelerations))


def _of_tip(index: int, point: Any) -> Waypoint:
    """Of the tip alone: of several bodies nobody knows which is meant."""
    parts = {
        "transforms": [t.translation for t in point.transforms],
        "velocities": [t.linear for t in point.velocities],
        "accelerations": [t.linear for t in point.accelerations],
    }
    for name, vectors in parts.items():
        if len(vectors) > 1:
            raise ControlError(
                f"point {index} of the trajectory should have at most one entry of {name}, the"
                f" tip's, found {len(vectors)}"
            )
    return _waypoint(point, [[x for v in of for x in (v.x, v.y, v.z)] for of in parts.values()])


def _waypoint(point: Any, parts: Sequence[Sequence[float]]) -> Waypoint:
    time_s = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
    return Waypoint(time_s, *(np.array(part, dtype=float) for part in parts))
