"""The rows of a residual channel as a report draws them, wherever they come from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hydro_ident.report.figure import one_after_another, pieces
from hydro_model.robot import FloatArray, Robot

#: In full, and as an axis has room for it.
_QUANTITIES = {
    "force": ("cylinder force", "force"),
    "torque": ("joint torque", "torque"),
    "flow_a": ("flow into chamber A", "flow A"),
    "flow_b": ("flow into chamber B", "flow B"),
}
#: What is said beside numbers of a fit that was rejected.
REJECTED = "rejected, not in model.yaml"
#: A reversal lies between motions beyond this share of the usual fast speed.
_MOVES, _USUAL = 0.1, 0.95
#: Seconds shown to either side of a reversal, and how many reversals.
_AROUND_S, _MOST = 0.75, 3
#: Longest stop at a reversal: a longer one would fill more than two thirds of the picture.
LONGEST_STOP_S = 4.0 * _AROUND_S


@dataclass(frozen=True, slots=True)
class ChannelRows:
    """A channel's measured and predicted values.

    Attributes
    ----------
    name, unit : str
    time_s : (T,) array
        Recordings one after the other.
    measured, before, after : (T,) array
    speed : (T,) array
        What the residual is held against; NaN where unknown.
    speed_name, speed_unit : str
    summary : mapping
        The channel's entry in the result file.
    rejected : bool
        `after` is of a fit that is not in the model.
    counted : int
        Rows that the summary is of: of long recordings more than are drawn; 0: as many.
    """

    name: str
    unit: str
    time_s: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray
    speed: FloatArray
    speed_name: str
    speed_unit: str
    summary: Mapping[str, float | str]
    rejected: bool = False
    counted: int = 0

    @property
    def count(self) -> int:
        """Rows that the summary is of."""
        return self.counted or self.time_s.size

    @property
    def seconds(self) -> float:
        """How much recorded time the rows stand for, s: as many times their usual spacing."""
        steps = np.diff(self.time_s)
        return self.time_s.size * float(np.median(steps)) if steps.size else 0.0

    @property
    def remark(self) -> str:
        """What `after` is, where it is not the model's."""
        return REJECTED if self.rejected else ""

    @property
    def joint(self) -> str:
        """The channel's joint."""
        return self.name.split("/")[0]

    @property
    def quantity(self) -> str:
        """What is measured, in few words."""
        return _QUANTITIES[self.name.split("/")[-1]][1]

    @property
    def title(self) -> str:
        """Joint and quantity."""
        return f"{self.joint}: {_QUANTITIES[self.name.split('/')[-1]][0]}"

    @property
    def residuals(self) -> tuple[FloatArray, FloatArray]:
        """Residuals before and after."""
        return self.measured - self.before, self.measured - self.after

    def value(self, key: str) -> float:
        """A number of the summary."""
        return float(self.summary[key])

    def reversals(self) -> list[slice]:
        """Rows around some reversals of the motion, evenly spread over all of them.

        A machine stops where it turns: what is shown goes around the whole stop.
        """
        known = np.isfinite(self.speed)
        if not known.any():
            return []
        least = _MOVES * float(np.quantile(np.abs(self.speed[known]), _USUAL))
        found: list[slice] = []
        for piece in pieces(self.time_s):
            t, v = self.time_s[piece], self.speed[piece]
            moving = np.flatnonzero(np.abs(v) > least)
            turns = np.flatnonzero(np.diff(np.sign(v[moving])))
            for k in turns.tolist():
                first, last = t[moving[k]], t[moving[k + 1]]
                if last - first > LONGEST_STOP_S:
                    continue
                inside = np.flatnonzero((t >= first - _AROUND_S) & (t <= last + _AROUND_S))
                if t[inside[-1]] - t[inside[0]] > last - first + _AROUND_S:
                    begin = piece.start + int(inside[0])
                    found.append(slice(begin, begin + inside.size))
        return _spread(found)


def _spread(found: Sequence[slice]) -> list[slice]:
    if len(found) <= _MOST:
        return list(found)
    return [found[(2 * k + 1) * len(found) // (2 * _MOST)] for k in range(_MOST)]


def channel_rows(
    names: tuple[str, str],
    columns: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    speed: tuple[FloatArray | None, str, str],
    summary: Mapping[str, float | str],
    counted: int = 0,
) -> ChannelRows:
    """Rows of a channel.

    Parameters
    ----------
    names : pair of str
        Name and unit.
    columns : tuple of (T,) array
        Times as recorded, measured, before, after.
    speed : tuple
        Values (or None), name and unit.
    summary : mapping
    counted : int
        As of `ChannelRows`.
    """
    time_s, measured, before, after = columns
    values = np.full(time_s.shape, np.nan) if speed[0] is None else speed[0]
    shown = one_after_another(time_s), measured, before, after, values
    return ChannelRows(*names, *shown, *speed[1:], summary, counted=counted)


def joint_speed(robot: Robot, joint: str) -> tuple[str, str]:
    """Name and unit of a joint's velocity."""
    prismatic = robot.joints[robot.joint_index(joint)].prismatic
    return "joint velocity", "m/s" if prismatic else "rad/s"
