"""Noise that is added to positions, to see what theirs does to a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro_ident.estimate.signals.traces import Trace
from hydro_model.robot import FloatArray

#: Samples that are drawn at a time.
_DRAWN = 4096


def with_position_noise(trace: Trace, std: FloatArray) -> Trace:
    """A trace with white noise added to its positions.

    A sample's noise depends on its number in the recording alone: pieces that overlap agree.

    Parameters
    ----------
    trace : Trace
    std : (n,) array
        Standard deviations, rad or m; those of a negative sign give the opposite noise.
    """
    first, joints = trace.cycle, trace.q.shape[1]
    begin, end = first // _DRAWN, (first + trace.samples - 1) // _DRAWN
    drawn = [
        np.random.default_rng([_DRAWN, k]).standard_normal((_DRAWN, joints))
        for k in range(begin, end + 1)
    ]
    start = first - begin * _DRAWN
    noise = np.concatenate(drawn)[start : start + trace.samples]
    return replace(trace, q=trace.q + std * noise)
