"""How well a model predicts the residual channels on rows that took no part in its fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.statistics.rows import Rows
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray

#: Periods of the parallel filter's cut-off over which it carries rows into their neighbours.
GUARD_PERIODS = 3.0
#: Held-out blocks are at least so many guards long, so that enough is left between them.
_BLOCK_GUARDS = 10.0
#: Where parts end blocks end, too: the guard is looked for in so many steps at least.
_PART_STEPS = 8

#: Begins and ends of parts of recordings, s, in order, by the recording's name.
Parts = Mapping[str, Sequence[tuple[float, float]]]


@dataclass(frozen=True, slots=True)
class HoldOut:
    """Every `every`-th block of each recording is kept from the fit and used for the scores.

    Blocks spread over the whole run see every kind of motion that the fit sees; the last part
    of a run alone would judge a chirp by a ramp. Of recordings that are looked at in parts the
    blocks lie along the time in these: parts at some spacing would miss every block of the clock.

    Attributes
    ----------
    block_s : mapping of str to float
        Length of the blocks by recording name.
    every : int
        0: nothing is held out (whole bags validate).
    guard_s : float
        Rows this close to a held-out block take part in neither: the filters carry over.
    parts : mapping of str to sequence of (float, float), or None
        What is looked at of each recording, nothing of those that are not listed; None: all.
    """

    block_s: Mapping[str, float] = field(default_factory=dict)
    every: int = 5
    guard_s: float = GUARD_PERIODS / 10.0
    parts: Parts | None = None

    @staticmethod
    def of(
        durations_s: Mapping[str, float],
        every: int = 5,
        longest_s: float = 4.0,
        parallel_hz: float = 10.0,
        parts: Parts | None = None,
    ) -> HoldOut:
        """Blocks of at most `longest_s`, at least `every` of them in what is looked at of each.

        Parameters
        ----------
        durations_s : mapping of str to float
            By recording.
        every : int
        longest_s : float
            Ten guards, if that is longer.
        parallel_hz : float
            Cut-off of the filter that the guard keeps out: it is three of its periods long.
        parts : mapping of str to sequence of (float, float), optional
            Where only parts are looked at: begins and ends by recording.
        """
        guard_s = GUARD_PERIODS / parallel_hz
        longest_s = max(longest_s, _BLOCK_GUARDS * guard_s)
        seconds = {k: sum(end - begin for begin, end in v) for k, v in (parts or {}).items()}
        blocks = {k: min(longest_s, seconds.get(k, v) / every) for k, v in durations_s.items()}
        return HoldOut(blocks, every, guard_s, parts)

    def training(self, rows: Rows) -> Rows:
        """The rows to fit: outside held-out blocks and their guard."""
        if self.every == 0:
            return rows
        kept = ~self._held(rows, 0.0)
        # Held blocks shorter than the guard would fit between its two ends.
        shortest = self.block_s[rows.label.rsplit("#", 1)[0]]
        least = 1 if self.parts is None else _PART_STEPS
        steps = max(least, math.ceil(self.guard_s / shortest))
        for shift in np.linspace(0.0, self.guard_s, steps + 1)[1:]:
            kept &= ~self._held(rows, -shift) & ~self._held(rows, shift)
        return rows.take(kept)

    def held_out(self, rows: Rows) -> Rows:
        """The rows to score."""
        return rows if self.every == 0 else rows.take(self._held(rows, 0.0))

    def holds(self, recording: str, time_s: FloatArray) -> BoolArray:
        """Which times lie in held-out blocks; there have to be some.

        Parameters
        ----------
        recording : str
        time_s : (N,) array
            From the start of the recording.
        """
        inside, along = np.ones(time_s.shape, dtype=np.bool_), time_s
        if self.parts is not None:
            inside, along = _along(self.parts.get(recording, ()), time_s)
        index = np.floor(along / self.block_s[recording]).astype(int)
        return np.asarray(inside & (in_turns(index, self.every) == self.every - 1))

    def _held(self, rows: Rows, shift_s: float) -> BoolArray:
        return self.holds(rows.label.rsplit("#", 1)[0], rows.time_s + shift_s)


def in_turns(block: NDArray[np.int64], every: int) -> NDArray[np.int64]:
    """Which of so many sets each block of time is in: one of every round, each time another.

    Motions repeat, and their period may well be a round: in the same order throughout, a set would
    then be of one part of the motion, and no other have it.

    Parameters
    ----------
    block : (N,) int array
        Numbers from 0 on.
    every : int
        Sets, and blocks of a round.
    """
    return np.asarray((block + (2 if every % 2 else 1) * (block // every)) % every)


def _along(
    parts: Sequence[tuple[float, float]], time_s: FloatArray
) -> tuple[BoolArray, FloatArray]:
    """Which times lie in parts, and the time in these that has gone by then."""
    if not parts:
        return np.zeros(time_s.shape, dtype=np.bool_), time_s
    begins, ends = np.array(parts).T
    number = np.maximum(np.searchsorted(begins, time_s, side="right") - 1, 0)
    before = np.cumsum(ends - begins) - (ends - begins)
    inside = (time_s >= begins[number]) & (time_s < ends[number])
    return inside, np.where(inside, before[number] + time_s - begins[number], 0.0)


#: Points of a channel that are kept for its plot.
PLOT_POINTS = 4000


@dataclass(slots=True)
class Tally:
    """Sums of squares of one channel, row by row in flat memory, and some rows for the plot.

    Attributes
    ----------
    count : int
    mean, spread : float
        Of the measured values: their mean and the sum of squares about it.
    before, after : float
        Sums of squared errors of the given and of the identified robot.
    every : int
        Rows are kept for the plot one in so many.
    """

    every: int = 1
    count: int = 0
    mean: float = 0.0
    spread: float = 0.0
    before: float = 0.0
    after: float = 0.0
    _kept: list[FloatArray] = field(default_factory=list)

    def add(
        self,
        time_s: FloatArray,
        measured: FloatArray,
        before: FloatArray,
        after: FloatArray,
        speed: FloatArray | None = None,
    ) -> None:
        """Take in the next rows, those not measured left out.

        `speed`, where it is known, is that of the motion at these rows.
        """
        known = np.isfinite(measured)
        speed = np.full(measured.shape, np.nan) if speed is None else speed
        columns = np.stack([v[known] for v in (time_s, measured, before, after, speed)])
        rows = columns.shape[1]
        if not rows:
            return
        values = columns[1]
        mean = float(values.mean())
        self._pool(rows, mean, float(np.sum((values - mean) ** 2)))
        self.before += float(np.sum((values - columns[2]) ** 2))
        self.after += float(np.sum((values - columns[3]) ** 2))
        self._kept.append(columns[:, -(self.count - rows) % self.every :: self.every].copy())

    def merge(self, other: Tally) -> None:
        """Take in the rows of another recording."""
        if other.count:
            self._pool(other.count, other.mean, other.spread)
            self.before += other.before
            self.after += other.after
            self._kept += other._kept

    def _pool(self, count: int, mean: float, spread: float) -> None:
        total = self.count + count
        shift = mean - self.mean
        self.spread += spread + shift**2 * self.count * count / total
        self.mean += shift * count / total
        self.count = total

    def score(
        self, name: str, unit: str, noise_floor: float, recordings: tuple[str, ...]
    ) -> ChannelScore:
        """The channel's score.

        `recordings` are the names of those that it is of.
        """
        kept = np.concatenate(self._kept, axis=1)
        rows = kept[0], kept[1], kept[2], kept[3]
        return ChannelScore(name, unit, *rows, noise_floor, recordings, self, kept[4])


@dataclass(frozen=True, slots=True)
class ChannelScore:
    """Prediction of one channel by the given and by the identified robot.

    Attributes
    ----------
    name, unit : str
    time_s, measured, before, after : (T,) array
        Rows that took no part in the fit (or, of `Identification.fitted`, those that did); of long
        recordings some of them, for the plot.
    noise_floor : float
        What sensor noise alone leaves.
    recordings : tuple of str
        Where the rows come from.
    tally : Tally or None
        Sums over all rows; None: those of the arrays.
    speed : (T,) array or None
        Of the channel's joint, rad/s or m/s.
    """

    name: str
    unit: str
    time_s: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray
    noise_floor: float
    recordings: tuple[str, ...]
    tally: Tally | None = None
    speed: FloatArray | None = None

    def summary(self) -> dict[str, float | str]:
        """The entry under `channels` of the result file."""
        sums = self.tally
        if sums is None:
            sums = Tally()
            sums.add(self.time_s, self.measured, self.before, self.after)
        count = max(sums.count, 1)
        return {
            "unit": self.unit,
            "rmse_before": math.sqrt(sums.before / count),
            "rmse_after": math.sqrt(sums.after / count),
            "noise_floor": self.noise_floor,
            "fit_before_pct": fit_percent(sums.before, sums.spread),
            "fit_after_pct": fit_percent(sums.after, sums.spread),
        }


def fit_percent(errors: float, spread: float) -> float:
    """``100 (1 - |y - yhat| / |y - mean y|)`` from sums of squares; 0 where y is constant.

    `errors` is the sum for y - yhat, `spread` that for y - mean y.
    """
    return 100.0 * (1.0 - math.sqrt(errors / spread)) if spread > 0.0 else 0.0
