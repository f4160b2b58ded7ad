"""Covariance of X'e where the noise e of each channel is an autoregression.

The noise is white noise through a filter; X'e is therefore white noise times X passed through the
same filter, and its covariance the sum of that product's squares, row by row in flat memory.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hydro_ident.estimate.rows import BoolArray, Rows
from hydro_model.robot import FloatArray

#: The filter's memory behind the last row is followed until this share of it is left.
_FORGOTTEN = 1.0e-6


@dataclass(slots=True)
class ColouredScores:
    """Sums up the covariance of X'e.

    Attributes
    ----------
    phi : (k, lags) array
        Autoregression of each channel's noise.
    std : (k,) array
        Standard deviation of the white noise behind it.
    total : (p, p) array
    """

    phi: FloatArray
    std: FloatArray
    total: FloatArray = field(init=False, default_factory=lambda: np.zeros((0, 0)))
    _memory: FloatArray | None = field(init=False, default=None)
    _spaced: FloatArray = field(init=False, default_factory=lambda: np.zeros((0, 0)))
    _last_s: float = field(init=False, default=-np.inf)

    def add(self, rows: Rows) -> None:
        """Take in the next rows, in order of time."""
        from scipy.signal import lfilter

        if not rows.time_s.size:
            return
        _, channels, size = rows.x.shape
        if not self.total.size:
            self.total = np.zeros((size, size))
        known = np.isfinite(rows.y) & np.isfinite(rows.x).all(axis=2)
        values = np.where(known[..., None], rows.x, 0.0) * self.std[:, None] * np.sqrt(rows.stride)
        linked = rows.follows(self._last_s)
        spaced = _spaced(self.phi, rows.stride)
        self._spaced = spaced
        for begin, end in _stretches(linked):
            if not linked[begin]:
                self.finish()
            if self._memory is None:
                self._memory = np.zeros((channels, spaced.shape[1] - 1, size))
            for k in range(channels):
                filtered, self._memory[k] = lfilter(
                    [1.0], spaced[k], values[begin:end, k], axis=0, zi=self._memory[k]
                )
                self.total += filtered.T @ filtered
        self._last_s = float(rows.time_s[-1]) if rows.step_s else -np.inf

    def finish(self) -> None:
        """Follow the noise that lies before the first row: the same as behind the last."""
        from scipy.signal import lfilter

        if self._memory is None:
            return
        for k, filter_ in enumerate(self._spaced):
            root = float(np.max(np.abs(np.roots([1.0, *-self.phi[k]])), initial=0.0))
            count = 1 + int(np.log(_FORGOTTEN) / np.log(max(root, 0.1)))
            stride = (self._spaced.shape[1] - 1) // max(self.phi.shape[1], 1)
            silent = np.zeros((count * max(stride, 1), self.total.shape[0]))
            rest, _ = lfilter([1.0], filter_, silent, axis=0, zi=self._memory[k])
            self.total += rest.T @ rest
        self._memory = None


def _stretches(linked: BoolArray) -> list[tuple[int, int]]:
    starts = [0, *[i for i in np.flatnonzero(~linked).tolist() if i > 0]]
    return list(zip(starts, [*starts[1:], len(linked)], strict=True))


def _spaced(phi: FloatArray, stride: int) -> FloatArray:
    """Recursive filters ``1 - phi_1 L^stride - ...``, one per channel."""
    filters = np.zeros((phi.shape[0], phi.shape[1] * stride + 1))
    filters[:, 0] = 1.0
    filters[:, stride::stride] = -phi
    return filters
