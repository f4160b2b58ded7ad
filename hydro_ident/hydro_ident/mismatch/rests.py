"""When joints rest, and how fast they usually go."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_ident.estimate.derivatives import FilterSettings, motion
from hydro_ident.estimate.rows import BoolArray
from hydro_ident.estimate.traces import Trace
from hydro_model.robot import FloatArray

#: A rest is at least this long, s; so is a motion.
REST_S = 0.1


def usual_speed(speeds: Sequence[FloatArray]) -> float | None:
    """Speed that is hardly exceeded; None where none is known.

    Parameters
    ----------
    speeds : sequence of (T,) array
        Unknown ones are NaN.
    """
    known = np.concatenate([np.zeros(0), *speeds])
    known = known[np.isfinite(known)]
    return float(np.quantile(known, 0.95)) if known.size else None


def known_velocities(trace: Trace, filters: FilterSettings) -> FloatArray | None:
    """Velocities (T, n) of joints known throughout, NaN of others; None where none is.

    Parameters
    ----------
    trace : Trace
    filters : FilterSettings
    """
    known = np.isfinite(trace.q).all(axis=0)
    if not known.any() or trace.samples <= 3 * filters.order:
        return None
    result = np.full(trace.q.shape, np.nan)
    result[:, known] = motion(trace.q[:, known], trace.step_s, filters)[1]
    return result


def lasting(slow: BoolArray, step_s: float, reach_s: float) -> BoolArray:
    """Samples in rests of some length, and around them as far as the filters reach.

    Parameters
    ----------
    slow : (T,) bool array
    step_s : float
        Sampling interval.
    reach_s : float
    """
    result = np.zeros(slow.size, dtype=np.bool_)
    reach = round(reach_s / step_s)
    for begin, end in runs(slow):
        if (end - begin) * step_s >= REST_S:
            result[max(begin - reach, 0) : end + reach] = True
    return result
