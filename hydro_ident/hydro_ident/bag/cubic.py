"""Signals between readings that are not evenly spaced."""

from __future__ import annotations

import numpy as np

from hydro_model.arrays import FloatArray

_NODES = 4


def cubic_between(
    values: FloatArray, since: FloatArray, grid: FloatArray, reach: float
) -> FloatArray:
    """Lagrange's polynomial through the four nearest readings with no pause between them.

    Parameters
    ----------
    values : (K,) or (K, c) array
        Readings.
    since : (K,) array
        When they were taken, increasing.
    grid : (N,) array
        When they are wanted.
    reach : float
        Longest interval between readings that is no pause.

    Returns
    -------
    (N,) or (N, c) array
        NaN before the first reading, behind the last and in pauses.
    """
    if len(since) < _NODES:
        return np.full((len(grid), *values.shape[1:]), np.nan)
    count = len(since)
    right = np.clip(np.searchsorted(since, grid), 1, count - 1)
    part = np.concatenate([[0], np.cumsum(np.diff(since) > reach)])
    begins = np.searchsorted(part, part)
    ends = np.searchsorted(part, part, side="right")
    begin, end = begins[right], ends[right]
    start = np.clip(right - 2, begin, np.maximum(end - _NODES, begin))
    usable = (part[right - 1] == part[right]) & (end - begin >= _NODES)
    usable &= (grid >= since[right - 1]) & (grid <= since[right])
    at = np.minimum(start[:, None] + np.arange(_NODES), count - 1)
    nodes = since[at]
    laid = np.zeros((len(grid), *values.shape[1:]))
    for k in range(_NODES):
        weight = np.ones(len(grid))
        for j in (j for j in range(_NODES) if j != k):
            span = nodes[:, k] - nodes[:, j]
            weight *= (grid - nodes[:, j]) / np.where(span == 0.0, 1.0, span)
        laid += (weight if values.ndim == 1 else weight[:, None]) * values[at[:, k]]
    laid[~usable] = np.nan
    return laid
