"""Whether the machine does what no command may make it do: a joint beyond its end, or too fast.

Required motion is kept within limits before it is commanded; this looks at what was measured. A
wrong model, a valve that sticks or a load that is not known may carry an arm on all the same.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from hydro_control.errors import ControlError
from hydro_control.motion.motion_limits import MotionLimits
from hydro_control.state.axes import SHORTEST_LEVER_M
from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.kinematics import TipPlace
from hydro_model.robot import FloatArray, Robot

#: A joint further beyond its end than this share of its range is not driven at all.
DRIVEN_BACK_SHARE = 0.1
#: Samples in a row before it is believed: one reading may be wrong.
BELIEVED = 3
#: Samples that a speed is measured over: 20 ms at 500 Hz, so that a count of the encoder
#: is far below any limit.
SPAN = 10
#: A tip is never too fast by less: a machine that is not as its model starts with up to 0.1 m/s
#: more than it was asked for, which under a low limit would be several times that.
TIP_ALLOWANCE_M_S = 0.2
#: Samples further apart than so many sample times have no speed between them.
GAP_STEPS = 10
_STEPS = 100


@dataclass(frozen=True, slots=True)
class RunawayLimits:
    """When the controller stops by itself.

    Attributes
    ----------
    end_share : float
        A joint beyond its end, or beyond where it stood when driving began, by more than this
        share of its range.
    speed_factor : float
        A joint or the tip faster than its limit times this; the tip by 0.2 m/s at least.
    """

    end_share: float = 0.02
    speed_factor: float = 1.5

    def __post_init__(self) -> None:
        if not 0.0 < self.end_share < DRIVEN_BACK_SHARE:
            raise ControlError(
                f"end_share should be above 0 and below {DRIVEN_BACK_SHARE},"
                f" found {self.end_share}"
            )
        if not (math.isfinite(self.speed_factor) and self.speed_factor > 1.0):
            raise ControlError(f"speed_factor should be above 1, found {self.speed_factor}")


class RunawayWatch:
    """Judges measured positions, sample by sample.

    Where a joint stands beyond an end when driving begins, it may stay there and be driven back,
    and never further out: the place that it may be at follows it until it is within its ends.

    Parameters
    ----------
    robot : Robot
    limits : MotionLimits
        Of the robot; its `open_lower` and `open_upper` are not looked at.
    runaway : RunawayLimits
    dt_s : float
        Sample time.

    Attributes
    ----------
    lower, upper : (n,) array
        Where the joints may be at present, rad or m.
    opened : bool
        That is more than the range between the ends.
    fault : str
        What was wrong for `BELIEVED` samples in a row, until `forget`; empty where nothing was.
    """

    def __init__(
        self, robot: Robot, limits: MotionLimits, runaway: RunawayLimits, dt_s: float
    ) -> None:
        self._limits, self._dt_s = limits, dt_s
        self._names, self._tip = robot.joint_names, TipPlace(robot)
        span = limits.upper - limits.lower
        self._margin = runaway.end_share * span
        speeds = np.array([joint.velocity_limit for joint in robot.joints])
        self._fastest = (runaway.speed_factor * speeds).tolist()
        tip_m_s = limits.tip_speed_m_s
        self._tip_fastest = max(runaway.speed_factor * tip_m_s, tip_m_s + TIP_ALLOWANCE_M_S)
        self._least, self._most = _driven_range(robot, limits)
        self._past: deque[tuple[float, list[float], list[float]]] = deque(maxlen=SPAN + 1)
        self.lower, self.upper = limits.lower, limits.upper
        self._look()
        self._in_a_row = 0
        self.forget()

    def forget(self) -> None:
        """Driving begins anew with the next sample; no fault."""
        self.fault = ""
        self._begun = False

    def judge(self, stamp_s: float, q: FloatArray, *, driven: bool) -> str:
        """Look at a sample.

        Parameters
        ----------
        stamp_s : float
            Its time, s.
        q : (n,) array
            Measured joint positions, rad or m.
        driven : bool
            The valves get the commands. While they do not, whatever moves the machine is somebody
            else's, and where that leaves it driving begins anew.

        Returns
        -------
        str
            `fault`.
        """
        if not (self._begun and driven):
            self._begin(q)
        past = self._past
        if past and stamp_s - past[-1][0] > GAP_STEPS * self._dt_s:
            past.clear()
        # As plain numbers: of a few joints, most of the time would be numpy's price of a call.
        positions: list[float] = q.tolist()
        past.append((stamp_s, positions, self._tip.at(q)))
        found = self._beyond(positions) or self._too_fast()
        self._in_a_row = self._in_a_row + 1 if found else 0
        if self.opened and not found:
            self.lower = np.minimum(self._limits.lower, np.maximum(self.lower, q))
            self.upper = np.maximum(self._limits.upper, np.minimum(self.upper, q))
            self._look()
        if self._in_a_row >= BELIEVED and not self.fault:
            self.fault = f"{found}: latched until the controller is activated anew"
        return self.fault

    def _begin(self, q: FloatArray) -> None:
        self._begun = True
        self.lower = np.minimum(self._limits.lower, q)
        self.upper = np.maximum(self._limits.upper, q)
        self._look()
        self._past.clear()
        self._in_a_row = 0

    def _look(self) -> None:
        """Follow `lower` and `upper`: whether they are opened, and where a joint is at fault."""
        ends = self._limits.lower, self._limits.upper
        self.opened = not np.array_equal((self.lower, self.upper), ends)
        least = np.maximum(self.lower - self._margin, self._least)
        most = np.minimum(self.upper + self._margin, self._most)
        self._allowed = np.stack([least, most], axis=1).tolist()

    def _beyond(self, positions: list[float]) -> str:
        for i, at in enumerate(positions):
            least, most = self._allowed[i]
            if at < least or at > most:
                return self._described(i, at)
        return ""

    def _described(self, i: int, at: float) -> str:
        least, most = (self.lower - self._margin)[i], (self.upper + self._margin)[i]
        expected = f"{least:.4f} to {most:.4f}"
        if at < self._least[i] or at > self._most[i]:
            expected = f"{self._least[i]:.4f} to {self._most[i]:.4f} to be driven back from"
        return f"joint '{self._names[i]}' is measured at {at:.4f}, expected {expected}"

    def _too_fast(self) -> str:
        past = self._past
        if len(past) <= SPAN:
            return ""
        (begin, q_0, tip_0), (end, q_1, tip_1) = past[0], past[-1]
        for i, fastest in enumerate(self._fastest):
            speed = abs(q_1[i] - q_0[i]) / (end - begin)
            if speed > fastest:
                return (
                    f"joint '{self._names[i]}' is measured at a speed of {speed:.3f}, expected at"
                    f" most {fastest:.3f}"
                )
        tip_speed = math.dist(tip_1, tip_0) / (end - begin)
        if tip_speed > self._tip_fastest:
            return (
                f"the tip is measured at {tip_speed:.3f} m/s, expected at most"
                f" {self._tip_fastest:.3f} m/s"
            )
        return ""


def _driven_range(robot: Robot, limits: MotionLimits) -> tuple[FloatArray, FloatArray]:
    """As far as a joint may be driven from: its lever is that of its range, and not too short."""
    ends = []
    for sign, at in ((-1.0, limits.lower), (1.0, limits.upper)):
        reach = DRIVEN_BACK_SHARE * (limits.upper - limits.lower)
        for cylinder in robot.cylinders:
            i = robot.joint_index(cylinder.joint)
            away = np.linspace(0.0, reach[i], _STEPS)
            arm = lever(cylinder, at[i] + sign * away)
            short = arm * np.sign(arm[0]) < SHORTEST_LEVER_M
            if short.any():
                reach[i] = away[max(int(np.argmax(short)) - 1, 0)]
        ends.append(at + sign * reach)
    return ends[0], ends[1]
