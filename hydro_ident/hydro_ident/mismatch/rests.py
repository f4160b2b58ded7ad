"""When joints rest, and how fast they usually go when they do not."""

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
#: Share of sizes that are not exceeded by the usual one; and which they are taken of: those
#: beyond so much of what a thousandth of all exceeds.
_HARDLY, _SOME, _TOP = 0.95, 0.1, 0.999


def usual_size(sizes: Sequence[FloatArray], share: float = _HARDLY) -> float | None:
    """Size that is hardly exceeded while there is something; None where none is known.

    Of a joint that moves now and then, most speeds are a rest's noise: what hardly any of them
    exceeds would be noise as well, and nothing a rest.

    Parameters
    ----------
    sizes : sequence of (T,) array
        Speeds or other sizes, 0 or more. Unknown ones are NaN.
    share : float
        Of those beyond a rest, which is not exceeded.

    Returns
    -------
    float or None
        0 where nothing ever is.
    """
    known = np.concatenate([np.zeros(0), *sizes])
    known = known[np.isfinite(known)]
    if not known.size:
        return None
    beyond = known[known > _SOME * float(np.quantile(known, _TOP))]
    return float(np.quantile(beyond, share)) if beyond.size else 0.0


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


def directions(velocity: FloatArray, least: float, step_s: float) -> list[int]:
    """Directions of motions one after the other, 1 or -1; the same ones repeat.

    Parameters
    ----------
    velocity : (T,) array
    least : float
        Speed beyond which a joint moves.
    step_s : float
        Sampling interval.
    """
    found = [
        (begin, way)
        for way in (1, -1)
        for begin, end in runs(way * velocity > least)
        if (end - begin) * step_s >= REST_S
    ]
    return [way for _, way in sorted(found)]
