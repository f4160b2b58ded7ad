"""Compiled: which column of a trial gains most, for each of thousands of sign flips."""

from __future__ import annotations

from typing import Any

from numba import njit

from hydro_model.robot import FloatArray

Array = Any  # numba types the kernels; mypy follows no numba import


@njit(cache=True, error_model="numpy")
def best_single(
    square: FloatArray,
    sums: FloatArray,
    free: Array,
    kept: Array,
    gains: FloatArray,
    coefficients: FloatArray,
) -> None:
    """Largest gain of one column by itself, and its coefficient.

    Parameters
    ----------
    square : (k,) array
        Squared norms of the columns.
    sums : (M, k) array
        Their products with M residuals.
    free, kept : (k,) bool array
        Whose coefficients may be negative, and which may be used.
    gains : (M,) array
        Filled; 0 where none gains anything.
    coefficients : (M, k) array
        Filled; 0 for all others.
    """
    for m in range(sums.shape[0]):
        gains[m], best = 0.0, -1
        for c in range(sums.shape[1]):
            coefficients[m, c] = 0.0
            gain = sums[m, c] / square[c] * sums[m, c]
            if kept[c] and (free[c] or sums[m, c] >= 0.0) and gain > gains[m]:
                gains[m], best = gain, c
        if best >= 0:
            coefficients[m, best] = sums[m, best] / square[best]
