"""Noise of the residual channels, and what it leaves of rows once it is divided out.

Residuals are autocorrelated: overlapping windows, filters, and whatever the model still lacks.
Every channel gets an autoregression of its own residual, whose order its length can carry; rows
behind it are near white, and sums over them count information as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_ident.mismatch.fitting.whitening_kernels import whiten
from hydro_model.arrays import BoolArray, IndexArray
from hydro_model.robot import FloatArray

#: Orders of the autoregression that are tried.
ORDERS = (0, 1, 2, 3, 4, 6, 8, 12)
#: Rows that a channel has to have per order.
_ROWS_PER_ORDER = 8
#: Noise is never taken to be below this share of a channel's measured spread: filters,
#: interpolation and geometry are not better.
LEAST_NOISE = 1.0e-5


@dataclass(frozen=True, slots=True)
class Layout:
    """Where stacked rows are from.

    Attributes
    ----------
    channel, recording : (N,) int array
    time_s : (N,) array
    linked : (N,) bool array
        Whether a row follows the one before it.
    """

    channel: IndexArray
    recording: IndexArray
    time_s: FloatArray
    linked: BoolArray

    @property
    def age(self) -> IndexArray:
        """How many rows in a row stand before each row."""
        index = np.arange(self.channel.size)
        start = np.maximum.accumulate(np.where(self.linked, 0, index)) if index.size else index
        return np.asarray(index - start)

    @property
    def length_s(self) -> float:
        """From the first row to the last, of all recordings together."""
        own = (self.time_s[self.recording == r] for r in np.unique(self.recording))
        return sum(float(np.ptp(time_s)) for time_s in own)

    @property
    def occupied_s(self) -> float:
        """As `length_s`, but for what holds no rows of any channel."""
        total = 0.0
        step = np.append(0.0, np.diff(self.time_s))
        for number in np.unique(self.recording):
            own = self.recording == number
            # Rows stand for the time up to the next one of the coarsest of the channels.
            spacing = float(np.max(step[own & self.linked], initial=0.0))
            apart = np.diff(np.unique(self.time_s[own]))
            total += float(np.minimum(apart, spacing).sum()) + spacing
        return total

    def take(self, mask: BoolArray) -> Layout:
        """The layout of some of the rows; those behind a row left out are linked no more."""
        before = np.concatenate([[False], mask[:-1]])
        linked = (self.linked & before)[mask]
        return Layout(self.channel[mask], self.recording[mask], self.time_s[mask], linked)

    def blocks(self, length_s: float) -> IndexArray:
        """Number of the block of time that each row is in, the same for all channels.

        `length_s` is that of a block.
        """
        if not self.channel.size:
            return np.zeros(0, dtype=np.intp)
        number = np.floor(self.time_s / length_s).astype(np.intp)
        key = self.recording * (int(number.max()) + 1) + number
        return np.asarray(np.unique(key, return_inverse=True)[1])


@dataclass(frozen=True, slots=True)
class Noise:
    """Autoregressive noise of every channel.

    Attributes
    ----------
    phi : tuple of (p,) array
    std : (k,) array
        Of the white noise behind it.
    """

    phi: tuple[FloatArray, ...]
    std: FloatArray

    @property
    def longest(self) -> int:
        """Largest order."""
        return max((phi.size for phi in self.phi), default=0)

    def settled(self, layout: Layout) -> BoolArray:
        """Rows with all the predecessors that their channel's noise looks back on."""
        order = np.array([phi.size for phi in self.phi], dtype=np.intp)
        return np.asarray(layout.age >= order[layout.channel])

    def whitened(self, layout: Layout, values: FloatArray) -> FloatArray:
        """Rows behind the noise's filter in units of its deviation; only `settled` ones hold.

        Rows are sorted by channel.
        """
        result = np.array(values, dtype=float, order="C")
        if not result.size:
            return result
        rows = result.reshape(len(result), -1)
        ends = np.searchsorted(layout.channel, np.arange(len(self.phi) + 1)).tolist()
        for k, phi in enumerate(self.phi):
            # An effect acts on few of the channels.
            if rows[ends[k] : ends[k + 1]].any():
                whiten(rows, ends[k], ends[k + 1], phi, float(self.std[k]))
        return result

    def adjoint(self, layout: Layout, rows: BoolArray, values: FloatArray) -> FloatArray:
        """The transposed filter: sums of whitened columns with values are sums of columns with it.

        Parameters
        ----------
        layout : Layout
        rows : (N,) bool array
            Those that `values` are of; the others count nothing.
        values : (M,) array

        Returns
        -------
        (N,) array
        """
        scaled = np.zeros(layout.channel.size)
        scaled[rows] = values
        scaled /= self.std[layout.channel]
        result = scaled.copy()
        for lag in range(1, self.longest + 1):
            weights = np.array([phi[lag - 1] if phi.size >= lag else 0.0 for phi in self.phi])
            result[:-lag] -= (weights[layout.channel] * scaled)[lag:]
        return np.asarray(result)


def noise_of(layout: Layout, residual: FloatArray, floor: FloatArray) -> Noise:
    """Fit the noise of every channel to its residual.

    Parameters
    ----------
    layout : Layout
    residual : (N,) array
    floor : (k,) array
        Least deviation of each channel.

    Returns
    -------
    Noise
    """
    phis: list[FloatArray] = []
    stds: list[float] = []
    for k in range(floor.size):
        own = layout.take(layout.channel == k)
        phi, std = _autoregression(own.age, residual[layout.channel == k])
        phis.append(phi)
        stds.append(max(std, float(floor[k])))
    return Noise(tuple(phis), np.array(stds))


def _autoregression(age: IndexArray, residual: FloatArray) -> tuple[FloatArray, float]:
    """Coefficients and innovation of the order that pays for itself (Schwarz)."""
    # A short channel's noise depends on its past, too: of as many orders as its rows can carry.
    carried = [p for p in ORDERS if np.count_nonzero(age >= p) >= _ROWS_PER_ORDER * p]
    longest = max(carried)
    usable = np.flatnonzero(age >= longest)
    if not longest:
        scale = float(np.sqrt(np.mean(residual**2))) if residual.size else 1.0
        return np.zeros(0), scale or 1.0
    lagged = np.stack([residual[usable - lag] for lag in range(1, longest + 1)], axis=1)
    target = residual[usable]
    gram, cross = lagged.T @ lagged, lagged.T @ target
    total = float(target @ target)
    best: tuple[float, FloatArray, float] | None = None
    for order in carried:
        part = gram[:order, :order]
        ridge = 1e-12 * np.trace(part) * np.eye(order)
        phi = np.linalg.solve(part + ridge, cross[:order]) if order and total > 0.0 else cross[:0]
        left = max(total - float(cross[: phi.size] @ phi), 1e-300)
        score = usable.size * np.log(left) + order * np.log(usable.size)
        if best is None or score < best[0]:
            best = (score, phi, float(np.sqrt(left / usable.size)))
    if best is None:
        return np.zeros(0), 1.0
    return best[1], best[2]
