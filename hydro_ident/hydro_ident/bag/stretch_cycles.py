"""Cycles of a stretch of a bag, with what must hold for them to be those of the whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.bag.aligned import (
    TYPES,
    columns_of,
    fill_angles,
    grid_of,
    own_joints,
    own_names,
)
from hydro_ident.bag.ends import Ends
from hydro_ident.bag.grid import Topic
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.series import Series
from hydro_ident.bag.valve_columns import fill_voltages, told_valves
from hydro_ident.errors import BagError
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import (
    CHAMBER_PRESSURES,
    JOINT_STATES,
    OIL_TEMPERATURE,
    VALVE_COMMAND,
    VALVE_STATE,
)


@dataclass(frozen=True, slots=True)
class Known:
    """What is taken for granted of a bag while it is read.

    Attributes
    ----------
    robot : str or None
        The robot that the bag names, "" for none; None until that is known.
    whole : bool
        Its stamps do not let it go by stretches.
    waits : frozenset of str
        Topics that come, though later than others: nothing is joined without them.
    told : bool
        Some message of `/joint_states` tells of the robot.
    read : frozenset of str
        Joints that have a position of their own in some cycle.
    valve_state : bool
        `/valve_state` tells voltages in some cycle.
    valves : frozenset of str
        Valves whose voltage it tells in some cycle.
    """

    robot: str | None = None
    whole: bool = False
    waits: frozenset[str] = frozenset()
    told: bool = False
    read: frozenset[str] = frozenset()
    valve_state: bool = False
    valves: frozenset[str] = frozenset()


class LearntError(BagError):
    """Something taken for granted does not hold: read again.

    Attributes
    ----------
    known : Known
        What holds instead.
    """

    def __init__(self, known: Known) -> None:
        super().__init__(f"expected a bag as begun, found {known}")
        self.known = known


@dataclass(slots=True)
class CycleMaker:
    """Joins the topics of stretches.

    Parameters
    ----------
    path : Path
        Of the bag.
    robot : Robot
    known : Known

    Attributes
    ----------
    filled : dict of str to int
        Joints whose positions are from a stroke, and the cylinder.
    valve_source : str
        The topic that voltages are from so far, or empty.
    bare : bool
        Some cycles were made without `/chamber_pressures`.
    commanded, ends
        As of `Recording`.
    """

    path: Path
    robot: Robot
    known: Known
    filled: dict[str, int] = field(default_factory=dict)
    valve_source: str = ""
    bare: bool = False
    commanded: tuple[str, ...] = ()
    ends: Ends = field(default_factory=Ends)
    _valves: frozenset[str] = frozenset()
    _read: set[str] = field(default_factory=set)
    #: Some message told of the robot; messages that did not were taken for its cycles.
    _told: bool = False
    _others: bool = False

    def cycles(self, given: Mapping[str, Series], *, pressures: bool) -> Recording:
        """The cycles of a stretch.

        Parameters
        ----------
        given : mapping of str to Series
            In order of their stamps, each stamp once.
        pressures : bool
            `/chamber_pressures` is recorded, though it may not be in this stretch.

        Raises
        ------
        LearntError
            Earlier stretches were not what they seemed.
        """
        own = {n: self._own(s) if n == JOINT_STATES else s for n, s in given.items()}
        topics = {
            name: Topic(one, one.stamp_ns, np.arange(len(one)))
            for name, one in own.items()
            if TYPES.get(name) == one.message_type
        }
        grid = np.zeros(0, dtype=np.int64)
        if JOINT_STATES in topics and (CHAMBER_PRESSURES in topics or not pressures):
            grid = grid_of(topics)
        self.ends = self.ends.then(grid, topics)
        self.bare |= bool(len(grid)) and not pressures
        columns = columns_of(grid, topics, self.robot)
        self._choose_valves(columns)
        self._fill(columns)
        oil = topics.get(OIL_TEMPERATURE)
        return Recording(
            path=self.path,
            robot=self.robot,
            stamp_ns=grid,
            period_s=float("nan"),
            **columns,
            latched=np.zeros(len(grid), dtype=np.bool_),
            temperature_stamp_ns=None if oil is None else oil.stamp_ns,
            temperature_c=None if oil is None else oil.values("temperature")[:, 0],
            losses=(),
            gaps=(),
            duplicates={},
            notes=(),
            metadata={},
            commanded=self.commanded,
        )

    def _own(self, series: Series) -> Series:
        """The messages of `/joint_states` that make cycles of the robot in the whole recording."""
        tells = bool(series.tells_of(own_names(self.robot)).any())
        if tells and self._others and not self.known.told:
            raise LearntError(replace(self.known, told=True))
        self._told |= tells
        told = self.known.told or self._told
        self._others |= not told and not own_names(self.robot).issuperset(series.names)
        return own_joints(series, self.robot, others_tell=told)

    def _choose_valves(self, columns: dict[str, Any]) -> None:
        """Take `/valve_state` where it tells any voltage of the whole recording."""
        state_v = columns.pop("state_v")
        if state_v is not None and self.valve_source == VALVE_COMMAND:
            raise LearntError(replace(self.known, valve_state=True))
        if state_v is not None or self.known.valve_state:
            self.valve_source = VALVE_STATE
        elif columns["command_v"] is not None and not self.valve_source:
            self.valve_source = VALVE_COMMAND
        columns["valve_source"] = self.valve_source
        columns["valve_v"] = columns["command_v"]
        if self.valve_source == VALVE_STATE:
            columns["valve_v"] = state_v
        self._valves |= told_valves(self.robot, state_v)
        if wrong := self._valves & set(self.commanded):
            raise LearntError(replace(self.known, valves=self.known.valves | wrong))
        told, command_v = self.known.valves | self._valves, columns["command_v"]
        self.commanded = fill_voltages(columns, self.robot, told, command_v)

    def _fill(self, columns: dict[str, Any]) -> None:
        """Angles from strokes, of joints that have no position in the whole recording."""
        there = np.isfinite(columns["q"]).any(axis=0)
        self._read |= {n for n, own in zip(self.robot.joint_names, there, strict=True) if own}
        if wrong := self._read & self.filled.keys():
            raise LearntError(replace(self.known, read=self.known.read | wrong))
        for i in fill_angles(columns, self.robot, self.known.read | self._read):
            if self.filled.setdefault(self.robot.cylinders[i].joint, i) != i:
                raise LearntError(replace(self.known, whole=True))
