"""Joins the two sensor topics by stamp: DDS gives no order across topics."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from hydro_control.core.core import Sample
from hydro_control.errors import names_in_short
from hydro_model.robot import FloatArray, Robot
from hydro_msgs_docs.messages import StampedVector, by_name

_RAILS = ("supply", "tank")
#: Messages kept per topic while their partners are on the way.
_KEPT = 8


class SampleJoin:
    """The newest stamp present on both sensor topics.

    Parameters
    ----------
    robot : Robot

    Attributes
    ----------
    malformed : int
        Messages with some of the names that the robot needs, and not all.
    message : str
        What the newest message lacked; empty where that was as it should be.
    """

    def __init__(self, robot: Robot) -> None:
        self._joint_names, self._pressure_names = robot.joint_names, robot.pressure_names
        self._chambers = [n for n in robot.pressure_names if "/" in n]
        self._joints: deque[tuple[int, FloatArray]] = deque(maxlen=_KEPT)
        self._pressures: deque[tuple[int, FloatArray, tuple[float | None, ...]]] = deque(
            maxlen=_KEPT
        )
        self.malformed = 0
        self.message = ""

    def clear(self) -> None:
        """Drop what is kept."""
        self._joints.clear()
        self._pressures.clear()
        self.malformed, self.message = 0, ""

    def add_joints(self, vector: StampedVector) -> None:
        """Take what came on `/joint_states`."""
        values = by_name(vector, "position", self._joint_names)
        if values is None:
            self._lacks("/joint_states", self._joint_names, vector)
        else:
            self._joints.append((vector.stamp_ns, np.array(values)))
            self.message = ""

    def add_pressures(self, vector: StampedVector) -> None:
        """Take what came on `/chamber_pressures`; supply and tank may each be absent."""
        values = by_name(vector, "effort", self._pressure_names)
        if values is None:
            values = by_name(vector, "effort", self._chambers)
            rails = [by_name(vector, "effort", (name,)) for name in _RAILS]
            of_rails = tuple(None if rail is None else rail[0] for rail in rails)
        else:
            of_rails = tuple(values[len(self._chambers) :])
        if values is None:
            self._lacks("/chamber_pressures", self._chambers, vector)
        else:
            chambers = np.array(values[: len(self._chambers)])
            self._pressures.append((vector.stamp_ns, chambers, of_rails))
            self.message = ""

    def _lacks(self, topic: str, names: Sequence[str], vector: StampedVector) -> None:
        if not set(names) & set(vector.name):
            return  # of another machine, such as a gripper's driver
        self.malformed += 1
        found = names_in_short(vector.name)
        self.message = f"{topic} should carry {', '.join(names)}, found {found}"

    @property
    def waiting(self) -> bool:
        """The newest pressures are without their joint positions."""
        if not self._pressures:
            return False
        return not self._joints or self._joints[-1][0] < self._pressures[-1][0]

    def newest(self) -> Sample | None:
        """The sample of the newest stamp that both have, or None."""
        joints = dict(self._joints)
        for stamp, chambers, (p_s, p_t) in reversed(self._pressures):
            if stamp in joints:
                p_a, p_b = chambers[0::2], chambers[1::2]
                return Sample(stamp_ns=stamp, q=joints[stamp], p_a=p_a, p_b=p_b, p_s=p_s, p_t=p_t)
        return None
