"""Compiled: rows behind their channel's noise, and sums of rows by block of time."""

from __future__ import annotations

from typing import Any

from numba import njit

from hydro_model.robot import FloatArray

Array = Any  # numba types the kernels; mypy follows no numba import


@njit(cache=True, error_model="numpy")
def whiten(values: FloatArray, begin: int, end: int, phi: FloatArray, std: float) -> None:
    """Rows less what their predecessors tell, over a deviation, in place.

    Parameters
    ----------
    values : (N, k) array
    begin, end : int
        Rows of the channel.
    phi : (p,) array
        Autoregression; rows with fewer than p predecessors keep what those do not tell.
    std : float
    """
    width = values.shape[1]
    # From the last row on: each looks back on rows that are still as they were.
    for i in range(end - 1, begin - 1, -1):
        for lag in range(1, min(phi.size, i - begin) + 1):
            for k in range(width):
                values[i, k] -= phi[lag - 1] * values[i - lag, k]
        for k in range(width):
            values[i, k] /= std


@njit(cache=True, error_model="numpy")
def add_blocks(block: Array, values: FloatArray, weights: FloatArray, out: FloatArray) -> None:
    """Add weighted rows to the sums of their blocks.

    Parameters
    ----------
    block : (N,) int array
        Number of each row's.
    values : (N, k) array
    weights : (N,) array
    out : (B, k) array
        Added to.
    """
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            out[block[i], k] += weights[i] * values[i, k]
