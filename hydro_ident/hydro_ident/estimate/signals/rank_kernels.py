"""Compiled: order statistics of short windows, sample by sample."""

from __future__ import annotations

import numpy as np
from numba import njit

from hydro_model.robot import FloatArray


@njit(cache=True, error_model="numpy")
def running_ranks(
    values: FloatArray, width: int, step: int, low: int, high: int, out: FloatArray
) -> None:
    """Mean of two order statistics of every window, as `spikes.running_median` asks for it.

    Parameters
    ----------
    values : (N,) array
        Finite.
    width : int
        Of the windows, a dozen samples or so: each is sorted by itself.
    step : int
        From where one begins to where the next does.
    low, high : int
        Which order statistics, from 0.
    out : (M,) array
        Written to, so many windows.
    """
    window = np.empty(width)
    for number in range(out.size):
        begin = number * step
        if number and step == 1:
            # All but the one that has left it are sorted already: move up what is above that.
            left = values[begin - 1]
            gap = 0
            while gap < width - 1 and window[gap] != left:
                gap += 1
            for k in range(gap, width - 1):
                window[k] = window[k + 1]
            first = width - 1
        else:
            first = 0
        for k in range(first, width):
            value, at = values[begin + k], k
            while at > 0 and window[at - 1] > value:
                window[at] = window[at - 1]
                at -= 1
            window[at] = value
        out[number] = 0.5 * (window[low] + window[high])
