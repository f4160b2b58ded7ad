"""How many samples of a recording there are for each one that was taken.

Between two samples that were taken an interpolated signal runs straight, one that is held (by a
bus slower than the log) stands still. A first look finds what changes at all and how much signals
bend, a second one, of the same cycles, counts against that; both take cycles stretch by stretch.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.changes import (
    MESSAGES,
    Bends,
    Changes,
    FirstLook,
    sensor_columns,
    steps_of,
)
from hydro_ident.bag.intervals import Counts
from hydro_ident.bag.recorded_run import Recording
from hydro_model.arrays import BoolArray, FloatArray, IntArray

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
class _Lines:
    """Straight lines of one signal: how many bends lie on each, of those that count."""

    least: float
    longest: float
    bends: Bends = field(default_factory=Bends)
    lengths: Counts = field(default_factory=Counts)
    _open: int = 0

    def add(self, values: FloatArray) -> None:
        bend, step = self.bends.sizes(values)
        # A quantised signal at rest repeats itself: that is straight, too, but goes nowhere.
        straight: BoolArray = (bend <= self.least) & (step > self.least)
        if not straight.size:
            return
        edges = np.flatnonzero(np.diff(np.concatenate(([0], straight.astype(np.int8), [0]))))
        lengths = edges[1::2] - edges[::2]
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

    first: Changes
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
        moving = values[:, self.moving]
        steps = steps_of(self._last, moving)
        self._last = moving[-1:].copy()
        changed = self._met + np.flatnonzero((steps != 0.0).any(axis=1))
        at = np.concatenate([self._changed, changed])
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


@dataclass(frozen=True, slots=True)
class HeldMessage:
    """Readings that stand still for longer than others of the recording do.

    Attributes
    ----------
    name : str
        In words.
    fields : tuple of str
        Of the recording.
    samples : int
        From one reading to the next.
    rate_hz : float
        Of the recording's cycles.
    """

    name: str
    fields: tuple[str, ...]
    samples: int
    rate_hz: float

    @property
    def text(self) -> str:
        """In words, how long."""
        return (
            f"its {self.name} stand still over {self.samples} samples at a time: about"
            f" {self.rate_hz / self.samples:.3g} readings per second"
        )


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
        for beat, lines, values in zip(
            self._beats, self._lines, sensor_columns(recording), strict=True
        ):
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

    def held(self) -> tuple[HeldMessage, ...]:
        """Messages that are held for longer than there are samples for each reading."""
        every, rate_hz = self.every(), 1.0 / self.period_s
        found = []
        for beat, (name, fields) in zip(self._beats, MESSAGES.items(), strict=True):
            samples = round(beat.samples())
            if samples > every:
                found.append(HeldMessage(name, fields, samples, rate_hz))
        return tuple(found)

    def text(self, every: int) -> str:
        """In words, how far a recording was interpolated, or its readings were held.

        `every` is how many samples there are for each reading, as `SecondLook.every` says.
        """
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
