"""A bag as aligned arrays: what identification, tracking and diagnosis start from.

The grid is that of the recorded cycles: the stamps that `/joint_states` and, where it was
recorded, `/chamber_pressures` have in common. Every other topic is joined to it by stamp.
Nothing is resampled or filled in: a cycle that is not there is a gap.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.bag.channels import find_losses
from hydro_ident.bag.dead_sensors import without_dead
from hydro_ident.bag.gaps import find_gaps, usual_period_s
from hydro_ident.bag.grid import Topic, join
from hydro_ident.bag.latches import latched_cycles
from hydro_ident.bag.reader import Bag, read_bag
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.series import Series
from hydro_ident.errors import BagError
from hydro_model.cylinder import joint_position
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import JOINT_STATE, POINT_STAMPED, TEMPERATURE, FloatArray, IntArray
from hydro_msgs_docs.topics import (
    CHAMBER_PRESSURES,
    DIAGNOSTICS,
    JOINT_REFERENCE,
    JOINT_STATES,
    OIL_TEMPERATURE,
    TIP_REFERENCE,
    VALVE_COMMAND,
    VALVE_STATE,
)

_TYPES = {
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
#: What `read_bag` has to decode for `recording_of`.
RECORDING_TOPICS = (*_TYPES, DIAGNOSTICS)

__all__ = ["RECORDING_TOPICS", "Recording", "read_recording", "recording_of"]


def read_recording(path: str | Path, robot: Robot) -> Recording:
    """Read a bag onto the grid of its cycles.

    Parameters
    ----------
    path : str or Path
        rosbag2 directory or MCAP file.
    robot : Robot

    Returns
    -------
    Recording

    Raises
    ------
    BagError
        No bag; no `/joint_states`; none of the robot's joints in it; no cycle that
        `/joint_states` and `/chamber_pressures` share.
    """
    return recording_of(read_bag(path, RECORDING_TOPICS), robot)


@dataclass(frozen=True, slots=True)
class Earlier:
    """What earlier pieces of a bag told that holds for those that follow.

    Attributes
    ----------
    rails : frozenset of str
        Supply and tank, where they were recorded: no constant takes their place from then on.
    dead : mapping of str to float
        As of `Recording`.
    """

    rails: frozenset[str] = frozenset()
    dead: Mapping[str, float] = field(default_factory=dict)

    def after(self, recording: Recording) -> Earlier:
        """With what one more piece told."""
        told = {rail for rail in ("supply", "tank") if getattr(recording, rail) is not None}
        return Earlier(self.rails | told, recording.dead)


def recording_of(bag: Bag, robot: Robot, earlier: Earlier | None = None) -> Recording:
    """As `read_recording`, from a bag that was read already; a piece of one after `earlier`."""
    earlier = earlier or Earlier()
    topics = {name: _topic(bag, name) for name in _TYPES}
    joints, pressures = topics[JOINT_STATES], topics[CHAMBER_PRESSURES]
    if joints is None:
        there = ", ".join(bag.topics)
        raise BagError(f"{bag.path}: expected a topic {JOINT_STATES}, found {there}")
    _check_robot(bag, joints.series, robot)
    grid = _grid(bag, joints, pressures)
    period_s = _period_s(grid, robot)
    temperature = topics[OIL_TEMPERATURE]
    joint_columns = _joint_columns(grid, joints, robot)
    notes = _angles_from_strokes(joint_columns, robot)
    recording = Recording(
        path=bag.path,
        robot=robot,
        stamp_ns=grid,
        period_s=period_s,
        **joint_columns,
        **_pressure_columns(grid, pressures, robot),
        **_valve_columns(grid, topics[VALVE_STATE], topics[VALVE_COMMAND], robot),
        **_reference_columns(grid, topics[JOINT_REFERENCE], topics[TIP_REFERENCE], robot),
        temperature_stamp_ns=None if temperature is None else temperature.stamp_ns,
        temperature_c=None if temperature is None else temperature.values("temperature")[:, 0],
        losses=(),
        gaps=find_gaps(grid, period_s),
        duplicates={n: t.duplicates for n, t in topics.items() if t is not None and t.duplicates},
        notes=(*bag.losses, *bag.unchecked, *_irregular(topics), *notes),
        metadata=bag.metadata,
    )
    silent = [rail for rail in earlier.rails if getattr(recording, rail) is None]
    lost: dict[str, Any] = {rail: np.full(len(grid), np.nan) for rail in silent}
    valves = topics.get(recording.valve_source) or topics[VALVE_STATE] or topics[VALVE_COMMAND]
    stamps = _valve_stamps(recording, valves)
    return _with_losses(without_dead(replace(recording, **lost), earlier.dead), stamps)


def _joint_columns(grid: IntArray, joints: Topic, robot: Robot) -> dict[str, Any]:
    q = join(grid, joints, robot.joint_names, "position")
    return {
        "q": q if q is not None else np.full((len(grid), robot.dof), np.nan),
        "stroke": join(grid, joints, [c.name for c in robot.cylinders], "position"),
        "effort": join(grid, joints, robot.joint_names, "effort"),
    }


def _angles_from_strokes(columns: dict[str, Any], robot: Robot) -> list[str]:
    """Fill joint positions that were not recorded from stroke sensors; says which.

    Strokes at which the triangle of eq. 16 does not close give no angle.
    """
    q, strokes, notes = columns["q"], columns["stroke"], []
    for i, cylinder in enumerate(robot.cylinders if strokes is not None else ()):
        at = robot.joint_index(cylinder.joint)
        x = strokes[:, i]
        possible = np.isfinite(x)
        if cylinder.l1_m != 0.0:
            length = x + cylinder.x0_m
            possible &= length >= abs(cylinder.l1_m - cylinder.l2_m)
            possible &= length <= cylinder.l1_m + cylinder.l2_m
        if np.isfinite(q[:, at]).any() or not possible.any():
            continue
        joint = robot.joints[at]
        middle = 0.5 * (joint.lower + joint.upper)
        q[possible, at] = joint_position(cylinder, x[possible], middle)
        notes.append(f"position of {joint.name} from the stroke of {cylinder.name}")
    return notes


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


def _valve_columns(
    grid: IntArray, state: Topic | None, command: Topic | None, robot: Robot
) -> dict[str, Any]:
    state_v, command_v = (join(grid, t, robot.valve_names, "effort") for t in (state, command))
    applied = state_v if state_v is not None else command_v
    source = VALVE_STATE if state_v is not None else VALVE_COMMAND
    return {
        "valve_v": applied,
        "valve_source": source if applied is not None else "",
        "command_v": command_v,
        "spool": join(grid, state, robot.valve_names, "position"),
        "latched": latched_cycles(len(grid), state_v, command_v),
    }


def _valve_stamps(recording: Recording, valves: Topic | None) -> str:
    """What is wrong with the stamps of the valves' topic; empty where they are the cycles'."""
    if valves is None:
        return ""
    stamps, cycles = valves.stamp_ns, recording.stamp_ns
    stamps = stamps[(stamps >= cycles[0]) & (stamps <= cycles[-1])]
    matched = int(np.isin(stamps, cycles, assume_unique=True).sum())
    # Slower cycles leave messages over, a slower topic cycles: stamps of their own do both.
    if matched >= _MATCHED * min(len(stamps), len(cycles)) > 0.0:
        return ""
    name, how = valves.series.topic, "hardly a" if matched else "no"
    mend = f"record {name} with the stamps of {JOINT_STATES}"
    return f"{how} stamp of {name} is that of a cycle: {mend}"


def _reference_columns(
    grid: IntArray, reference: Topic | None, tip: Topic | None, robot: Robot
) -> dict[str, Any]:
    names = robot.joint_names
    return {
        "q_ref": join(grid, reference, names, "position"),
        "qd_ref": join(grid, reference, names, "velocity"),
        "force_ref": join(grid, reference, names, "effort"),
        "tip_ref": join(grid, tip, None, "point"),
    }


def _with_losses(recording: Recording, valve_stamps: str) -> Recording:
    return replace(
        recording,
        losses=find_losses(
            recording.robot,
            q=recording.q,
            stroke=recording.stroke,
            effort=recording.effort,
            chambers=(recording.p_a, recording.p_b),
            sources=(recording.supply, recording.tank),
            valve_v=recording.valve_v,
            valve_source=recording.valve_source,
            valve_stamps=valve_stamps,
            period_s=recording.period_s,
            dead=recording.dead,
        ),
    )


def _topic(bag: Bag, name: str) -> Topic | None:
    series = bag.series.get(name)
    if series is not None and series.message_type != _TYPES[name]:
        raise BagError(
            f"{bag.path}: expected {_TYPES[name]} on {name}, found {series.message_type}"
        )
    if series is None and name in bag.topics:
        found = bag.topics[name].message_type
        raise BagError(f"{bag.path}: expected {_TYPES[name]} on {name}, found {found}")
    return None if series is None or not len(series) else Topic.of(series)


def _check_robot(bag: Bag, joints: Series, robot: Robot) -> None:
    strokes = {cylinder.name for cylinder in robot.cylinders}
    if not set(joints.names) & (set(robot.joint_names) | strokes):
        raise BagError(
            f"{bag.path}: expected joints of robot {robot.name}"
            f" ({', '.join(robot.joint_names)}) in {JOINT_STATES},"
            f" found {', '.join(joints.names) or 'no names'}"
        )


def _grid(bag: Bag, joints: Topic, pressures: Topic | None) -> IntArray:
    if pressures is None:
        return joints.stamp_ns
    grid = np.intersect1d(joints.stamp_ns, pressures.stamp_ns, assume_unique=True)
    if not len(grid):
        raise BagError(
            f"{bag.path}: expected {CHAMBER_PRESSURES} with the stamps of {JOINT_STATES},"
            " found none in common"
        )
    return grid


def _period_s(stamp_ns: IntArray, robot: Robot) -> float:
    if len(stamp_ns) < 2:
        return 1.0 / robot.sensors.rate_hz
    return usual_period_s(stamp_ns)


def _irregular(topics: Mapping[str, Topic | None]) -> list[str]:
    return [
        f"{name}: {topic.disordered} messages with a stamp older than the one before"
        for name, topic in topics.items()
        if topic is not None and topic.disordered
    ]
