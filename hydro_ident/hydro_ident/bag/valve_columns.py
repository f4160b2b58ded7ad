"""Voltages at the valves: as applied where that was recorded, else as commanded.

A controller that is slower than the sensors, or sends changes alone, tells a voltage in some
cycles only. The amplifiers hold it until the next one, and so do the columns, for a while.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro_ident.bag.grid import Topic, join
from hydro_model.arrays import BoolArray, FloatArray, IntArray
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import VALVE_COMMAND, VALVE_STATE

#: Of a dense topic more voltages than this are one cycle behind the one before; even updates in
#: four cycles of five have so many. What is seldom further behind lost messages, or paused: what
#: was sent meanwhile is nothing.
_DENSE = 0.75
#: Of the cycles of a sparse topic more without a voltage than this are said.
_WITHOUT = 0.2
#: Flows miss no more than windows here and there.
_WHOLE = 0.95
#: Where `/valve_state` tells less than this of what happens, a denser `/valve_command` tells more.
_MOST = 0.5
#: Longest time that a voltage is held: who is silent for longer may have stopped.
HELD_S = 0.1


@dataclass(frozen=True, slots=True)
class Voltages:
    """In which cycles of a recording a topic tells voltages.

    Attributes
    ----------
    cycles : int
        Of the recording.
    told, reached : int
        Cycles with a voltage, and those in which there is one where each is held.
    next_on : int
        Those with a voltage whose last cycle has one too.
    first, last : int
        Numbers of the first and the last cycle with a voltage; below 0 for none.
    """

    cycles: int = 0
    told: int = 0
    reached: int = 0
    next_on: int = 0
    first: int = -1
    last: int = -1

    def after(self, values: FloatArray | None, grid: IntArray, fresh: slice) -> Voltages:
        """With some more cycles.

        Parameters
        ----------
        values : (N, m) array or None
            As recorded.
        grid : (N,) int64 array
        fresh : slice
            The cycles of these that come new.
        """
        cycles = self.cycles + fresh.stop - fresh.start
        if values is None:
            return replace(self, cycles=cycles)
        known = np.asarray(np.isfinite(values).any(axis=1, keepdims=True), dtype=np.bool_)
        rows = self.cycles + np.flatnonzero(known[fresh])
        reached = self.reached + int(_reached(known, grid)[1][fresh].sum())
        if not len(rows):
            return replace(self, cycles=cycles, reached=reached)
        before = [] if self.first < 0 else [self.last]
        return Voltages(
            cycles=cycles,
            told=self.told + len(rows),
            reached=reached,
            next_on=self.next_on + int(np.sum(np.diff([*before, *rows.tolist()]) == 1)),
            first=int(rows[0]) if self.first < 0 else self.first,
            last=int(rows[-1]),
        )

    @property
    def sparse(self) -> bool:
        """The usual voltage is more than a cycle behind the one before."""
        return self.told > 1 and self.next_on < _DENSE * (self.told - 1)

    @property
    def share(self) -> float:
        """Of all cycles those with a voltage; 0 without cycles."""
        return self.told / max(self.cycles, 1)

    @property
    def held_share(self) -> float:
        """As `share`, where each is held."""
        return self.reached / max(self.cycles, 1)

    @property
    def share_within(self) -> float:
        """Share of the cycles from the first voltage to the last; 0 for none."""
        return self.told / (self.last - self.first + 1) if self.told else 0.0


@dataclass(frozen=True, slots=True)
class ValveRates:
    """How often the topics of valves tell voltages; what earlier pieces of a bag told goes on.

    Attributes
    ----------
    state, command : Voltages
        Of `/valve_state` and `/valve_command`, in what was read so far.
    until_ns : int or None
        Stamp of the last cycle of these.
    sparse : frozenset of str
        Topics without a voltage in many of the cycles.
    demoted : bool
        Voltages are from `/valve_command`, though `/valve_state` tells some.
    """

    state: Voltages = Voltages()
    command: Voltages = Voltages()
    until_ns: int | None = None
    sparse: frozenset[str] = frozenset()
    demoted: bool = False

    def after(
        self,
        state_v: FloatArray | None,
        command_v: FloatArray | None,
        grid: IntArray,
        complete_ns: int | None = None,
    ) -> ValveRates:
        """With what one more piece tells.

        Parameters
        ----------
        state_v, command_v : (N, m) array or None
            As recorded.
        grid : (N,) int64 array
        complete_ns : int, optional
            Stamp up to which all voltages are there; default: to the end.
        """
        until = -1 if self.until_ns is None else self.until_ns
        begin = 0 if self.until_ns is None else int(np.searchsorted(grid, until, side="right"))
        end = len(grid)
        if complete_ns is not None:
            end = int(np.searchsorted(grid, complete_ns, side="right"))
        if end <= begin:
            return self
        fresh = slice(begin, end)
        state = self.state.after(state_v, grid, fresh)
        command = self.command.after(command_v, grid, fresh)
        topics = ((VALVE_STATE, state), (VALVE_COMMAND, command))
        found = {topic for topic, voltages in topics if voltages.sparse}
        demoted = 0.0 < state.share < min(_MOST, command.share)
        until = int(grid[end - 1])
        return ValveRates(state, command, until, self.sparse | found, self.demoted or demoted)

    def held(self, topic: str, values: FloatArray | None, grid: IntArray) -> FloatArray | None:
        """Voltages of a sparse topic from their cycle to the next, for `HELD_S` at most.

        Parameters
        ----------
        topic : str
        values : (N, m) array or None
        grid : (N,) int64 array

        Returns
        -------
        (N, m) array or None
            Those of other topics as they are.
        """
        if values is None or topic not in self.sparse:
            return values
        last, reached = _reached(np.isfinite(values), grid)
        return np.where(reached, np.take_along_axis(values, last, axis=0), np.nan)

    def notes(self, source: str) -> list[str]:
        """In words, what was held and what it is taken from.

        Parameters
        ----------
        source : str
            `valve_source` of the `Recording`.
        """
        told = []
        if self.demoted and source == VALVE_COMMAND:
            told.append(
                f"{VALVE_STATE} tells voltages in {self.state.share:.0%} of the cycles,"
                f" {VALVE_COMMAND} in {self.command.share:.0%}: the commands are taken"
            )
        one = self.state if source == VALVE_STATE else self.command
        if source in self.sparse:
            left = 1.0 - one.held_share
            without = f"; {left:.0%} of the cycles stay without" if left > _WITHOUT else ""
            told.append(
                f"{source} tells voltages in {one.share:.0%} of the cycles: each is held until"
                f" the next, for up to {HELD_S:g} s{without}"
            )
        elif source and 0.0 < one.share_within < _WHOLE:
            told.append(
                f"{source} tells voltages in {one.share_within:.0%} of the cycles: windows of"
                " flows that touch the others are left out"
            )
        return told


def _reached(known: BoolArray, grid: IntArray) -> tuple[IntArray, BoolArray]:
    """The last cycle with a voltage, and whether it is held until here; of (N, m) masks alike."""
    rows = np.arange(len(grid))[:, None]
    last = np.maximum.accumulate(np.where(known, rows, -1), axis=0)
    from_ns = grid[np.maximum(last, 0)]
    reached = (last >= 0) & (grid[:, None] - from_ns <= round(HELD_S * 1e9))
    return np.maximum(last, 0), reached


def valve_columns(
    grid: IntArray, state: Topic | None, command: Topic | None, robot: Robot
) -> dict[str, Any]:
    """The columns of valves by the names of the fields of a `Recording`, and `state_v`.

    Parameters
    ----------
    grid : (N,) int64 array
    state, command : Topic or None
        `/valve_state` and `/valve_command`.
    robot : Robot
    """
    state_v, command_v = (join(grid, t, robot.valve_names, "effort") for t in (state, command))
    applied = state_v if state_v is not None else command_v
    source = VALVE_STATE if state_v is not None else VALVE_COMMAND
    return {
        "valve_v": applied,
        "valve_source": source if applied is not None else "",
        "command_v": command_v,
        "spool": join(grid, state, robot.valve_names, "position"),
        "state_v": state_v,
    }


def told_valves(robot: Robot, state_v: FloatArray | None) -> frozenset[str]:
    """The valves whose voltage `/valve_state` tells in some cycle, by name.

    Parameters
    ----------
    robot : Robot
    state_v : (N, m) array or None
        As of `valve_columns`.
    """
    if state_v is None:
        return frozenset()
    there = np.flatnonzero(np.isfinite(state_v).any(axis=0))
    return frozenset(robot.valve_names[k] for k in there)


def use_voltages(
    columns: dict[str, Any],
    state_v: FloatArray | None,
    command_v: FloatArray | None,
    rates: ValveRates,
) -> None:
    """Take voltages as they were held, from the topic that tells most of them.

    Parameters
    ----------
    columns : dict
        Of `columns_of`; `valve_v` and `valve_source` change.
    state_v, command_v : (N, m) array or None
        Held.
    rates : ValveRates
    """
    columns["valve_v"] = state_v if columns["valve_source"] == VALVE_STATE else command_v
    if rates.demoted and command_v is not None:
        columns["valve_v"], columns["valve_source"] = command_v, VALVE_COMMAND


def fill_voltages(
    columns: dict[str, Any], robot: Robot, told: Collection[str], command: FloatArray | None
) -> tuple[str, ...]:
    """Take the commands of valves that `/valve_state` does not tell, where it tells others.

    Parameters
    ----------
    columns : dict
        Of `columns_of`; `valve_v` changes.
    robot : Robot
    told : collection of str
        Valves that `/valve_state` tells in some cycle of the whole recording.
    command : (N, m) array or None
        Voltages of `/valve_command`.

    Returns
    -------
    tuple of str
        The valves that it does not tell; none where it tells nothing at all.
    """
    if columns["valve_source"] != VALVE_STATE:
        return ()
    others = [k for k, name in enumerate(robot.valve_names) if name not in told]
    applied = columns["valve_v"]
    if others and command is not None:
        filled = np.full_like(command, np.nan) if applied is None else applied.copy()
        filled[:, others] = command[:, others]
        columns["valve_v"] = filled
    return tuple(robot.valve_names[k] for k in others)


def commanded_notes(commanded: Collection[str], known: Collection[str]) -> list[str]:
    """In words, of those `commanded` (`fill_voltages`) the valves whose voltage is `known`."""
    told = f"in {VALVE_STATE}: its voltage is what {VALVE_COMMAND} tells"
    return [f"no {valve} {told}" for valve in commanded if valve in known]
