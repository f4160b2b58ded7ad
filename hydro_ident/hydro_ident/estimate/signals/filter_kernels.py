"""Compiled filter, forwards and backwards: the diagnosis asks for it thousands of times."""

from __future__ import annotations

import numpy as np
from numba import njit

from hydro_model.robot import FloatArray

#: Up to so many columns one after the other are quicker than all of them row by row.
_NARROW = 4


def filter_both_ways(sections: FloatArray, rest: FloatArray, data: FloatArray) -> None:
    """Run second-order sections over rows forwards, then backwards; `scipy.signal.sosfiltfilt`.

    Parameters
    ----------
    sections : (S, 6) array
        As `scipy.signal.butter` gives them.
    rest : (S, 2) array
        Their state at rest behind a step of 1, `scipy.signal.sosfilt_zi`.
    data : (N, m) array
        Padded; overwritten by the outcome. At least one row.
    """
    if data.shape[1] <= _NARROW:
        for back in (False, True):
            filter_columns(sections, rest, data, back)
    else:
        state = np.empty((3, data.shape[1]))
        for back in (False, True):
            filter_rows(sections, rest, data, state, back)


@njit(cache=True, error_model="numpy")
def filter_columns(sections: FloatArray, rest: FloatArray, data: FloatArray, back: bool) -> None:
    """One way, column by column, two sections at a time: one need not wait for the other.

    The numbers are those of `filter_rows` to the last bit.

    Parameters
    ----------
    sections, rest, data : arrays
        As of `filter_both_ways`.
    back : bool
        From the last row to the first.
    """
    count, width = data.shape
    for j in range(width):
        first = data[count - 1 if back else 0, j]
        for s in range(0, sections.shape[0] - 1, 2):
            b0, b1, b2, _, a1, a2 = sections[s]
            c0, c1, c2, _, d1, d2 = sections[s + 1]
            u, v = rest[s, 0] * first, rest[s, 1] * first
            w, z = rest[s + 1, 0] * first, rest[s + 1, 1] * first
            for i in range(count):
                k = count - 1 - i if back else i
                value = data[k, j]
                middle = b0 * value + u
                u = b1 * value - a1 * middle + v
                v = b2 * value - a2 * middle
                after = c0 * middle + w
                w = c1 * middle - d1 * after + z
                z = c2 * middle - d2 * after
                data[k, j] = after
        if sections.shape[0] % 2:
            b0, b1, b2, _, a1, a2 = sections[-1]
            u, v = rest[-1, 0] * first, rest[-1, 1] * first
            for i in range(count):
                k = count - 1 - i if back else i
                value = data[k, j]
                after = b0 * value + u
                u = b1 * value - a1 * after + v
                v = b2 * value - a2 * after
                data[k, j] = after


@njit(cache=True, error_model="numpy")
def filter_rows(
    sections: FloatArray, rest: FloatArray, data: FloatArray, state: FloatArray, back: bool
) -> None:
    """One way, row by row.

    Parameters
    ----------
    sections, rest, data : arrays
        As of `filter_both_ways`.
    state : (3, m) array
        Memory to work in.
    back : bool
        From the last row to the first.
    """
    count, width = data.shape
    first = state[2]
    for j in range(width):
        first[j] = data[count - 1 if back else 0, j]
    for s in range(sections.shape[0]):
        b0, b1, b2, _, a1, a2 = sections[s]
        for j in range(width):
            state[0, j] = rest[s, 0] * first[j]
            state[1, j] = rest[s, 1] * first[j]
        for i in range(count):
            k = count - 1 - i if back else i
            for j in range(width):
                value = data[k, j]
                after = b0 * value + state[0, j]
                state[0, j] = b1 * value - a1 * after + state[1, j]
                state[1, j] = b2 * value - a2 * after
                data[k, j] = after
