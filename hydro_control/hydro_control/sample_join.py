"""Joins the two sensor topics by stamp: DDS gives no order across topics."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from hydro_control.core import Sample
from hydro_model.robot import FloatArray, Robot
from hydro_msgs_docs.messages import by_name, stamp_ns

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
        Messages without a name the robot needs.
    message : str
        What the newest malformed one lacked.
    """

    def __init__(self, robot: Robot) -> None:
        self._joint_names, self._pressure_names = robot.joint_names, robot.pressure_names
        self._chambers = [n for n in robot.pressure_names if "/" in n]
        self._joints: deque[tuple[int, FloatArray]] = deque(maxlen=_KEPT)
        self._pressures: deque[tuple[int, FloatArray]] = deque(maxlen=_KEPT)
        self.malformed = 0
        self.message = ""

    def clear(self) -> None:
        """Drop what is kept."""
        self._joints.clear()
        self._pressures.clear()

    def add_joints(self, message: Any) -> None:
        """Take a `/joint_states` message."""
        values = by_name(message, "position", self._joint_names)
        if values is None:
            self._lacks("/joint_states", self._joint_names, message)
        else:
            self._joints.append((stamp_ns(message), np.array(values)))

    def add_pressures(self, message: Any) -> None:
        """Take a `/chamber_pressures` message; supply and tank may be absent."""
        values = by_name(message, "effort", self._pressure_names)
        if values is None:
            values = by_name(message, "effort", self._chambers)
        if values is None:
            self._lacks("/chamber_pressures", self._chambers, message)
        else:
            self._pressures.append((stamp_ns(message), np.array(values)))

    def _lacks(self, topic: str, names: Any, message: Any) -> None:
        self.malformed += 1
        self.message = f"{topic} should carry {', '.join(names)}, found {', '.join(message.name)}"

    @property
    def waiting(self) -> bool:
        """The newest pressures are without their joint positions."""
        if not self._pressures:
            return False
        return not self._joints or self._joints[-1][0] < self._pressures[-1][0]

    def newest(self) -> Sample | None:
        """The sample of the newest stamp that both have, or None."""
        joints = dict(self._joints)
        for stamp, pressures in reversed(self._pressures):
            if stamp in joints:
                return self._sample(stamp, joints[stamp], pressures)
        return None

    def _sample(self, stamp: int, q: FloatArray, pressures: FloatArray) -> Sample:
        count = len(self._chambers)
        supply = pressures[count:]
        return Sample(
            stamp_ns=stamp,
            q=q,
            p_a=pressures[0:count:2],
            p_b=pressures[1:count:2],
            p_s=float(supply[0]) if len(supply) else None,
            p_t=float(supply[1]) if len(supply) else None,
        )
