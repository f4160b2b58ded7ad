"""Voltages at the valves: as applied where that was recorded, else as commanded.

A controller that is slower than the sensors, or sends changes alone, tells a voltage in some
cycles only. The amplifiers hold it until the next one, and so do the columns, for a while.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from hydro_ident.bag.grid import BoolArray, Topic, join
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import FloatArray, IntArray
from hydro_msgs_docs.topics import VALVE_COMMAND, VALVE_STATE

#: A topic without a voltage in more than a fifth of the cycles, long pauses apart, is sparse, and
#: no longer one that lost a message: what was sent meanwhile is nothing.
_DENSE = 0.8
#: Flows miss no more than windows here and there.
_WHOLE = 0.95
#: Where `/valve_state` tells less than this of what happens, a denser `/valve_command` tells more.
_MOST = 0.5
#: Longest time that a voltage is held: who is silent for longer may have stopped.
HELD_S = 0.1


@dataclass(frozen=True, slots=True)
class ValveRates:
    """How often the topics of valves tell voltages; what earlier pieces of a bag told goes on.

    Attributes
    ----------
    sparse : frozenset of str
        Topics without a voltage in many of the cycles.
    demoted : bool
        Voltages are from `/valve_command`, though `/valve_state` tells some.
    """

    sparse: frozenset[str] = frozenset()
    demoted: bool = False

    def after(
        self, state_v: FloatArray | None, command_v: FloatArray | None, grid: IntArray
    ) -> ValveRates:
        """With what one more piece tells.

        Parameters
        ----------
        state_v, command_v : (N, m) array or None
            As recorded.
        grid : (N,) int64 array
        """
        topics = ((VALVE_STATE, state_v), (VALVE_COMMAND, command_v))
        found = {topic for topic, values in topics if 0.0 < _density(values, grid) < _DENSE}
        demoted = 0.0 < _share(state_v) < min(_MOST, _share(command_v))
        return ValveRates(self.sparse | found, self.demoted or demoted)

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

    def notes(
        self,
        state_v: FloatArray | None,
        command_v: FloatArray | None,
        source: str,
        valve_v: FloatArray | None,
    ) -> list[str]:
        """In words, what was held and what it is taken from.

        Parameters
        ----------
        state_v, command_v : (N, m) array or None
            As recorded.
        source, valve_v
            Of the `Recording`.
        """
        state, command = _share(state_v), _share(command_v)
        told = []
        if self.demoted and source == VALVE_COMMAND:
            told.append(
                f"{VALVE_STATE} tells voltages in {state:.0%} of the cycles, {VALVE_COMMAND} in"
                f" {command:.0%}: the commands are taken"
            )
        if source in self.sparse:
            left = 1.0 - _share(valve_v)
            without = f"; {left:.0%} of the cycles stay without" if left > 1.0 - _DENSE else ""
            told.append(
                f"{source} tells voltages in {state if source == VALVE_STATE else command:.0%} of"
                f" the cycles: each is held until the next, for up to {HELD_S:g} s{without}"
            )
        elif 0.0 < _share(valve_v) < _WHOLE:
            told.append(
                f"{source} tells voltages in {_share(valve_v):.0%} of the cycles: windows of flows"
                " that touch the others are left out"
            )
        return told


def _reached(known: BoolArray, grid: IntArray) -> tuple[IntArray, BoolArray]:
    """The last cycle with a voltage, and whether it is held until here; of (N, m) masks alike."""
    rows = np.arange(len(grid))[:, None]
    last = np.maximum.accumulate(np.where(known, rows, -1), axis=0)
    from_ns = grid[np.maximum(last, 0)]
    reached = (last >= 0) & (grid[:, None] - from_ns <= round(HELD_S * 1e9))
    return np.maximum(last, 0), reached


def _density(values: FloatArray | None, grid: IntArray) -> float:
    """Share of the cycles with a voltage among those that one could be held in; 0 for none."""
    if values is None or not np.isfinite(values).any():
        return 0.0
    known = np.asarray(np.isfinite(values).any(axis=1, keepdims=True), dtype=np.bool_)
    return float(known.sum() / _reached(known, grid)[1].sum())


def _share(values: FloatArray | None) -> float:
    """Share of the cycles from the first voltage to the last in which there is one; 0 for none."""
    if values is None or not np.isfinite(values).any():
        return 0.0
    known = np.flatnonzero(np.isfinite(values).any(axis=1))
    return len(known) / int(known[-1] - known[0] + 1)


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


def commanded_notes(commanded: Collection[str]) -> list[str]:
    """In words, which valves' voltages are their commands; `commanded` of `fill_voltages`."""
    return [
        f"no {valve} in {VALVE_STATE}: its voltage is what {VALVE_COMMAND} tells"
        for valve in commanded
    ]
