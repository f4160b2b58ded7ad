"""What changes in a recording and how much its signals bend, of cycles stretch by stretch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.running import Sums
from hydro_model.arrays import FloatArray, IntArray
from hydro_model.robot import Robot

#: Readings of sensors by the message they come in, in words, and their fields of a recording.
MESSAGES = {"joint readings": ("q", "stroke", "effort"), "pressures": ("p_a", "p_b")}


@dataclass(slots=True)
class Bends:
    """Second differences of one signal, in readings that are there.

    Attributes
    ----------
    met : int
        Readings so far.
    """

    met: int = 0
    _tail: FloatArray = field(default_factory=lambda: np.zeros(0))
    _squares: Sums = field(default_factory=lambda: Sums(1))

    def add(self, values: FloatArray) -> None:
        """Take in the next samples, (N,)."""
        bend, _ = self.sizes(values)
        with np.errstate(over="ignore", invalid="ignore"):
            self._squares.add(bend[:, None] ** 2)

    def sizes(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sizes of the bends that the next samples, (N,), bring, and of the steps behind them.

        They are met by that, though not in `rms`.
        """
        known = values[np.isfinite(values)]
        self.met += known.size
        whole = np.concatenate([self._tail, known])
        self._tail = whole[-2:].copy()
        # What overflows bends by more than any line does.
        with np.errstate(over="ignore", invalid="ignore"):
            step = np.diff(whole)
            bend = np.abs(np.diff(step))
        return bend, np.abs(step[1:])

    @property
    def count(self) -> int:
        """Bends met."""
        return max(0, self.met - 2)

    @property
    def rms(self) -> float:
        """Of the bends; 0 without any."""
        return float(np.sqrt(self._squares.total[0] / max(self.count, 1)))


@dataclass(slots=True)
class Changes:
    """The columns of one message.

    Parameters
    ----------
    width : int
        Number of columns.

    Attributes
    ----------
    met : int
        Cycles so far.
    changes : (width,) int array
        Steps that are other than 0.
    smallest : (width,) array
        Size of the smallest of them; NaN without any.
    bends : list of Bends
    """

    width: int
    met: int = 0
    changes: IntArray = field(init=False)
    smallest: FloatArray = field(init=False)
    bends: list[Bends] = field(init=False)
    #: Of what is a number.
    _least: FloatArray = field(init=False)
    _most: FloatArray = field(init=False)
    _last: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.changes, self.smallest = np.zeros(self.width, dtype=np.int64), _nan(self.width)
        self._least, self._most = _nan(self.width), _nan(self.width)
        self.bends = [Bends() for _ in range(self.width)]
        self._last = np.zeros((0, self.width))

    def add(self, values: FloatArray) -> None:
        """Take in rows, (N, width)."""
        if not len(values):
            return
        at = _there(values)
        some = values[:, at]
        steps = steps_of(self._last[:, at], some)
        # A reading that is missing counts as a change: no cycle may be left out for it.
        changed = steps != 0.0
        every = len(steps)
        self.changes += every
        self.changes[at] += changed.sum(axis=0) - every
        self.met, self._last = self.met + len(values), values[-1:].copy()
        if every:
            sizes = np.where(changed, np.abs(steps), np.nan)
            self.smallest[at] = np.fmin(self.smallest[at], np.fmin.reduce(sizes, axis=0))
        self._least[at] = np.fmin(self._least[at], np.fmin.reduce(some, axis=0))
        self._most[at] = np.fmax(self._most[at], np.fmax.reduce(some, axis=0))
        for i in at:
            self.bends[i].add(values[:, i])

    @property
    def moving(self) -> IntArray:
        """Columns that change at all."""
        finite = np.array([one.met > 0 for one in self.bends], dtype=np.bool_)
        return np.flatnonzero(finite & (self._least < self._most))


def steps_of(last: FloatArray, values: FloatArray) -> FloatArray:
    """Differences from row to row of `values`, the first from the `last` one that came before.

    Between infinite ones there is no number.
    """
    with np.errstate(invalid="ignore"):
        return np.diff(np.concatenate([last, values]), axis=0)


def _there(values: FloatArray) -> IntArray:
    """Columns in which some row is a number; what is not recorded need not be looked at."""
    empty = np.isnan(values[0])
    empty[empty] = np.isnan(values[:, empty]).all(axis=0)
    return np.flatnonzero(~empty)


def _nan(width: int) -> FloatArray:
    return np.full(width, np.nan)


@dataclass(slots=True)
class FirstLook:
    """What changes in a recording, and how much it bends.

    Parameters
    ----------
    robot : Robot

    Attributes
    ----------
    messages : list of Changes
        Of joints, and of pressures.
    """

    robot: Robot
    messages: list[Changes] = field(init=False)

    def __post_init__(self) -> None:
        joints, cylinders = self.robot.dof, len(self.robot.cylinders)
        self.messages = [Changes(2 * joints + cylinders), Changes(2 * cylinders)]

    def add(self, recording: Recording) -> None:
        """Take in the next cycles."""
        if len(recording):
            for message, values in zip(self.messages, sensor_columns(recording), strict=True):
                message.add(values)


def sensor_columns(recording: Recording) -> Iterator[FloatArray]:
    """Readings of sensors by the message they come in."""
    robot, count = recording.robot, len(recording)
    wide = {"q": robot.dof, "stroke": len(robot.cylinders), "effort": robot.dof}
    wide |= {"p_a": len(robot.cylinders), "p_b": len(robot.cylinders)}

    def of(name: str) -> FloatArray:
        values: FloatArray | None = getattr(recording, name)
        return np.full((count, wide[name]), np.nan) if values is None else values

    for fields in MESSAGES.values():
        yield np.concatenate([of(name) for name in fields], axis=1)
