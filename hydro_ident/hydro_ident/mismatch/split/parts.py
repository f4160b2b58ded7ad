"""Evenly spread parts of long recordings: what of them is searched, fitted and verified on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hydro_ident.estimate.scoring.scores import HoldOut, Parts
from hydro_ident.estimate.signals.traces import Trace
from hydro_ident.identify.survey import Survey
from hydro_ident.mismatch.fitting.training import Training
from hydro_ident.mismatch.rows.choices import Choices
from hydro_ident.mismatch.rows.material import Material
from hydro_ident.mismatch.settings import PART_S
from hydro_model.arrays import BoolArray

#: Rows of a channel below this share of what a search would have of it are told: of so few a
#: search sees effects of twice the usual size at best, as what rows tell grows with their root.
_THIN = 0.25
#: So are channels of which less than this share of the rows is held out, where a fifth is usual.
_HARDLY_HELD = 0.1


def spread_parts(traces: tuple[Trace, ...], longest_s: float) -> tuple[Trace, ...]:
    """Evenly spread parts of long recordings; recordings of usual length as they are.

    Windows of `PART_S` or a little more lie evenly over all traces, one after the other. A trace
    that is shorter than a window is taken whole or not at all: filters take half a second and more
    off both ends of every piece, and of many short pieces they would leave nothing.

    Parameters
    ----------
    traces : tuple of Trace
    longest_s : float
        Length of all parts together, up to what whole traces make of it.

    Returns
    -------
    tuple of Trace
        Each of `PART_S` at least, or a whole trace; the same object where nothing is left out.
    """
    total = length_s(traces)
    if total <= longest_s:
        return traces
    windows = max(1, math.floor(longest_s / PART_S + 1e-9))
    window_s = longest_s / windows
    parts: list[Trace] = []
    before_s = 0.0
    for trace in traces:
        own_s = length_s([trace])
        # Windows are counted by their middles, half a spacing from where theirs begins.
        begin, end = (windows * s / total for s in (before_s, before_s + own_s))
        if own_s >= window_s:
            parts += _cut(trace, math.floor(end + 0.5) - math.floor(begin + 0.5), window_s)
        elif abs((0.5 * (begin + end)) % 1.0 - 0.5) * total / windows <= 0.5 * window_s:
            parts.append(trace)
        before_s += own_s
    return tuple(parts)


def _cut(trace: Trace, windows: int, window_s: float) -> list[Trace]:
    """Evenly spread parts of a trace, of so many windows together; longer where they touch."""
    own_s = length_s([trace])
    count = min(windows, math.floor(own_s / window_s + 1e-9))
    if not count:
        return []
    size = round(min(windows * window_s, own_s) / count / trace.step_s)
    begins = [max(round((k + 0.5) * trace.samples / count - 0.5 * size), 0) for k in range(count)]
    return [
        _part(trace, begin, min(begin + size, trace.samples), k) for k, begin in enumerate(begins)
    ]


def length_s(traces: Sequence[Trace]) -> float:
    """Length of traces together.

    Parameters
    ----------
    traces : sequence of Trace
    """
    return sum(t.samples * t.step_s for t in traces)


def partly(what: str, whole: tuple[Trace, ...], parts: tuple[Trace, ...]) -> tuple[str, ...]:
    """How much of long recordings was looked at.

    `what` begins the sentence; `parts` are the stretches that were looked at.
    """
    if parts is whole:
        return ()
    return (
        f"{what} {length_s(parts):.0f} s of {length_s(whole):.0f} s recorded, in {len(parts)}"
        " evenly spread parts (--longest for more)",
    )


def split_of(
    surveys: Sequence[Survey],
    every: int,
    choices: Choices,
    whole: tuple[Trace, ...],
    parts: tuple[Trace, ...],
) -> HoldOut:
    """Which blocks of the training recordings are kept to verify on.

    Parameters
    ----------
    surveys : sequence of Survey
        Of these recordings.
    every : int
        0: none, where others are there for it.
    choices : Choices
    whole, parts : tuple of Trace
        All that was recorded, and what of it is fitted; the same object where that is all.
    """
    if not every:
        return HoldOut(every=0)
    durations = {s.name: max(s.duration_s, 1e-3) for s in surveys}
    own = None if parts is whole else _times(parts)
    return HoldOut.of(durations, every, parallel_hz=choices.filters.parallel_hz, parts=own)


def _times(parts: Sequence[Trace]) -> Parts:
    """Begins and ends of parts, by recording."""
    result: dict[str, list[tuple[float, float]]] = {}
    for part in parts:
        times = float(part.time_s[0]), float(part.time_s[-1]) + part.step_s
        result.setdefault(part.recording, []).append(times)
    return result


def hardly_held(material: Material, fit: BoolArray, held: BoolArray) -> tuple[str, ...]:
    """Which channels have hardly any rows to verify on, as holes may lie where blocks would.

    Parameters
    ----------
    material : Material
    fit, held : (N,) bool array
        Rows of it to fit and to verify on.
    """
    notes = []
    for k, name in enumerate(material.channels):
        count = int((held & (material.channel == k)).sum())
        share = count / max(count + int((fit & (material.channel == k)).sum()), 1)
        if share < _HARDLY_HELD:
            notes.append(
                f"of {name} {100.0 * share:.2g} % of the rows are held out, where a fifth is"
                " usual: what acts there is hardly verified; give a recording of its own for"
                " that (--validate)"
            )
    return tuple(notes)


def thinly(fitted: Training, searched: Training, share: float) -> tuple[str, ...]:
    """Which channels have far fewer rows to search on than their share of those that are fitted.

    Parameters
    ----------
    fitted, searched : Training
    share : float
        Length of what is searched by that of what is fitted.
    """
    there = list(searched.predictor.material.channels)
    counts = np.bincount(_channels(searched), minlength=len(there))
    of_fitted = np.bincount(_channels(fitted))
    notes = []
    for k, rows in enumerate(of_fitted.tolist()):
        name = fitted.predictor.material.channels[k]
        part = counts[there.index(name)] / max(rows, 1) if name in there else 0.0
        if rows and part < _THIN * share:
            notes.append(
                f"effects are searched on {100.0 * part:.2g} % of the rows of {name} that are"
                f" fitted, where {100.0 * share:.2g} % are usual:"
                " what acts there may be missed"
            )
    return tuple(notes)


def _channels(training: Training) -> NDArray[np.intp]:
    return training.predictor.material.channel[training.mask]


def _part(trace: Trace, begin: int, end: int, number: int) -> Trace:
    """Samples of a trace as a trace of its own, on the recording's time axis."""
    at = slice(begin, end)
    return replace(
        trace,
        label=f"{trace.label}.{number}",
        time_s=trace.time_s[at],
        q=trace.q[at],
        stroke=trace.stroke[at],
        p_a=trace.p_a[at],
        p_b=trace.p_b[at],
        supply=trace.supply[at],
        tank=trace.tank[at],
        valve_signal=trace.valve_signal[at],
        joint_torque=trace.joint_torque[at],
        cycle=trace.cycle + begin,
        core=None,
        q_ref=None,
        oil_c=None if trace.oil_c is None else trace.oil_c[at],
        latched=None if trace.latched is None else trace.latched[at],
    )
