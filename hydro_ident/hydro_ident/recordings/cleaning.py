"""Outliers and short dropouts of sensors, found in the samples before any filter smears them.

A spike is replaced by a line between its neighbours, a lone one by a cubic through the nearest
four. A dropout (a reading that jumps and
then stands still to the last bit) is made a gap, so that no equation uses it. Both are counted
and said. The robust estimator does this, the others and the diagnosis for what is gross.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.streaming import Piece
from hydro_ident.estimate.signals.signal_survey import SignalSurvey
from hydro_ident.estimate.signals.spikes import SHORTEST, spike_sizes
from hydro_ident.estimate.signals.watched import SPIKE_SIGMAS, watched_sensors
from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray, Robot

#: A dropout holds still for this many samples, and leaps by this many deviations to either side.
_FROZEN, _LONGEST = 3, 250
_LEAP_SIGMAS = 40.0
#: Dropouts are rare. More than these and this share of a stretch are how the sensor reads: held
#: from reading to reading, or coarse.
_FEW, _MOST = 3, 0.02
#: Spikes are rare, too: where more than this share of a sensor stands out, that is how it reads.
_MOST_SPIKES = 0.05
#: A lone reading off by this share of the sensor's usual size is an error, no quick transient.
GROSS = 0.2
#: Readings of the whole machine, without which no edge's flow is known.
_RAILS = ("supply", "tank")


@dataclass(frozen=True, slots=True)
class Limit:
    """What is an outlier of one sensor.

    Attributes
    ----------
    name : str
        Of the sensor.
    field : str
        Of the recording.
    column : int
    noise : float
        Standard deviation of the sensor; not below its resolution.
    floor : float
        Below which nothing is a spike.
    lone : bool
        As of `spike_sizes`.
    leap : float
        Below which no leap begins or ends a dropout.
    """

    name: str
    field: str
    column: int
    noise: float
    floor: float
    lone: bool
    leap: float = 0.0


@dataclass(frozen=True, slots=True)
class Cleaner:
    """Limits of every sensor, against which outliers are seen.

    Attributes
    ----------
    limits : tuple of Limit
    notes : tuple of str
        Sensors that are left as they are although much of them stands out.
    """

    limits: tuple[Limit, ...]
    notes: tuple[str, ...] = ()

    @staticmethod
    def of(robot: Robot, signals: SignalSurvey, gross: float = 0.0) -> Cleaner:
        """From what the survey found; a sensor that it knows no noise of is left alone.

        Parameters
        ----------
        robot : Robot
        signals : SignalSurvey
        gross : float
            Share of a sensor's usual size below which nothing is a spike.
        """
        limits, notes = [], []
        for s in watched_sensors(robot, signals):
            floor = max(s.floor, gross * s.sensor.usual_size)
            share = s.sensor.deviations.share_above(SPIKE_SIGMAS * s.noise + floor)
            if share > _MOST_SPIKES:
                notes.append(
                    f"{share:.0%} of the samples of {s.name} stand out from their neighbours: that"
                    " is how it reads, none is taken for an outlier"
                )
            elif s.noise > 0.0:
                limits.append(Limit(s.name, s.field, s.column, s.noise, floor, s.sensor.lone))
        return Cleaner(tuple(limits), tuple(notes))

    @staticmethod
    def of_gross(robot: Robot, signals: SignalSurvey) -> Cleaner:
        """For what is gross alone: one such sample bends a fit by many deviations.

        Parameters
        ----------
        robot : Robot
        signals : SignalSurvey
        """
        cleaner = Cleaner.of(robot, signals, GROSS)
        limits = tuple(replace(one, leap=one.floor) for one in cleaner.limits)
        return replace(cleaner, limits=limits)

    def cleaned(self, piece: Piece, counts: dict[str, int]) -> Piece:
        """The piece without its outliers, which are added to `counts` by sensor."""
        recording = piece.recording
        columns: dict[str, FloatArray] = {}
        segments = recording.segments
        for limit in self.limits:
            values = getattr(recording, limit.field)
            if values is None:
                continue
            fresh = columns.setdefault(limit.field, values.copy())
            # A view: rails have a row per cycle and no columns.
            column = fresh if fresh.ndim == 1 else fresh[:, limit.column]
            column[:], bad = without_outliers(
                column, limit.noise, limit.floor, segments, limit.lone, limit.leap
            )
            found = int(bad[piece.core].sum())
            if found:
                counts[limit.name] = counts.get(limit.name, 0) + found
        return replace(piece, recording=_without_rails(recording, columns))


def _without_rails(recording: Recording, columns: Mapping[str, FloatArray]) -> Recording:
    """The recording with cleaned columns; where a rail dropped out, no valve signal is known.

    The equations of the edges' flows need supply and tank, those of forces do not.
    """
    fresh: dict[str, Any] = dict(columns)
    index = np.arange(len(recording))
    for rail in _RAILS:
        before, values = getattr(recording, rail), fresh.get(rail)
        if values is None:
            continue
        lost = np.isnan(values) & np.isfinite(before)
        if not lost.any():
            continue
        known = np.isfinite(values)
        values[lost] = np.interp(index[lost], index[known], values[known])
        if recording.valve_v is not None:
            fresh.setdefault("valve_v", recording.valve_v.copy())[lost] = np.nan
    return replace(recording, **fresh)


def without_outliers(
    values: FloatArray,
    noise: float,
    floor: float = 0.0,
    segments: Sequence[slice] = (slice(None),),
    lone: bool = False,
    leap: float = 0.0,
) -> tuple[FloatArray, BoolArray]:
    """A sensor's readings with spikes replaced and dropouts made gaps.

    Parameters
    ----------
    values : (N,) array
        NaN where there is no reading: stretches between gaps are looked at one by one, those of
        fewer than `SHORTEST` samples not at all.
    noise : float
        Standard deviation of the sensor.
    floor : float
        Below which nothing is a spike.
    segments : sequence of slice
        Stretches in which no cycle is missing.
    lone : bool
        As of `spike_sizes`.
    leap : float
        Below which no leap begins or ends a dropout.

    Returns
    -------
    cleaned : (N,) array
        NaN in dropouts.
    outlier : (N,) bool array
    """
    cleaned, outlier = values.copy(), np.zeros(values.size, dtype=bool)
    for segment in segments:
        offset = segment.start or 0
        for begin, end in runs(np.isfinite(values[segment])):
            if end - begin >= SHORTEST:
                own = slice(offset + begin, offset + end)
                cleaned[own], outlier[own] = _clean_run(values[own], noise, floor, lone, leap)
    return cleaned, outlier


def _clean_run(
    values: FloatArray, noise: float, floor: float, lone: bool, leap: float
) -> tuple[FloatArray, BoolArray]:
    """One stretch without gaps."""
    dropped = _dropouts(values, max(_LEAP_SIGMAS * noise, leap))
    if dropped is None:
        return values, np.zeros(values.size, dtype=bool)
    index = np.arange(values.size)
    filled = np.interp(index, index[~dropped], values[~dropped])
    spikes = (spike_sizes(filled, lone) > SPIKE_SIGMAS * noise + floor) & ~dropped
    good = ~(spikes | dropped)
    if not good.any():
        return values, np.zeros(values.size, dtype=bool)
    cleaned = np.interp(index, index[good], values[good])
    # Between samples of a slow log the hydraulic mode does not run straight.
    for at in np.flatnonzero(spikes):
        if 2 <= at < values.size - 2 and good[at - 2 : at + 3].sum() == 4:
            near = cleaned[at - 2 : at + 3]
            cleaned[at] = (4.0 * (near[1] + near[3]) - near[0] - near[4]) / 6.0
    return np.where(dropped, np.nan, cleaned), dropped | spikes


def _dropouts(values: FloatArray, least: float) -> BoolArray | None:
    """Readings that leap to a value, stand still on it and leap back.

    None where that is how the sensor reads: the edges of its steps are no spikes either.
    """
    step = np.diff(values)
    leap = np.abs(step) > least
    dropped, count = np.zeros(values.size, dtype=bool), 0
    for begin, end in runs(step == 0.0):
        if not _FROZEN <= end - begin + 1 <= _LONGEST:
            continue
        left = begin > 0 and leap[begin - 1]
        right = end < step.size and leap[end]
        if left and right:
            dropped[begin : end + 1] = True
            count += 1
    if count > _FEW and dropped.mean() > _MOST:
        return None
    return dropped
