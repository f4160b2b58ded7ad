"""Compiled passes over rows: signals within sampling intervals, and means over windows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from hydro_model.robot import FloatArray

Array = Any  # numba types the kernels; mypy follows no numba import


@njit(cache=True, error_model="numpy")
def between(rows: FloatArray, share: float) -> FloatArray:
    """Rows (N, k) at a `share` of the way to the next one, (N - 1, k)."""
    out = np.empty((rows.shape[0] - 1, rows.shape[1]))
    for i in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[i, c] = rows[i, c] + share * (rows[i + 1, c] - rows[i, c])
    return out


@njit(cache=True, error_model="numpy")
def window_means(steps: FloatArray, start: Array, span: int, length: float) -> FloatArray:
    """Sums over windows by their length; 0 in all columns where one touches an unknown value.

    Parameters
    ----------
    steps : (N, k) array
    start : (W,) int array
        First rows of the windows.
    span : int
        Rows of a window.
    length : float

    Returns
    -------
    (W, k) array
    """
    count, width = steps.shape
    # What all rows before each come to, and how many of them have an unknown value.
    total, unknown = np.zeros((count + 1, width)), np.zeros(count + 1, np.int64)
    for i in range(count):
        broken = 0
        for c in range(width):
            known = math.isfinite(steps[i, c])
            total[i + 1, c] = total[i, c] + (steps[i, c] if known else 0.0)
            broken = broken if known else 1
        unknown[i + 1] = unknown[i] + broken
    out = np.zeros((start.size, width))
    for w in range(start.size):
        begin, end = start[w], start[w] + span
        if unknown[end] == unknown[begin]:
            for c in range(width):
                out[w, c] = (total[end, c] - total[begin, c]) / length
    return out
