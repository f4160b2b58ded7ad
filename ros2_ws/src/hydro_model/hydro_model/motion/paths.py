"""Paths that the controller plays: tip paths by quintics, and joint paths made of segments.

Tip path, quintic in time between corners and at rest in each::

    frame: base_link
    tip_link: tip_link
    corners_m: [[2.0, 0.0, -1.2], [3.0, 0.0, -1.2]]
    durations_s: [3.0]
    start_delay_s: 1.0                   # optional, held at the first corner

Joint path, segments one after the other, each from rest to rest::

    joints: [lift, tilt]
    start: [0.4, -1.2]                   # rad or m, in the order of `joints`
    start_delay_s: 1.0
    segments:
      - {kind: move, to: [0.6, -1.0], duration_s: 3.0}            # quintic
      - {kind: hold, duration_s: 1.0}
      - {kind: cruise, to: [0.8, -1.0], duration_s: 6.0, ramp_s: 0.5}   # constant speed
      - {kind: staircase, levels: [[0.7, -1.0], [0.6, -0.9]], move_s: 2.0, hold_s: 1.0}
      - {kind: ladder, travel: [0.2, 0.0], speeds: [0.02, 0.05], ramp_s: 0.3, hold_s: 0.5}
      - {kind: fourier, duration_s: 20.0, fundamental_hz: 0.1, ramp_s: 2.0,
         sine: [[0.1, 0.02], [0.1, 0.05]], cosine: [[0.0, 0.01], [0.0, 0.0]]}
      - {kind: chirp, duration_s: 10.0, amplitude: [0.02, 0.02], from_hz: 0.2, to_hz: 3.0,
         ramp_s: 1.0}

A ladder goes out by `travel` and back at each speed (rad/s or m/s of the joint that travels
most). Whether a robot can follow a path is for `hydro_model.motion.paths_check`.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import ArrayLike

from hydro_model.description.fields import Fields
from hydro_model.errors import RobotError
from hydro_model.motion.paths_kinds import MAX_DURATION_S, read_segments, rectangle
from hydro_model.motion.paths_segments import Quintic, Sample, Segment
from hydro_model.robot import FloatArray
from hydro_model.robot_files import read_yaml, shipped_robots


@dataclass(frozen=True, slots=True)
class Path:
    """Segments in a row; before the first and after the last there is rest.

    Attributes
    ----------
    segments : tuple of Segment
        At least one.
    start_delay_s : float
        Hold at the start before the first segment.
    """

    segments: tuple[Segment, ...]
    start_delay_s: float = 0.0
    _starts: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        starts = accumulate((s.duration_s for s in self.segments), initial=self.start_delay_s)
        object.__setattr__(self, "_starts", tuple(starts))

    @property
    def duration_s(self) -> float:
        """Length in time, start delay included."""
        return self._starts[-1]

    @property
    def breaks_s(self) -> tuple[float, ...]:
        """Start time of every segment, then the end."""
        return self._starts

    def sample(self, t: float) -> Sample:
        """Position, velocity and acceleration at a time.

        Parameters
        ----------
        t : float
            Seconds since the start; times outside the path give its ends, at rest.

        Returns
        -------
        position, velocity, acceleration : (k,) array
        """
        if t >= self.duration_s:
            return _rest(self.segments[-1].sample(self.segments[-1].duration_s)[0])
        if t < self.start_delay_s:
            return _rest(self.segments[0].sample(0.0)[0])
        index = bisect_right(self._starts, t) - 1
        return self.segments[index].sample(t - self._starts[index])

    def sample_many(self, times_s: ArrayLike) -> Sample:
        """Position, velocity and acceleration at N times, (N, k) each."""
        times = np.atleast_1d(np.asarray(times_s, float))
        where = np.searchsorted(self._starts, times, side="right") - 1
        order = np.argsort(where, kind="stable")
        position = np.empty((len(times), len(self.sample(0.0)[0])))
        velocity, acceleration = np.empty_like(position), np.empty_like(position)
        for rows in np.split(order, np.flatnonzero(np.diff(where[order])) + 1):
            found = self._sample_together(int(where[rows[0]]), times[rows])
            position[rows], velocity[rows], acceleration[rows] = found
        return position, velocity, acceleration

    def _sample_together(self, index: int, times: FloatArray) -> Sample:
        """Samples at times that lie in one segment, or all before the first or after the last."""
        if 0 <= index < len(self.segments):
            return self.segments[index].sample_many(times - self._starts[index])
        position, velocity, acceleration = self.sample(float(times[0]))
        count = (len(times), 1)
        return np.tile(position, count), np.tile(velocity, count), np.tile(acceleration, count)


def _rest(position: FloatArray) -> Sample:
    still = np.zeros_like(position)
    return position, still, still


@dataclass(frozen=True, slots=True)
class TipPath(Path):
    """A path of the tip, positions in m in the base frame.

    Attributes
    ----------
    frame, tip_link : str
    """

    frame: str = "base_link"
    tip_link: str = "tip_link"

    @staticmethod
    def through(
        corners_m: Sequence[Sequence[float]],
        durations_s: Sequence[float],
        *,
        frame: str = "base_link",
        tip_link: str = "tip_link",
        start_delay_s: float = 0.0,
    ) -> TipPath:
        """Quintic in time along straight lines between corners, at rest in each.

        Parameters
        ----------
        corners_m : (k, 3) array
        durations_s : (k - 1,) array
        frame, tip_link : str
        start_delay_s : float

        Returns
        -------
        TipPath
        """
        legs = zip(corners_m[:-1], corners_m[1:], durations_s, strict=True)
        segments = tuple(Quintic.at_rest(a, b, t) for a, b, t in legs)
        return TipPath(segments, start_delay_s, frame=frame, tip_link=tip_link)


@dataclass(frozen=True, slots=True)
class JointPath(Path):
    """A path of joints, positions in rad or m.

    Attributes
    ----------
    joints : tuple of str
        Names of the coordinates; joints of the robot that are not named stay where they are.
    """

    joints: tuple[str, ...] = ()


def shipped_paths() -> dict[str, FilePath]:
    """Path files inside the package: `<robot>/<path>` -> file.

    Files of two endings (`*.hydraulics.yaml`, `*.map.yaml`) are no paths.
    """
    found = {}
    for name, robot_file in shipped_robots().items():
        for file in sorted(robot_file.parent.glob("*.yaml")):
            if file.suffixes == [".yaml"]:
                found[f"{name}/{file.stem}"] = file
    return found


def load_path(path: str | FilePath) -> TipPath | JointPath:
    """Read a path by file or by the name of a shipped path.

    Parameters
    ----------
    path : str or Path
        A YAML file as in the module's text, or a shipped name such as `xs031/parallelogram`.

    Returns
    -------
    TipPath or JointPath

    Raises
    ------
    RobotError
        The file is missing or malformed; the message says what was expected and found where.
    """
    shipped = shipped_paths()
    file = shipped.get(str(path), FilePath(path))
    if not file.is_file():
        names = ", ".join(shipped)
        raise RobotError(
            f"no path file '{path}': expected a YAML file or a shipped path ({names})"
        )
    top = read_yaml(file)
    if "corners_m" in top:
        return _tip_path(top)
    if "segments" in top:
        return _joint_path(top)
    raise RobotError(
        f"{file}: expected a path with 'corners_m' (of the tip) or 'segments' (of joints),"
        f" found the keys {', '.join(top.keys()) or 'none'}"
    )


def _delay(top: Fields) -> float:
    delay = top.number("start_delay_s", 0.0)
    if not 0.0 <= delay <= MAX_DURATION_S:
        raise RobotError(f"{top.where}: 'start_delay_s' should be 0 s or more, found {delay}")
    return delay


def _tip_path(top: Fields) -> TipPath:
    corners = rectangle(top, "corners_m", 3)
    if len(corners) < 2:
        raise RobotError(f"{top.where}: 'corners_m' should have 2 corners or more")
    durations = top.vector("durations_s", len(corners) - 1)
    if not np.all((durations > 0.0) & (durations <= MAX_DURATION_S)):
        raise RobotError(f"{top.where}: 'durations_s' should be above 0 s, found {durations}")
    return TipPath.through(
        corners.tolist(),
        durations.tolist(),
        frame=top.text("frame", "base_link"),
        tip_link=top.text("tip_link", "tip_link"),
        start_delay_s=_delay(top),
    )


def _joint_path(top: Fields) -> JointPath:
    joints = top.texts("joints")
    if not joints or len(set(joints)) != len(joints):
        raise RobotError(f"{top.where}: 'joints' should be distinct names, found {list(joints)}")
    at = top.vector("start", len(joints))
    segments: list[Segment] = []
    for f in top.items("segments"):
        segments += read_segments(f, at)
        at = segments[-1].sample(segments[-1].duration_s)[0]
    if not segments:
        raise RobotError(f"{top.where}: 'segments' should have one segment or more")
    return JointPath(tuple(segments), _delay(top), joints=joints)
