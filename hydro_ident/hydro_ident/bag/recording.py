"""A bag as aligned arrays: what identification, tracking and diagnosis start from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.bag.aligned import (
    TYPES,
    Decoded,
    Meetings,
    check_topics,
    columns_of,
    fill_angles,
    filled_notes,
    grid_of,
    irregular,
    nothing_in_common,
    topics_of,
    unused_messages,
    valve_topic,
)
from hydro_ident.bag.channels import Present, find_losses
from hydro_ident.bag.dead_sensors import without_dead
from hydro_ident.bag.ends import Ends
from hydro_ident.bag.gaps import find_gaps, usual_period_s
from hydro_ident.bag.grid import Repeats, Topic
from hydro_ident.bag.latches import latched_cycles
from hydro_ident.bag.rails import Silence
from hydro_ident.bag.reader import Bag, read_bag
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.turns import Turns, nearest_turn, turn_notes, without_turns
from hydro_ident.bag.valve_columns import (
    ValveRates,
    commanded_notes,
    fill_voltages,
    told_valves,
    use_voltages,
)
from hydro_model.arrays import FloatArray, IntArray
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import DIAGNOSTICS, OIL_TEMPERATURE, VALVE_COMMAND, VALVE_STATE

#: What `read_bag` has to decode for `recording_of`.
RECORDING_TOPICS = (*TYPES, DIAGNOSTICS)

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
    turns : mapping of str to (K, 2) int array
        As of `Recording`.
    valves : frozenset of str
        Those that `/valve_state` told: no command takes its place from then on.
    repeats : mapping of str to Repeats
        By topic, of messages that were put in order already.
    rates : ValveRates
    ends : Ends
    complete_ns : int or None
        Stamp up to which every message of the piece to come is there; None for all of it.
    """

    rails: frozenset[str] = frozenset()
    dead: Mapping[str, float] = field(default_factory=dict)
    turns: Turns = field(default_factory=dict)
    valves: frozenset[str] = frozenset()
    repeats: Mapping[str, Repeats] = field(default_factory=dict)
    rates: ValveRates = field(default_factory=ValveRates)
    ends: Ends = field(default_factory=Ends)
    complete_ns: int | None = None

    def after(self, recording: Recording) -> Earlier:
        """With what one more piece told."""
        told = {rail for rail in ("supply", "tank") if getattr(recording, rail) is not None}
        valves = frozenset(recording.robot.valve_names[k] for k in recording.told)
        if recording.valve_source != VALVE_STATE:
            valves = self.valves
        rails = self.rails | told
        return replace(
            self,
            rails=rails,
            dead=recording.dead,
            turns=recording.turns,
            valves=valves,
            rates=recording.valve_rates,
            ends=recording.ends,
        )


def recording_of(bag: Bag, robot: Robot, earlier: Earlier | None = None) -> Recording:
    """As `read_recording`, from a bag that was read already; a piece of one after `earlier`."""
    earlier = earlier or Earlier()
    decoded = {
        name: Decoded(t.message_type, len(t), t.names, t.malformed_why)
        for name, t in bag.series.items()
    }
    check_topics(bag.path, bag.topics, decoded, robot)
    topics = topics_of(bag.series, robot)
    repeats = {n: earlier.repeats.get(n) or t.repeats for n, t in topics.items()}
    grid = grid_of(topics)
    if not len(grid):
        raise nothing_in_common(bag.path)
    period_s = _period_s(grid, robot)
    ends = earlier.ends.then(grid, topics)
    apart = ends.told(period_s, complete=earlier.complete_ns is None)
    temperature = topics.get(OIL_TEMPERATURE)
    columns = columns_of(grid, topics, robot)
    columns["q"], turns = without_turns(robot, grid, columns["q"], earlier.turns)
    columns["q_ref"] = nearest_turn(robot, columns["q"], columns["q_ref"], turns)
    filled = fill_angles(columns, robot)
    noted = _settle_voltages(columns, grid, robot, earlier)
    recording = Recording(
        path=bag.path,
        robot=robot,
        stamp_ns=grid,
        period_s=period_s,
        **columns,
        temperature_stamp_ns=None if temperature is None else temperature.stamp_ns,
        temperature_c=None if temperature is None else temperature.values("temperature")[:, 0],
        losses=(),
        gaps=find_gaps(grid, period_s),
        duplicates={n: one.duplicates for n, one in repeats.items() if one.duplicates},
        notes=(
            *bag.losses,
            *bag.unchecked,
            *irregular(repeats),
            *_unused(topics, grid, period_s),
            *(f"{name}: {text}" for name, text in apart),
            *filled_notes(robot, filled),
            *turn_notes(turns),
            *noted,
        ),
        metadata=bag.metadata,
        turns=turns,
        ends=ends,
    )
    silent = [rail for rail in earlier.rails if getattr(recording, rail) is None]
    lost: dict[str, Any] = {rail: np.full(len(grid), np.nan) for rail in silent}
    valves = valve_topic(recording.valve_source, topics)
    stamps = ""
    if valves:
        met = Meetings()
        met.add(grid, topics[valves].stamp_ns)
        stamps = met.wrong(valves, len(grid))
    return with_losses(without_dead(replace(recording, **lost), earlier.dead), valves, stamps)


def _unused(topics: Mapping[str, Topic], grid: IntArray, period_s: float) -> list[str]:
    """Messages that make no cycle, as another topic comes slower; of a lone cycle nothing."""
    if len(grid) < 2:
        return []
    periods_s = {n: usual_period_s(t.stamp_ns) for n, t in topics.items() if len(t.stamp_ns) > 1}
    return [f"{name}: {text}" for name, text in unused_messages(periods_s, period_s).items()]


def _settle_voltages(
    columns: dict[str, Any], grid: IntArray, robot: Robot, earlier: Earlier
) -> list[str]:
    """Choose and hold the voltages of valves, with what follows from them; returns notes."""
    recorded = columns.pop("state_v"), columns["command_v"]
    rates = earlier.rates.after(*recorded, grid, earlier.complete_ns)
    state_v = rates.held(VALVE_STATE, recorded[0], grid)
    command_v = rates.held(VALVE_COMMAND, recorded[1], grid)
    use_voltages(columns, state_v, command_v, rates)
    valves = earlier.valves | told_valves(robot, state_v)
    commanded = fill_voltages(columns, robot, valves, command_v)
    told = [k for k, name in enumerate(robot.valve_names) if name in valves]
    latched = latched_cycles(len(grid), *(_some(v, told) for v in (state_v, command_v)))
    columns |= {"latched": latched, "commanded": commanded, "valve_rates": rates}
    known = told_valves(robot, columns["valve_v"])
    return [*commanded_notes(commanded, known), *rates.notes(columns["valve_source"])]


def _some(values: FloatArray | None, columns: list[int]) -> FloatArray | None:
    return None if values is None else values[:, columns]


def with_losses(recording: Recording, valve_there: str, valve_stamps: str) -> Recording:
    """A recording with the channels that it cannot give.

    Parameters
    ----------
    recording : Recording
    valve_there : str
        A topic of valves that has messages, be they of voltages or not; or empty.
    valve_stamps : str
        What is wrong with the stamps of the valves' topic.
    """
    losses = find_losses(
        recording.robot,
        _present(recording),
        valve_source=recording.valve_source,
        valve_there=valve_there,
        valve_stamps=valve_stamps,
        dead=recording.dead,
    )
    return replace(recording, losses=losses)


def _present(recording: Recording) -> Present:
    def there(values: FloatArray | None) -> list[bool] | None:
        return None if values is None else [not bool(np.isnan(v).all()) for v in values.T]

    def silent_s(values: FloatArray | None) -> float | None:
        if values is None:
            return None
        silence = Silence()
        silence.add(values)
        return silence.longest_s(recording.period_s)

    return Present(
        q=there(recording.q) or [],
        stroke=there(recording.stroke),
        effort=there(recording.effort),
        chambers=(there(recording.p_a), there(recording.p_b)),
        silent_s=(silent_s(recording.supply), silent_s(recording.tank)),
        valve_v=there(recording.valve_v),
    )


def _period_s(stamp_ns: IntArray, robot: Robot) -> float:
    if len(stamp_ns) < 2:
        return 1.0 / robot.sensors.rate_hz
    return usual_period_s(stamp_ns)
