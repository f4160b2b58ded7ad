"""The topics of a bag as columns on the grid of its cycles.

The grid is that of the recorded cycles: the stamps that `/joint_states` and, where it was
recorded, `/chamber_pressures` have in common. Every other topic is joined to it by stamp.
Nothing is resampled: a cycle that is not there is a gap, and a reading that is not there is NaN.
Nothing is filled in from other cycles. What stands for a reading is recorded of the same cycle,
and a note says so: a stroke for its joint's position (`fill_angles`), a command for the voltage of
a valve that tells none (`valve_columns`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.bag.grid import Repeats, Topic, join
from hydro_ident.bag.reader import TopicInfo
from hydro_ident.bag.series import Series
from hydro_ident.bag.valve_columns import valve_columns
from hydro_ident.errors import BagError, NoCyclesError
from hydro_model.arrays import FloatArray, IntArray
from hydro_model.hydraulics.cylinder import joint_position
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED, TEMPERATURE
from hydro_msgs_docs.topics import (
    CHAMBER_PRESSURES,
    JOINT_REFERENCE,
    JOINT_STATES,
    OIL_TEMPERATURE,
    TIP_REFERENCE,
    VALVE_COMMAND,
    VALVE_STATE,
)

#: What the topics of a recording are of, in the order in which they are looked at.
TYPES = {
    JOINT_STATES: JOINT_STATE,
    CHAMBER_PRESSURES: JOINT_STATE,
    VALVE_COMMAND: JOINT_STATE,
    VALVE_STATE: JOINT_STATE,
    JOINT_REFERENCE: JOINT_STATE,
    TIP_REFERENCE: POINT_STAMPED,
    OIL_TEMPERATURE: TEMPERATURE,
}
#: A valve topic with stamps of its own meets less than this share of the cycles, by chance.
_MATCHED = 0.5
#: A lockstep repeats messages now and then, and a command may have changed by then; more of them
#: is a fault of what recorded.
_FEW_REPEATED = 0.01


@dataclass(frozen=True, slots=True)
class Decoded:
    """What could be decoded of a topic.

    Attributes
    ----------
    message_type : str
    count : int
    names : tuple of str
        Of a JointState topic.
    wrong : str
        Why a message could not be; empty where all were.
    """

    message_type: str
    count: int
    names: tuple[str, ...]
    wrong: str = ""


def check_topics(
    path: Path, there: Mapping[str, TopicInfo], decoded: Mapping[str, Decoded], robot: Robot
) -> None:
    """See that a bag is one of this robot's.

    Parameters
    ----------
    path : Path
        For messages.
    there : mapping of str to TopicInfo
        Every topic met.
    decoded : mapping of str to Decoded
    robot : Robot

    Raises
    ------
    BagError
        A topic of another type; none of the messages of `/joint_states` can be read; none of the
        robot's joints in it.
    NoCyclesError
        No `/joint_states`.
    """
    for name, wanted in TYPES.items():
        found = decoded[name].message_type if name in decoded else wanted
        if name in there and name not in decoded:
            found = there[name].message_type
        if found != wanted:
            raise BagError(f"{path}: expected {wanted} on {name}, found {found}")
        if name in there and name not in decoded:
            raise BagError(f"{path}: {name}: expected messages in CDR, found none that is read")
    joints = decoded.get(JOINT_STATES)
    if joints is not None and not joints.count and joints.wrong:
        raise BagError(
            f"{path}: {JOINT_STATES}: expected messages that can be decoded, found none; the"
            f" first: {joints.wrong}"
        )
    if joints is None or not joints.count:
        found = ", ".join(name for name in there if name != JOINT_STATES) or "no message of it"
        raise NoCyclesError(
            f"{path}: expected a topic {JOINT_STATES}, found {found}", f"no {JOINT_STATES}"
        )
    if not own_names(robot).intersection(joints.names):
        raise BagError(
            f"{path}: expected joints of robot {robot.name}"
            f" ({', '.join(robot.joint_names)}) in {JOINT_STATES},"
            f" found {', '.join(joints.names) or 'no names'}"
        )


def nothing_in_common(path: Path) -> NoCyclesError:
    """The error of a bag that `grid_of` finds no cycle in."""
    return NoCyclesError(
        f"{path}: expected {CHAMBER_PRESSURES} with the stamps of {JOINT_STATES},"
        " found none in common",
        f"no stamp of {CHAMBER_PRESSURES} is one of {JOINT_STATES}",
    )


def topics_of(series: Mapping[str, Series], robot: Robot) -> dict[str, Topic]:
    """The topics of a recording that have messages, in order of their stamps."""
    found = {name: series[name] for name in TYPES if name in series}
    if JOINT_STATES in found:
        found[JOINT_STATES] = own_joints(found[JOINT_STATES], robot)
    return {name: Topic.of(one) for name, one in found.items() if len(one)}


def own_names(robot: Robot) -> frozenset[str]:
    """What `/joint_states` calls the robot's joints and strokes."""
    return frozenset({*robot.joint_names, *(cylinder.name for cylinder in robot.cylinders)})


def own_joints(series: Series, robot: Robot, *, others_tell: bool = False) -> Series:
    """Messages of `/joint_states` that tell of the robot: a gripper's make no cycles of it.

    All of them where none does.

    Parameters
    ----------
    series : Series
    robot : Robot
    others_tell : bool
        Messages of the topic that are not among these tell of the robot: where none of these
        does, none stays.
    """
    own = own_names(robot)
    if own.issuperset(series.names):
        return series
    told = series.tells_of(own)
    if told.all() or not (others_tell or told.any()):
        return series
    fields = {name: values[told] for name, values in series.fields.items()}
    return replace(
        series, stamp_ns=series.stamp_ns[told], log_ns=series.log_ns[told], fields=fields
    )


def grid_of(topics: Mapping[str, Topic]) -> IntArray:
    """Stamps of the cycles, (N,), from topics of which `/joint_states` is one."""
    stamps = topics[JOINT_STATES].stamp_ns
    if CHAMBER_PRESSURES not in topics:
        return stamps
    pressures = topics[CHAMBER_PRESSURES].stamp_ns
    return np.intersect1d(stamps, pressures, assume_unique=True)


def unused_messages(periods_s: Mapping[str, float], period_s: float) -> dict[str, str]:
    """In words, topics whose messages make no cycle but one in some, as the other comes slower.

    Parameters
    ----------
    periods_s : mapping of str to float
        Usual interval by topic.
    period_s : float
        That of the cycles.

    Returns
    -------
    dict of str to str
        By topic.
    """
    told = {}
    for name, other in (
        (JOINT_STATES, CHAMBER_PRESSURES),
        (CHAMBER_PRESSURES, JOINT_STATES),
    ):
        times = round(period_s / periods_s[name]) if {name, other} <= periods_s.keys() else 1
        if times > 1:
            told[name] = (
                f"only one message in {times} is used: with the others comes no {other} of the"
                " same stamp"
            )
    return told


def columns_of(grid: IntArray, topics: Mapping[str, Topic], robot: Robot) -> dict[str, Any]:
    """The columns of a `Recording` by the names of its fields, and `state_v`.

    Parameters
    ----------
    grid : (N,) int64 array
    topics : mapping of str to Topic
    robot : Robot

    Returns
    -------
    dict
        `state_v` are the voltages that `/valve_state` tells, (N, m) array or None.
    """
    return {
        **_joint_columns(grid, topics, robot),
        **_pressure_columns(grid, topics.get(CHAMBER_PRESSURES), robot),
        **valve_columns(grid, topics.get(VALVE_STATE), topics.get(VALVE_COMMAND), robot),
        **_reference_columns(grid, topics, robot),
    }


def _joint_columns(grid: IntArray, topics: Mapping[str, Topic], robot: Robot) -> dict[str, Any]:
    joints = topics.get(JOINT_STATES)
    q = join(grid, joints, robot.joint_names, "position")
    return {
        "q": q if q is not None else np.full((len(grid), robot.dof), np.nan),
        "stroke": join(grid, joints, _stroke_names(robot), "position"),
        "effort": join(grid, joints, robot.joint_names, "effort"),
    }


def _stroke_names(robot: Robot) -> list[str]:
    """Entries of strokes; under a name that a joint has, too, stands the joint's position."""
    names = [cylinder.name for cylinder in robot.cylinders]
    return [name if name not in robot.joint_names else "" for name in names]


def fill_angles(
    columns: dict[str, Any], robot: Robot, read: Collection[str] = ()
) -> tuple[int, ...]:
    """Fill joint positions that were not recorded from stroke sensors.

    Strokes at which the triangle of eq. 16 does not close give no angle.

    Parameters
    ----------
    columns : dict
        Of `columns_of`; `q` changes.
    robot : Robot
    read : collection of str
        Joints that have readings of their own in other cycles.

    Returns
    -------
    tuple of int
        The cylinders that an angle is from.
    """
    q, strokes, filled = columns["q"], columns["stroke"], []
    for i, cylinder in enumerate(robot.cylinders if strokes is not None else ()):
        at = robot.joint_index(cylinder.joint)
        x = strokes[:, i]
        possible = np.isfinite(x)
        if cylinder.l1_m != 0.0:
            length = x + cylinder.x0_m
            possible &= length >= abs(cylinder.l1_m - cylinder.l2_m)
            possible &= length <= cylinder.l1_m + cylinder.l2_m
        own = cylinder.joint in read or np.isfinite(q[:, at]).any()
        if own or not possible.any():
            continue
        joint = robot.joints[at]
        middle = 0.5 * (joint.lower + joint.upper)
        q[possible, at] = joint_position(cylinder, x[possible], middle)
        filled.append(i)
    return tuple(filled)


def filled_notes(robot: Robot, filled: Collection[int]) -> list[str]:
    """In words, which angles are from stroke sensors; `filled` of `fill_angles`."""
    chosen = [robot.cylinders[i] for i in sorted(filled)]
    return [f"position of {c.joint} from the stroke of {c.name}" for c in chosen]


def _pressure_columns(grid: IntArray, pressures: Topic | None, robot: Robot) -> dict[str, Any]:
    """Absolute on the topic, gauge from here on: the one place of this conversion."""

    def gauge(names: list[str]) -> FloatArray | None:
        values = join(grid, pressures, names, "effort")
        return None if values is None else values - robot.atmospheric_pressure_pa

    supply, tank = gauge(["supply"]), gauge(["tank"])
    return {
        "p_a": gauge([f"{c.name}/a" for c in robot.cylinders]),
        "p_b": gauge([f"{c.name}/b" for c in robot.cylinders]),
        "supply": None if supply is None else supply[:, 0],
        "tank": None if tank is None else tank[:, 0],
    }


def _reference_columns(
    grid: IntArray, topics: Mapping[str, Topic], robot: Robot
) -> dict[str, Any]:
    names, reference = robot.joint_names, topics.get(JOINT_REFERENCE)
    return {
        "q_ref": join(grid, reference, names, "position"),
        "qd_ref": join(grid, reference, names, "velocity"),
        "force_ref": join(grid, reference, names, "effort"),
        "tip_ref": join(grid, topics.get(TIP_REFERENCE), None, "point"),
    }


def valve_topic(source: str, there: Collection[str]) -> str:
    """The topic that stamps of valves are judged by; empty where there is none.

    Parameters
    ----------
    source : str
        As of `Recording`.
    there : collection of str
        Topics that have messages.
    """
    return next((t for t in (source, VALVE_STATE, VALVE_COMMAND) if t in there), "")


@dataclass(slots=True)
class Meetings:
    """How many stamps of a topic of valves are those of cycles, which come stretch by stretch."""

    _matched: int = 0
    _within: int = 0
    #: Stamps since the last cycle: they count once there is another.
    _behind: int = 0
    _begun: bool = False

    def add(self, cycle_ns: IntArray, stamp_ns: IntArray) -> None:
        """Take in the cycles and the stamps of a stretch, both increasing."""
        if not len(cycle_ns):
            self._behind += len(stamp_ns) if self._begun else 0
            return
        first = 0 if self._begun else int(np.searchsorted(stamp_ns, cycle_ns[0]))
        end = int(np.searchsorted(stamp_ns, cycle_ns[-1], side="right"))
        self._within += self._behind + end - first
        self._behind, self._begun = len(stamp_ns) - end, True
        self._matched += int(np.isin(stamp_ns, cycle_ns, assume_unique=True).sum())

    def wrong(self, topic: str, cycles: int) -> str:
        """What is wrong with the stamps of `topic`; empty where they are the cycles'."""
        # Slower cycles leave messages over, a slower topic cycles: stamps of their own do both.
        if self._matched >= _MATCHED * min(self._within, cycles) > 0.0:
            return ""
        how, mend = "hardly a" if self._matched else "no", f"with the stamps of {JOINT_STATES}"
        return f"{how} stamp of {topic} is that of a cycle: record {topic} {mend}"


def irregular(repeats: Mapping[str, Repeats]) -> list[str]:
    """In words, topics with messages out of order or of stamps that had been there before.

    An oil temperature that comes again is no fault.

    Parameters
    ----------
    repeats : mapping of str to Repeats
        By topic.
    """
    told = []
    for name, one in repeats.items():
        if one.disordered:
            text = "messages with a stamp older than the one before"
            told.append(f"{name}: {one.disordered} {text}")
        few = _FEW_REPEATED * one.messages
        if one.contradicted > few:
            told.append(
                f"{name}: {one.contradicted} of {one.messages} messages tell another value of what"
                " a message of the same stamp had told: the first holds"
            )
        # A slow sensor's driver may send its last reading again until there is another.
        if one.duplicates > few and name != OIL_TEMPERATURE:
            told.append(
                f"{name}: {one.duplicates} of {one.messages} messages left out: their stamps had"
                " been there before"
            )
    return told
