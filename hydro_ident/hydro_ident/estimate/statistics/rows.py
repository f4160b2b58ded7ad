"""Regression rows: what a stretch of recording contributes to a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_model.arrays import BoolArray
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class Rows:
    """Regression rows of one piece of recording.

    Attributes
    ----------
    y : (T, k) array
        One column per channel; NaN where a channel was not measured.
    x : (T, k, p) array
        Regressors of each channel.
    time_s : (T,) array
        Within the recording.
    label : str
        Where the rows come from.
    z : (T, k, p) array or None
        Instruments: what the regressors would be, free of their noise.
    step_s : float
        Spacing of rows that follow each other; 0: all rows do, whatever their times.
    stride : int
        Rows that are taken as one: they overlap, or lie closer than their filter resolves.
        Noise is modelled, and information counted, from every `stride`-th row to the next.
    """

    y: FloatArray
    x: FloatArray
    time_s: FloatArray
    label: str = ""
    z: FloatArray | None = None
    step_s: float = 0.0
    stride: int = 1

    def take(self, index: BoolArray) -> Rows:
        """The rows of a mask."""
        z = None if self.z is None else self.z[index]
        y, x, time_s = self.y[index], self.x[index], self.time_s[index]
        return Rows(y, x, time_s, self.label, z, self.step_s, self.stride)

    def follows(self, last_s: float) -> BoolArray:
        """Which rows come right behind the one before; the first behind a row at `last_s`."""
        if self.step_s == 0.0:
            linked = np.ones(self.time_s.size, dtype=bool)
            linked[:1] = False
            return linked
        gap = np.diff(self.time_s, prepend=last_s)
        return np.asarray(np.abs(gap - self.step_s) < 0.5 * self.step_s)


def nonzero_columns(values: FloatArray) -> BoolArray:
    """Columns that are not zero in every row, (k, p) of (T, k, p).

    By the columns' extremes, which are quicker had than a look at every entry.
    """
    return np.asarray((values.min(axis=0) != 0.0) | (values.max(axis=0) != 0.0))
