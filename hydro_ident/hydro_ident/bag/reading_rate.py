"""How many samples of a recording there are for each one that was taken.

Between two samples that were taken an interpolated signal runs straight, one that is held (by a
bus slower than the log) stands still. A first look finds what changes at all and how much signals
bend, a second one, of the same cycles, counts against that; both take cycles stretch by stretch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.grid import BoolArray, runs
from hydro_ident.bag.intervals import Counts
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.running import Sums
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import FloatArray, IntArray

#: Second differences below this share of their rms are those of a straight line: what rounding of
#: a log's digits leaves. White noise is below it in one sample of eight.
_STRAIGHT = 0.15
#: Fewest second differences of a line, and its longest duration: a slow ramp is no interpolation.
_FEWEST, _LONGEST_S = 3, 0.5
#: Share of a signal's samples that lie on such lines.
_COVERED = 0.5
#: Fewest samples to judge.
_SHORTEST = 200
#: Share of the changes of a sensor message that come on the beat of its readings. Two clocks slip
#: by a sample now and then: beside a beat of fewer than `_SLIPPING` samples that would be chance.
_ON_BEAT, _SLIPPING = 0.9, 5
#: A coarse encoder passes its counts one by one. Readings that are held pass over some: this share
#: of the changes is of more than so many of the smallest.
_PASSING, _COUNTS = 0.1, 1.5


@dataclass(slots=True)
class _Bends:
    """Second differences of one signal, in readings that are there."""

    met: int = 0
    _tail: FloatArray = field(default_factory=lambda: np.zeros(0))
    _squares: Sums = field(default_factory=lambda: Sums(1))

    def add(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Sizes of the bends that the next samples, (N,), bring, and of the steps behind them."""
        known = values[np.isfinite(values)]
        self.met += known.size
        whole = np.concatenate([self._tail, known])
        self._tail = whole[-2:].copy()
        step = np.diff(whole)
        bend = np.abs(np.diff(step))
        self._squares.add(bend[:, None] ** 2)
        return bend, np.abs(step[1:])

    @property
    def count(self) -> int:
        """Bends met."""
        return max(0, self.met - 2)

    @property
    def rms(self) -> float:
        return float(np.sqrt(self._squares.total[0] / max(self.count, 1)))


@dataclass(slots=True)
class _Changes:
    """A first look at the columns of one message."""

    width: int
    met: int = 0
    #: Steps that are other than 0, and the smallest of them.
    changes: IntArray = field(init=False)
    smallest: FloatArray = field(init=False)
    bends: list[_Bends] = field(init=False)
    #: Of what is a number.
    _least: FloatArray = field(init=False)
    _most: FloatArray = field(init=False)
    _last: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.changes, self.smallest = np.zeros(self.width, dtype=np.int64), _nan(self.width)
        self._least, self._most = _nan(self.width), _nan(self.width)
        self.bends = [_Bends() for _ in range(self.width)]
        self._last = np.zeros((0, self.width))

    def add(self, values: FloatArray) -> None:
        steps = np.diff(np.concatenate([self._last, values]), axis=0)
        self.met, self._last = self.met + len(values), values[-1:].copy()
        # A reading that is missing counts as a change: no cycle may be left out for it.
        changed = steps != 0.0
        self.changes += changed.sum(axis=0)
        if len(steps):
            sizes = np.where(changed, np.abs(steps), np.nan)
            self.smallest = np.fmin(self.smallest, np.fmin.reduce(sizes, axis=0))
        self._least = np.fmin(self._least, np.fmin.reduce(values, axis=0))
        self._most = np.fmax(self._most, np.fmax.reduce(values, axis=0))
        for one, column in zip(self.bends, values.T, strict=True):
            one.add(column)

    @property
    def moving(self) -> IntArray:
        """Columns that change at all."""
        finite = np.array([one.met > 0 for one in self.bends], dtype=np.bool_)
        return np.flatnonzero(finite & (self._least < self._most))


def _nan(width: int) -> FloatArray:
    return np.full(width, np.nan)


@dataclass(slots=True)
class FirstLook:
    """What changes in a recording, and how much it bends.

    Parameters
    ----------
    robot : Robot
    """

    robot: Robot
    messages: list[_Changes] = field(init=False)

    def __post_init__(self) -> None:
        joints, cylinders = self.robot.dof, len(self.robot.cylinders)
        self.messages = [_Changes(2 * joints + cylinders), _Changes(2 * cylinders)]

    def add(self, recording: Recording) -> None:
        """Take in the next cycles."""
        if len(recording):
            for message, values in zip(self.messages, _columns(recording), strict=True):
                message.add(values)


def _columns(recording: Recording) -> Iterator[FloatArray]:
    """Readings of sensors by the message they come in."""
    robot, count = recording.robot, len(recording)
    wide = {"stroke": len(robot.cylinders), "effort": robot.dof}
    wide |= {"p_a": len(robot.cylinders), "p_b": len(robot.cylinders)}

    def of(name: str) -> FloatArray:
        values: FloatArray | None = getattr(recording, name)
        return np.full((count, wide[name]), np.nan) if values is None else values

    yield np.concatenate([recording.q, of("stroke"), of("effort")], axis=1)
    yield np.concatenate([of("p_a"), of("p_b")], axis=1)


@dataclass(slots=True)
class _Lines:
    """Straight lines of one signal: how many bends lie on each, of those that count."""

    least: float
    longest: float
    bends: _Bends = field(default_factory=_Bends)
    lengths: Counts = field(default_factory=Counts)
    _open: int = 0

    def add(self, values: FloatArray) -> None:
        bend, step = self.bends.add(values)
        # A quantised signal at rest repeats itself: that is straight, too, but goes nowhere.
        straight: BoolArray = (bend <= self.least) & (step > self.least)
        if not straight.size:
            return
        lengths = np.array([end - begin for begin, end in runs(straight)], dtype=np.int64)
        if straight[0]:
            lengths[0] += self._open
        else:
            self._count(np.array([self._open]))
        self._open = 0
        if straight[-1]:
            self._open, lengths = int(lengths[-1]), lengths[:-1]
        self._count(lengths)

    def _count(self, lengths: IntArray) -> None:
        self.lengths.add(lengths[(lengths >= _FEWEST) & (lengths <= self.longest)])

    def spacing(self) -> float:
        """Median samples between readings; 1 where it does not run in straight lines."""
        self._count(np.array([self._open]))
        self._open = 0
        if self.bends.met < _SHORTEST or self.lengths.total < _COVERED * self.bends.count:
            return 1.0
        # Bends lie within the line, its readings at both ends.
        return self.lengths.median() + 1.0


@dataclass(slots=True)
class _Beat:
    """How the columns of one message change together."""

    first: _Changes
    longest: float
    moving: IntArray = field(init=False)
    apart: Counts = field(default_factory=Counts)
    #: Changes of each moving column that can be told, and those of more than its resolution.
    told: IntArray = field(init=False)
    passing: IntArray = field(init=False)
    _met: int = 0
    _changed: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    _last: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.moving = self.first.moving
        self.told = np.zeros(self.moving.size, dtype=np.int64)
        self.passing = self.told.copy()
        self._last = np.zeros((0, self.moving.size))

    def add(self, values: FloatArray) -> None:
        moving = np.concatenate([self._last, values[:, self.moving]])
        steps = np.diff(moving, axis=0)
        self._last = moving[-1:].copy()
        at = np.concatenate(
            [self._changed, self._met + np.flatnonzero((steps != 0.0).any(axis=1))]
        )
        self._met, self._changed = self._met + len(steps), at[-1:]
        apart = np.diff(at)
        # Readings of a machine at rest repeat themselves.
        self.apart.add(apart[apart <= self.longest])
        sizes = np.abs(steps)
        self.told += (sizes > 0.0).sum(axis=0)
        self.passing += (sizes > _COUNTS * self.first.smallest[self.moving]).sum(axis=0)

    def samples(self) -> float:
        """Samples from one change to the next; 1 where there is no beat.

        All readings of a message change together and by what their signals moved, a coarse
        encoder's whenever its joint is a count further.
        """
        apart = self.apart
        if not self.moving.size or self.first.met < _SHORTEST:
            return 1.0
        if apart.size < 2 or apart.total < _COVERED * self._met:
            return 1.0
        beat = float(np.round(apart.median()))
        off = np.abs(apart.values - beat * np.maximum(np.round(apart.values / beat), 1.0))
        slip = 1.0 if beat >= _SLIPPING else 0.0
        if beat < 2.0 or apart.counts[off <= slip].sum() / apart.size < _ON_BEAT:
            return 1.0
        # Whether a signal often changes by more than its resolution at once.
        over = (self.told > 0) & (self.passing / np.maximum(self.told, 1) > _PASSING)
        return beat if over.any() else 1.0


@dataclass(slots=True)
class SecondLook:
    """How many samples there are for each reading.

    Parameters
    ----------
    first : FirstLook
        Of the whole recording.
    period_s : float
    """

    first: FirstLook
    period_s: float
    _beats: list[_Beat] = field(init=False)
    _lines: list[list[_Lines]] = field(init=False)

    def __post_init__(self) -> None:
        longest = _LONGEST_S / self.period_s
        self._beats = [_Beat(message, longest) for message in self.first.messages]
        self._lines = [
            [_Lines(_STRAIGHT * beat.first.bends[i].rms, longest) for i in beat.moving]
            for beat in self._beats
        ]

    def add(self, recording: Recording) -> None:
        """Take in the next cycles, those of the first look."""
        if not len(recording):
            return
        for beat, lines, values in zip(self._beats, self._lines, _columns(recording), strict=True):
            beat.add(values)
            for one, column in zip(lines, values.T[beat.moving], strict=True):
                one.add(column)

    def every(self) -> int:
        """Samples for each reading of the sensor that was read most often.

        1 unless all sensors' signals that change at all were interpolated or held. Of interpolated
        ones fewer than four samples per reading are not seen.
        """
        spacings: list[float] = []
        for beat, lines in zip(self._beats, self._lines, strict=True):
            samples = beat.samples()
            spacings += [max(one.spacing(), samples) for one in lines]
        return int(min(spacings, default=1.0))

    def text(self, every: int) -> str:
        """In words, how far a recording was interpolated, or its readings were held."""
        rate = 1.0 / self.period_s
        # What is interpolated changes in every sample, what is held in one of many.
        still = all(
            (one.changes[one.moving] < _COVERED * max(one.met - 1, 1)).all()
            for one in self.first.messages
        )
        runs_how, how = ("stand still", "held") if still else ("run straight", "interpolated")
        return (
            f"its signals {runs_how} over {every} samples at a time: about {rate / every:.3g}"
            f" readings per second, {how} to {rate:.4g} Hz"
        )


def look_twice(recording: Recording) -> SecondLook:
    """Both looks at a recording in memory.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    SecondLook
    """
    first = FirstLook(recording.robot)
    first.add(recording)
    second = SecondLook(first, recording.period_s)
    second.add(recording)
    return second


def samples_per_reading(recording: Recording) -> int:
    """How many samples of a recording there are for each one that was taken.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    int
        As `SecondLook.every`.
    """
    return look_twice(recording).every()
