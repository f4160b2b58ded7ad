"""How far samples of a sensor lie from where their neighbours put them."""

from __future__ import annotations

import numpy as np

from hydro_model.robot import FloatArray

#: Samples to either side from which a sample is predicted, and the fewest for it.
_REACH, SHORTEST = 6, 16
#: What stands out does so by so many times as much as its neighbours on either side.
_BEYOND = 4.0
#: Of so many on a side the fourth smallest is usual: some spikes may be among them.
_BESIDE, _USUAL = 8, 3
#: What stands out shows by this share in what a cubic through its neighbours leaves.
_SEEN = 0.25


def spike_sizes(values: FloatArray, lone: bool = False) -> FloatArray:
    """How far each sample lies from where its neighbours put it.

    Speed and curvature are medians over a dozen samples; each of three neighbours on either side
    then predicts the sample, and the median of the six predictions is taken. It takes several
    spikes within a dozen samples to mislead it, or a motion that rings within so few: where the
    neighbours lie off alike, a sample has to stand out from a cubic through the nearest four, too.

    Parameters
    ----------
    values : (N,) array
        N >= 16.
    lone : bool
        How far beyond both sides' predictions, each the median of its three: a step, which one
        side agrees with, is no spike.

    Returns
    -------
    (N,) array
        In the unit of the values; 0 where a sample stands out no more than its neighbours, unless
        `lone`.
    """
    mirrored = 2.0 * _end(values) - values[_REACH:0:-1]
    beyond = 2.0 * _end(values[::-1]) - values[-2 : -_REACH - 2 : -1]
    padded = np.concatenate([mirrored, values, beyond])
    first, second = np.diff(padded), np.diff(padded, 2)
    # Differences from t - REACH to t + REACH around every sample t.
    speed = running_median(first, 2 * _REACH)
    bend = running_median(second, 2 * _REACH - 1)
    predictions = [
        padded[_REACH + j : _REACH + j + values.size] - j * speed - 0.5 * j * j * bend
        for j in (-3, -2, -1, 1, 2, 3)
    ]
    if not lone:
        # As `np.median(predictions, axis=0)`.
        every = np.stack(predictions, axis=1).ravel()
        sizes = np.abs(values - _ranks(every, len(predictions), 2, 3, len(predictions)))
        return _beyond_neighbours(sizes, values)
    sides = np.median(np.reshape(predictions, (2, 3, values.size)), axis=1)
    above, below = values - sides.max(axis=0), sides.min(axis=0) - values
    return np.asarray(np.maximum(np.maximum(above, below), 0.0))


def _beyond_neighbours(sizes: FloatArray, values: FloatArray) -> FloatArray:
    """Sizes of what is a spike by its nearest samples, too; 0 for the others.

    Ringing lies off a cubic through them by far less than off medians over a dozen samples. A
    spike does not, nor do those beside it, by two thirds of the spike and the other way. The first
    and the last sample have no such cubic: as spikes they pull that of the next but one,
    by a sixth.

    Parameters
    ----------
    sizes, values : (N,) array
    """
    far_low, low, mid, high, far_high = (values[k : values.size - 4 + k] for k in range(5))
    cubic = np.pad(np.abs(mid - (4.0 * (low + high) - far_low - far_high) / 6.0), 2)
    before, behind = (np.pad(cubic, 1)[k : k + sizes.size] for k in (0, 2))
    # Two spikes side by side may hide one another from their own cubics.
    seen = np.maximum(cubic, np.maximum(before, behind)) > _SEEN * sizes
    around, usual = _around(cubic), _around(sizes)
    seen[[0, -1]] = (cubic > _BEYOND * around)[[2, -3]]
    # Beside a spike in ringing only the cubic is far off.
    own = (cubic < 2.0 * sizes) | (usual < 2.0 * around)
    some = seen & own & (sizes > _BEYOND * usual)
    lone = (cubic > np.maximum(before, behind)) & (cubic > _BEYOND * around)
    return np.where(some, sizes, np.where(lone, np.minimum(sizes, cubic), 0.0))


def _around(sizes: FloatArray) -> FloatArray:
    """What is usual before each sample or behind it, on the side where that is more."""
    padded = np.pad(sizes, _BESIDE, mode="reflect")
    usual = _ranks(padded, _BESIDE, _USUAL, _USUAL)
    return np.asarray(np.maximum(usual[: sizes.size], usual[_BESIDE + 1 :]))


def running_median(values: FloatArray, width: int) -> FloatArray:
    """Median of every so many samples in a row.

    Parameters
    ----------
    values : (N,) array
        Finite.
    width : int
        At most N.

    Returns
    -------
    (N - width + 1,) array
    """
    return _ranks(values, width, (width - 1) // 2, width // 2)


def _ranks(values: FloatArray, width: int, low: int, high: int, step: int = 1) -> FloatArray:
    from hydro_ident.estimate.signals.rank_kernels import running_ranks

    result = np.empty((values.size - width) // step + 1)
    running_ranks(np.ascontiguousarray(values), width, step, low, high, result)
    return result


def _end(values: FloatArray) -> float:
    """The first value as those behind it put it: it may be a spike itself."""
    near = values[1 : 2 * _REACH + 1]
    speed, bend = np.median(np.diff(near)[:_REACH]), np.median(np.diff(near, 2))
    # The speed is that of the middle of its samples.
    ahead = np.arange(1.0, 4.0)
    middle = 0.5 * (_REACH + 2.0)
    return float(np.median(near[:3] - ahead * speed - 0.5 * ahead * (ahead - 2.0 * middle) * bend))
