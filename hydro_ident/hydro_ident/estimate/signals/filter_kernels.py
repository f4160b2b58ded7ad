"""Compiled filter, forwards and backwards: the diagnosis asks for it thousands of times."""

from __future__ import annotations

from numba import njit

from hydro_model.robot import FloatArray


@njit(cache=True, error_model="numpy")
def filter_both_ways(
    sections: FloatArray, rest: FloatArray, data: FloatArray, state: FloatArray
) -> None:
    """Run second-order sections over rows forwards, then backwards; `scipy.signal.sosfiltfilt`.

    Parameters
    ----------
    sections : (S, 6) array
        As `scipy.signal.butter` gives them.
    rest : (S, 2) array
        Their state at rest behind a step of 1, `scipy.signal.sosfilt_zi`.
    data : (N, m) array
        Padded; overwritten by the outcome. At least one row.
    state : (3, m) array
        Memory to work in.
    """
    count, width = data.shape
    first = state[2]
    for back in range(2):
        begin = count - 1 if back else 0
        for j in range(width):
            first[j] = data[begin, j]
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
