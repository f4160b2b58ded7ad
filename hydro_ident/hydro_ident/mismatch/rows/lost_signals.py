"""Valve signals of which samples were lost: what a valve did meanwhile, and what of it is unknown.

Rows whose windows touch a lost sample are left out. But a delay moves it to later rows, and a lag
answers to it long after: taken for no signal at all, one lost message would be a flow that is
missing there, or a spool that rings. A valve holds what it was told last; over a small part of a
window that is as good as known. Over a longer hole it is not: rows that any delay may move it to
are left out, too.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.mismatch.settings import LONGEST_DELAY_S
from hydro_model.arrays import BoolArray
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.robot import FloatArray

#: As late as a command may come: by the effect of that name, and by what a base has of it.
LATEST_S = CATALOGUE["command_delay"].parameters[0].upper + LONGEST_DELAY_S
#: Holes of up to this share of a window are held: windows are a tenth of the period of what
#: commands do, which then changes by 2 pi / 40 of its size, in a quarter of the window.
_SHORT = 0.25


def held_signal(signal: FloatArray, longest: int) -> FloatArray:
    """A valve's signal, held over short holes.

    Parameters
    ----------
    signal : (N,) array
    longest : int
        Samples of a hole that is short.

    Returns
    -------
    (N,) array
        NaN in longer holes, and before the first known sample; the same object without a hole.
    """
    unknown = ~np.isfinite(signal)
    if not unknown.any():
        return signal
    result = signal.copy()
    for begin, end in runs(unknown):
        if begin and end - begin <= longest:
            result[begin:end] = signal[begin - 1]
    return result


def held_trace(trace: Trace, span: int) -> Trace:
    """A trace whose valves hold their signals over short holes; the same one without any.

    Parameters
    ----------
    trace : Trace
    span : int
        Samples of a window.
    """
    if np.isfinite(trace.valve_signal).all():
        return trace
    longest = math.floor(_SHORT * span)
    columns = [held_signal(u, longest) for u in trace.valve_signal.T]
    return replace(trace, valve_signal=np.stack(columns, axis=1))


def out_of_reach(signal: FloatArray, step_s: float, delay_s: float) -> BoolArray:
    """Sampling intervals whose signal is known however late it comes.

    Parameters
    ----------
    signal : (N,) array
        Held over short holes.
    step_s : float
    delay_s : float
        That the robot file states: before the recording nothing is known.

    Returns
    -------
    (N - 1,) bool array
    """
    result = np.ones(max(signal.size - 1, 0), dtype=np.bool_)
    result[: math.ceil(delay_s / step_s) + 1 if delay_s > LONGEST_DELAY_S else 0] = False
    reach = math.ceil(LATEST_S / step_s)
    for begin, end in runs(~np.isfinite(signal)):
        result[max(begin - 1, 0) : end + reach] = False
    return result
