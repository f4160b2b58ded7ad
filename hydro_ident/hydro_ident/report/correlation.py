"""Correlation of residuals with themselves and with the motion, with the bands chance stays in.

A residual of which nothing is left to explain is not correlated with the motion, and with itself
only as far as the filters tie neighbouring rows together (L. Ljung, System Identification, 16.6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_model.robot import FloatArray

#: Half width of a 95 % band, in deviations.
_WIDTH = 1.96
#: Longest lag.
_LONGEST_S = 1.0
#: Fewest rows to correlate; figures of fewer are said to rest on few.
FEWEST_ROWS = 40


@dataclass(frozen=True, slots=True)
class Correlogram:
    """A correlation function.

    Attributes
    ----------
    lag_s, value, band : (K,) array
        The band is half of its width.
    """

    lag_s: FloatArray
    value: FloatArray
    band: FloatArray

    @property
    def outside(self) -> float:
        """Share of the lags beyond the band; 5 % are by chance."""
        judged = self.band > 0.0  # at no lag a residual is tied to itself
        return float(np.mean(np.abs(self.value[judged]) > self.band[judged]))


def autocorrelation(time_s: FloatArray, residual: FloatArray) -> Correlogram | None:
    """Autocorrelation, with Bartlett's band for a residual that is tied no further than the lag.

    Parameters
    ----------
    time_s, residual : (N,) array
        Rows at one spacing, with gaps.

    Returns
    -------
    Correlogram or None
        None where there are too few rows.
    """
    grid = _grid(time_s, residual)
    if grid is None:
        return None
    (values, mask), step_s, lags = grid
    r, pairs = _correlation((values, mask), (values, mask), lags)
    tied = 1.0 + 2.0 * np.concatenate([[0.0], np.cumsum(r[1:] ** 2)])[:-1]
    band = np.zeros(lags + 1)
    band[1:] = _WIDTH * np.sqrt(tied / pairs[1:])
    return Correlogram(np.asarray(np.arange(lags + 1) * step_s), r, band)


def cross_correlation(
    time_s: FloatArray, residual: FloatArray, motion: FloatArray
) -> Correlogram | None:
    """Correlation of a residual with the motion: at positive lags the motion came first.

    The band is that of two independent series of their own autocorrelations.
    """
    grid, other = _grid(time_s, residual), _grid(time_s, motion)
    if grid is None or other is None:
        return None
    (e, step_s, lags), u = grid, other[0]
    after, pairs = _correlation(u, e, lags)
    ahead, _ = _correlation(e, u, lags)
    own, moved = (_correlation(s, s, lags)[0] for s in (e, u))
    tied = 1.0 + 2.0 * float(own[1:] @ moved[1:])
    band = _WIDTH * np.sqrt(max(tied, 1.0) / pairs)
    return Correlogram(
        np.asarray(np.arange(-lags, lags + 1) * step_s),
        np.concatenate([ahead[:0:-1], after]),
        np.concatenate([band[:0:-1], band]),
    )


_Series = tuple[FloatArray, FloatArray]


def why_none(values: FloatArray, what: str) -> str:
    """Why a series has no correlation; empty where it has one.

    Parameters
    ----------
    values : (N,) array
    what : str
        It is called.
    """
    known = values[np.isfinite(values)]
    if not known.size:
        return f"{what} is not known"
    if known.size < FEWEST_ROWS:
        return f"{known.size} rows, fewer than the {FEWEST_ROWS} that a correlation takes"
    return f"{what} never changes" if float(known.std()) <= 0.0 else ""


def _grid(time_s: FloatArray, values: FloatArray) -> tuple[_Series, float, int] | None:
    """Values on even times, less their mean and over their deviation, with zeros in the gaps."""
    known = np.isfinite(values)
    if int(known.sum()) < FEWEST_ROWS:
        return None
    time_s, values = time_s[known], values[known]
    steps = np.diff(time_s)
    step_s = float(np.median(steps[steps > 0.0]))
    at = np.round((time_s - time_s[0]) / step_s).astype(np.intp)
    grid, mask = np.zeros(at[-1] + 1), np.zeros(at[-1] + 1)
    spread = float(values.std())
    if spread <= 0.0:
        return None
    grid[at], mask[at] = (values - values.mean()) / spread, 1.0
    lags = min(round(_LONGEST_S / step_s), int(known.sum()) // 4)
    return ((grid, mask), step_s, lags) if lags >= 1 else None


def _correlation(first: _Series, second: _Series, lags: int) -> tuple[FloatArray, FloatArray]:
    """Means of ``first(t) second(t + lag)`` over the pairs that are there, and their numbers."""
    size = 1 << (first[0].size + lags).bit_length()
    sums = []
    for a, b in zip(first, second, strict=True):
        product = np.conj(np.fft.rfft(a, size)) * np.fft.rfft(b, size)
        sums.append(np.fft.irfft(product, size)[: lags + 1])
    pairs = np.maximum(np.round(sums[1]), 1.0)
    return sums[0] / pairs, pairs
