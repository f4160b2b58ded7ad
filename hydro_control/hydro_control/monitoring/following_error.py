"""Whether the arm follows what it is asked for: a joint far behind that makes no headway.

The further a joint is behind, the more feedback asks for, up to the supply's whole pressure. An
arm that ran against a tree presses on it with that for as long as nobody looks, and leaps forward
when the tree gives way. A machine that is slower than its reference, by a wrong model, a load or a
pump that cannot do more, is behind as well, but comes after: that is no fault.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from hydro_control.errors import ControlError
from hydro_model.multibody.joint_ranges import limits
from hydro_model.robot import FloatArray, Robot

#: Headway is a move towards the reference by this share of what the velocity limit allows in the
#: time that is granted. With the shipped gains feedback asks for the whole limit from an error of
#: 0.05 s of it on: a machine that is too weak for its reference still does a tenth of that, and
#: one that is blocked yields by millimetres.
HEADWAY_SHARE = 0.05


@dataclass(frozen=True, slots=True)
class FollowingLimits:
    """When an arm is taken for one that does not follow.

    Attributes
    ----------
    error_share : float
        A joint behind its reference by more than this share of its range.
    time_s : float
        And that for so long without headway.
    """

    error_share: float = 0.05
    time_s: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 < self.error_share <= 1.0:
            raise ControlError(
                f"following_error_share should be above 0 and at most 1, found {self.error_share}"
            )
        if not (math.isfinite(self.time_s) and self.time_s > 0.0):
            raise ControlError(f"following_error_s should be above 0, found {self.time_s}")


class _Since(NamedTuple):
    """Where a joint stood when it last made headway, or was first too far behind."""

    stamp_s: float
    position: float
    forwards: bool
    epoch: int


class FollowingWatch:
    """Judges how far joints are behind what they shall do, sample by sample.

    Parameters
    ----------
    robot : Robot
    following : FollowingLimits

    Attributes
    ----------
    fault : str
        Why a joint that was only held went away all the same, until `forget`; empty where none
        did.
    """

    def __init__(self, robot: Robot, following: FollowingLimits) -> None:
        self._joints, self._time_s = robot.joints, following.time_s
        low, high = limits(robot).T
        self._most = (following.error_share * (high - low)).tolist()
        per_limit = HEADWAY_SHARE * following.time_s
        self._least = [per_limit * joint.velocity_limit for joint in robot.joints]
        self.forget()

    def forget(self) -> None:
        """Driving begins anew with the next sample; no fault."""
        self.fault = ""
        self._since: list[_Since | None] = [None] * len(self._joints)

    def judge(
        self, stamp_s: float, q: FloatArray, q_d: FloatArray, epoch: int, *, held: bool
    ) -> str:
        """Look at a sample.

        Parameters
        ----------
        stamp_s : float
            Its time, s.
        q, q_d : (n,) array
            Measured joint positions, and those desired at that sample, rad or m. Of a tip's
            reference the joints' that lead there from the measured ones.
        epoch : int
            Of the reference: in another one everything counts from its beginning.
        held : bool
            The joints shall stay where they were measured: nothing else was asked for since. What
            goes away then is not blocked, it is not in hand, and `fault` says so.

        Returns
        -------
        str
            Which joint does not follow, and how; empty where all do.
        """
        behind = (q_d - q).tolist()
        for i, (far, most) in enumerate(zip(behind, self._most, strict=True)):
            if abs(far) <= most:
                self._since[i] = None
            elif found := self._stuck(i, stamp_s, float(q[i]), far, epoch):
                if held:
                    self.fault = f"{found}: latched until the controller is activated anew"
                return found
        return ""

    def _stuck(self, i: int, stamp_s: float, position: float, far: float, epoch: int) -> str:
        """Of a joint that is too far behind: how, where it has made no headway for the time."""
        since, forwards = self._since[i], far > 0.0
        if since is None or since.epoch != epoch or since.forwards != forwards:
            self._since[i] = _Since(stamp_s, position, forwards, epoch)
            return ""
        headway = position - since.position if forwards else since.position - position
        if headway >= self._least[i]:
            self._since[i] = _Since(stamp_s, position, forwards, epoch)
            return ""
        lasted_s = stamp_s - since.stamp_s
        if lasted_s < self._time_s:
            return ""
        joint = self._joints[i]
        unit = "m" if joint.prismatic else "rad"
        return (
            f"joint '{joint.name}' is {abs(far):.3f} {unit} from where it shall be, expected at"
            f" most {self._most[i]:.3f} {unit}, and came nearer by {headway:.3f} {unit} in"
            f" {lasted_s:.2f} s"
        )
