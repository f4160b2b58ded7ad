"""A run as the entries of a path file, every piece made to fit the limits as it is added."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hydro_ident.design.limits import Limits, fits, limit_ratios, margins
from hydro_ident.errors import IdentError
from hydro_model.description.fields import Fields
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.motion.paths_check import CHECK_STEP_S
from hydro_model.motion.paths_kinds import read_segments
from hydro_model.motion.paths_segments import Segment
from hydro_model.multibody.joint_ranges import limits as joint_limits
from hydro_model.multibody.joint_ranges import middle
from hydro_model.robot import FloatArray, Robot

Entry = dict[str, Any]

START_DELAY_S = 1.0
#: Durations of a move that are tried, s, and the share of it in which speed rises or falls.
_MOVE_TIMES = 0.8 * 1.08 ** np.arange(55)
_MOVE_RAMP = 0.35
#: Sizes of a piece that are tried.
SIZES = (1.0, 0.98, 0.96, 0.94, 0.92, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1)


class Program:
    """Entries of a joint path, from rest at `start`.

    Parameters
    ----------
    robot : Robot
    limits : Limits
    start : (n,) array

    Attributes
    ----------
    entries : list of dict
    at : (n,) array
        Where the last entry ends.
    duration_s : float

    Raises
    ------
    IdentError
        The robot cannot stand at `start` within the limits.
    """

    def __init__(self, robot: Robot, limits: Limits, start: FloatArray) -> None:
        self.robot = robot
        self.limits = limits
        self.entries: list[Entry] = []
        self.start = np.array(numbers(start))
        self.at = self.start
        self.duration_s = START_DELAY_S
        still = np.zeros((1, robot.dof))
        ratio = limit_ratios(robot, limits, self.at[None], still, still)[0]
        if not ratio.max() <= 1.0:
            raise IdentError(
                f"no motion fits the limits of robot {robot.name}: at the start"
                f" {_beyond(robot, limits, self.at, ratio)}{_way_out(robot, limits)}"
            )

    def add(self, *entries: Entry) -> bool:
        """Append entries if all of them together fit the limits; whether they did."""
        segments = self.segments(entries)
        if not fits(self.robot, self.limits, *sampled(segments)):
            return False
        self._append(entries, segments)
        return True

    def again(self, entries: Sequence[Entry]) -> None:
        """Append entries that were found to fit from this very pose before."""
        if entries:
            self._append(entries, self.segments(entries))

    def _append(self, entries: Sequence[Entry], segments: Sequence[Segment]) -> None:
        self.entries += entries
        self.at = np.asarray(segments[-1].sample(segments[-1].duration_s)[0])
        self.duration_s += sum(segment.duration_s for segment in segments)

    def all_segments(self) -> list[Segment]:
        """The whole program."""
        return self.segments(self.entries, self.start)

    def segments(self, entries: Sequence[Entry], start: FloatArray | None = None) -> list[Segment]:
        """What entries do from `start`, by default from where the program stands."""
        at, segments = self.at if start is None else start, list[Segment]()
        for entry in entries:
            segments += read_segments(Fields(entry, "design"), at)
            at = segments[-1].sample(segments[-1].duration_s)[0]
        return segments

    def move(self, target: FloatArray, *, at_least_s: float = 0.0) -> None:
        """Go to a pose in the shortest time that fits, most of it at constant speed.

        Where no straight way fits (the load may be too heavy halfway), by the middle of the
        joints' ranges.

        `target` (n,) is the pose; `at_least_s` holds the motion back to that time.
        """
        if self._straight(target, at_least_s):
            return
        detour = self.copy()
        if detour._straight(middle(self.robot), 0.0) and detour._straight(target, 0.0):
            self.take(detour)
            return
        raise IdentError(
            f"no motion fits the limits of robot {self.robot.name}: none of up to"
            f" {_MOVE_TIMES[-1]:.0f} s leads from {_pose(self.at)} to {_pose(target)}"
        )

    def _straight(self, target: FloatArray, at_least_s: float) -> bool:
        times = (at_least_s, *_MOVE_TIMES) if at_least_s > _MOVE_TIMES[0] else _MOVE_TIMES
        return any(self.add(_move(target, time)) for time in times if time >= at_least_s)

    def hold(self, duration_s: float) -> None:
        """Stay; nothing where no time is given."""
        if number(duration_s) > 0.0:
            self.add({"kind": "hold", "duration_s": number(duration_s)})

    def copy(self) -> Program:
        """A program that goes on from here by itself."""
        other = Program(self.robot, self.limits, self.start)
        other.entries, other.at = list(self.entries), self.at
        other.duration_s = self.duration_s
        return other

    def take(self, other: Program) -> None:
        """Go on from where a copy of this program went."""
        self.entries, self.at, self.duration_s = other.entries, other.at, other.duration_s

    def content(self) -> dict[str, Any]:
        """The path file."""
        return {
            "joints": list(self.robot.joint_names),
            "start": numbers(self.start),
            "start_delay_s": START_DELAY_S,
            "segments": self.entries,
        }


def sampled(segments: Sequence[Segment]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, velocities and accelerations along segments, at the spacing of checks."""
    times = [
        np.linspace(0.0, one.duration_s, max(12, round(one.duration_s / CHECK_STEP_S)))
        for one in segments
    ]
    rows = [one.sample_many(at) for one, at in zip(segments, times, strict=True)]
    q, qd, qdd = (np.concatenate(column) for column in zip(*rows, strict=True))
    return q, qd, qdd


def limit_names(robot: Robot) -> list[str]:
    """What the columns of `limit_ratios` are."""
    names = []
    for joint in robot.joint_names:
        names += [f"{what} of joint '{joint}'" for what in ("the position", "speed", "torque")]
    fed = {valve.cylinder for valve in robot.valves}
    for cylinder in robot.cylinders:
        names += [f"the {what} of '{cylinder.name}'" for what in ("stroke", "mode")]
        if robot.supply_pressure_pa > 0.0:
            names += [f"the {what} of '{cylinder.name}'" for what in ("swing", "force")]
            names += [f"the flow of '{cylinder.name}'"] * (cylinder.name in fed)
    return [*names, "the speed of the tip"]


def _beyond(robot: Robot, limits: Limits, at: FloatArray, ratio: FloatArray) -> str:
    """Which limit a pose is beyond and what it is: a joint's before what follows from it."""
    ranges = zip(robot.joints, joint_limits(robot).tolist(), margins(robot, limits), strict=True)
    for q, (joint, (low, high), kept) in zip(at, ranges, strict=True):
        if not low + kept <= q <= high - kept:
            unit = "m" if joint.prismatic else "rad"
            return (
                f"joint '{joint.name}': expected {low + kept:.4g} to {high - kept:.4g} {unit}"
                f" (its limits less {kept:.3g}), found {q:.4g}"
            )
    for q, cylinder in zip(_driven(robot, at), robot.cylinders, strict=True):
        x, margin = float(stroke(cylinder, q)), limits.stroke_margin * cylinder.stroke_m
        if not margin <= x <= cylinder.stroke_m - margin:
            return (
                f"piston of '{cylinder.name}': expected {margin:.3g} to"
                f" {cylinder.stroke_m - margin:.3g} m of its stroke, found {x:.3g}"
            )
    worst = int(np.argmax(ratio))
    return (
        f"{limit_names(robot)[worst]}: expected at most what a design may use,"
        f" found {100.0 * ratio[worst]:.0f} % of it"
    )


def _driven(robot: Robot, at: FloatArray) -> FloatArray:
    return at[[robot.joint_index(cylinder.joint) for cylinder in robot.cylinders]]


def _way_out(robot: Robot, limits: Limits) -> str:
    """A pose to start from, where the middle of the ranges is one."""
    pose, still = middle(robot)[None], np.zeros((1, robot.dof))
    if not limit_ratios(robot, limits, pose, still, still).max() <= 1.0:
        return "; try another pose"
    return f"; try the middle, --start-joints {' '.join(f'{q:.3g}' for q in pose[0])}"


def number(value: float) -> float:
    """Rounded, so that a file reads well and is the same on every machine."""
    return round(float(value), 6)


def numbers(values: FloatArray) -> list[float]:
    """Rounded values of a vector."""
    return [number(value) for value in values]


def _move(target: FloatArray, duration_s: float) -> Entry:
    return {
        "kind": "cruise",
        "to": numbers(target),
        "duration_s": number(duration_s),
        "ramp_s": number(_MOVE_RAMP * duration_s),
    }


def _pose(q: FloatArray) -> str:
    return "[" + ", ".join(f"{v:.3f}" for v in q) + "]"
