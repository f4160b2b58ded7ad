"""A signal from its neighbours in time: the same motion, without the noise of its own reading."""

from __future__ import annotations

import math

import numpy as np

from hydro_model.robot import FloatArray

#: Samples this far away stand for the one between them. White noise and dithered rounding are
#: forgotten from one sample to the next, a transducer's filter of 80 Hz (2 ms) over 5 ms; of a
#: crane's hydraulic mode (1.6 to 4.4 Hz) 10 ms leave 97 %.
_NEAR_S, _FAR_S = 0.005, 0.010


def neighbour_mean(values: FloatArray, step_s: float, span: int) -> FloatArray:
    """Means of the samples 5 to 10 ms before and behind each, one of either side at least.

    They are for differences over `span` intervals. Where that is one, either end is the other's
    neighbour: the sample itself then counts, too, and drops out of the difference with it.

    Parameters
    ----------
    values : (N, ...) array
        NaN where unknown.
    step_s : float
        Sampling interval.
    span : int
        From 1 on.

    Returns
    -------
    (N, ...) array
        Of those that are known; the sample itself where none is.
    """
    first = max(1, math.ceil(_NEAR_S / step_s - 1e-6))
    last = max(first, math.floor(_FAR_S / step_s + 1e-6))
    known = np.isfinite(values)
    filled = np.where(known, values, 0.0)
    itself = 1.0 if span == 1 else 0.0
    total, count = itself * filled, itself * known
    for lag in range(first, min(last, len(values) - 1) + 1):
        total[lag:] += filled[:-lag]
        total[:-lag] += filled[lag:]
        count[lag:] += known[:-lag]
        count[:-lag] += known[lag:]
    return np.where(count > 0.0, total / np.maximum(count, 1.0), values)
