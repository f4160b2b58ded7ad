"""Voltages at the valves: as applied where that was recorded, else as commanded."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from hydro_ident.bag.grid import Topic, join
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import FloatArray, IntArray
from hydro_msgs_docs.topics import VALVE_COMMAND, VALVE_STATE


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


def fill_voltages(columns: dict[str, Any], robot: Robot, told: Collection[str]) -> tuple[str, ...]:
    """Take the commands of valves that `/valve_state` does not tell, where it tells others.

    Parameters
    ----------
    columns : dict
        Of `columns_of`; `valve_v` changes.
    robot : Robot
    told : collection of str
        Valves that `/valve_state` tells in some cycle of the whole recording.

    Returns
    -------
    tuple of str
        The valves that it does not tell; none where it tells nothing at all.
    """
    if columns["valve_source"] != VALVE_STATE:
        return ()
    others = [k for k, name in enumerate(robot.valve_names) if name not in told]
    applied, command = columns["valve_v"], columns["command_v"]
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
