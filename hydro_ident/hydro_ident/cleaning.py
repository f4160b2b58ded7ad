"""Outliers and short dropouts of sensors, found in the samples before any filter smears them.

A spike is replaced by a line between its neighbours. A dropout (a reading that jumps and
then stands still to the last bit) is made a gap, so that no equation uses it. Both are counted
and said; only the robust estimator does this.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_ident.bag.recorded_run import BoolArray
from hydro_ident.bag.streaming import Piece
from hydro_ident.estimate.signal_survey import SignalSurvey, spike_sizes
from hydro_model.robot import FloatArray, Robot

#: What stands out by more than this many deviations of white noise is a spike.
SPIKE_SIGMAS = 8.0
#: ... beyond this share of the supply: a step of a valve bends a pressure within a sample.
PRESSURE_SHARE = 0.02
#: A dropout holds still for this many samples, and leaps by this many deviations to either side.
_FROZEN, _LONGEST = 3, 250
_LEAP_SIGMAS = 40.0


@dataclass(frozen=True, slots=True)
class Cleaner:
    """Noise of every sensor, against which outliers are seen.

    Attributes
    ----------
    noise : mapping of str to (k,) array
        Deviation per column of `q`, `p_a` and `p_b`; not below the resolution.
    names : mapping of str to tuple of str
        Of the columns.
    floor : mapping of str to float
        Below which nothing is a spike.
    """

    noise: Mapping[str, FloatArray]
    names: Mapping[str, tuple[str, ...]]
    floor: Mapping[str, float]

    @staticmethod
    def of(robot: Robot, signals: SignalSurvey) -> Cleaner:
        """From what the survey found."""
        count = 2.0 * np.pi / robot.sensors.encoder_counts_per_rev
        bar = robot.sensors.pressure_resolution_pa
        sensors = {"q": (signals.q, count), "p_a": (signals.p_a, bar), "p_b": (signals.p_b, bar)}
        noise = {
            name: np.array([max(s.noise(step), step) for s in some])
            for name, (some, step) in sensors.items()
        }
        cylinders = [c.name for c in robot.cylinders]
        names = {
            "q": tuple(robot.joint_names),
            "p_a": tuple(f"{c}/a" for c in cylinders),
            "p_b": tuple(f"{c}/b" for c in cylinders),
        }
        floor = PRESSURE_SHARE * robot.supply_pressure_pa
        return Cleaner(noise, names, {"q": 0.0, "p_a": floor, "p_b": floor})

    def cleaned(self, piece: Piece, counts: dict[str, int]) -> Piece:
        """The piece without its outliers, which are added to `counts` by sensor."""
        columns = {}
        for name, noise in self.noise.items():
            values = getattr(piece.recording, name)
            if values is None:
                continue
            fresh = values.copy()
            for k in range(noise.size):
                fresh[:, k], bad = without_outliers(
                    values[:, k], float(noise[k]), self.floor[name]
                )
                found = int(bad[piece.core].sum())
                if found:
                    sensor = self.names[name][k]
                    counts[sensor] = counts.get(sensor, 0) + found
            columns[name] = fresh
        return replace(piece, recording=replace(piece.recording, **columns))


def without_outliers(
    values: FloatArray, noise: float, floor: float = 0.0
) -> tuple[FloatArray, BoolArray]:
    """A sensor's readings with spikes replaced and dropouts made gaps.

    Parameters
    ----------
    values : (N,) array
    noise : float
        Standard deviation of the sensor.
    floor : float
        Below which nothing is a spike.

    Returns
    -------
    cleaned : (N,) array
        NaN in dropouts.
    outlier : (N,) bool array
    """
    if values.size < 16 or not np.isfinite(values).all():
        return values, np.zeros(values.size, dtype=bool)
    dropped = _dropouts(values, noise)
    index = np.arange(values.size)
    filled = np.interp(index, index[~dropped], values[~dropped])
    spikes = (spike_sizes(filled) > SPIKE_SIGMAS * noise + floor) & ~dropped
    good = ~(spikes | dropped)
    cleaned = np.interp(index, index[good], values[good])
    return np.where(dropped, np.nan, cleaned), dropped | spikes


def _dropouts(values: FloatArray, noise: float) -> BoolArray:
    """Readings that leap to a value, stand still on it and leap back."""
    step = np.diff(values)
    leap = np.abs(step) > _LEAP_SIGMAS * noise
    dropped = np.zeros(values.size, dtype=bool)
    for begin, end in runs(step == 0.0):
        if not _FROZEN <= end - begin + 1 <= _LONGEST:
            continue
        left = begin > 0 and leap[begin - 1]
        right = end < step.size and leap[end]
        if left and right:
            dropped[begin : end + 1] = True
    return dropped
