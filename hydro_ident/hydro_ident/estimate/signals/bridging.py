"""Pieces of a recording joined over short holes.

A lost message makes a hole of a cycle or two. What is looked at is slower than that by far, but a
filter needs some tenths of a second to settle at either side: a recording that loses a message
twice a second would have nothing left. Over a short hole positions, pressures and torques go
along the cubic through the two readings at either side (Lagrange's polynomial), whose error is
(w h)^4 3 / 128 of what swings at w, over an interval h between readings: 6e-6 at 5 Hz and 4 ms, a
lost cycle of 2 ms. What a valve was told meanwhile is not known, and stays unknown
(`mismatch.rows.lost_signals`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from hydro_model.arrays import BoolArray, IntArray
from hydro_model.robot import FloatArray

if TYPE_CHECKING:
    from hydro_ident.estimate.signals.traces import Trace

_Values = TypeVar("_Values", FloatArray, BoolArray)

#: Longest hole that is bridged, s; a single cycle always is.
LONGEST_HOLE_S = 0.01


@dataclass(frozen=True, slots=True)
class Stretch:
    """Parts of a recording's grid that follow each other with short holes between them.

    Attributes
    ----------
    parts : tuple of slice
        Cycles of the grid, without a hole each.
    holes : tuple of int
        Cycles missing between each part and the next.
    """

    parts: tuple[slice, ...]
    holes: tuple[int, ...] = ()

    def core(self, own: slice) -> tuple[int, int] | None:
        """Samples of the joined parts that a core of cycles owns: begin and end; None: none.

        A hole belongs to the cycle before it.

        Parameters
        ----------
        own : slice
        """
        edges = [self._first_from(cycle) for cycle in (own.start, own.stop)]
        return (edges[0], edges[1]) if edges[0] < edges[1] else None

    def cycles(self, own: slice) -> int:
        """How many cycles of a core were read.

        Parameters
        ----------
        own : slice
        """
        return sum(
            max(0, min(part.stop, own.stop) - max(part.start, own.start)) for part in self.parts
        )

    def _first_from(self, cycle: int) -> int:
        """The first sample that is no earlier than a cycle of the grid; past the last one."""
        begin: int = 0
        for part, hole in zip(self.parts, (*self.holes, 0), strict=True):
            if cycle < part.stop:
                return begin + max(int(cycle - part.start), 0)
            begin += part.stop - part.start + hole
        return begin


def longest_hole(period_s: float) -> int:
    """Most cycles of a hole that is bridged.

    Parameters
    ----------
    period_s : float
    """
    return max(1, int(LONGEST_HOLE_S / period_s + 1e-9))


def stretches(
    parts: Sequence[slice],
    stamp_ns: IntArray,
    period_s: float,
    borders: Collection[int] = (),
) -> list[Stretch]:
    """Parts of a recording, those together between which only a short hole is.

    Parameters
    ----------
    parts : sequence of slice
        Cycles of the grid in order, without a hole each.
    stamp_ns : (N,) array
        Of the grid.
    period_s : float
    borders : collection of int
        Cycles before which a stretch ends in any case.

    Returns
    -------
    list of Stretch
    """
    longest, found = longest_hole(period_s), list[Stretch]()
    for part in parts:
        if found:
            one = found[-1]
            last = one.parts[-1].stop - 1
            # A cycle without a reading is on the grid, one that was lost altogether is not.
            cycles = round(int(stamp_ns[part.start] - stamp_ns[last]) * 1e-9 / period_s)
            hole = max(part.start - last, cycles) - 1
            if hole <= longest and not any(last < border <= part.start for border in borders):
                found[-1] = Stretch((*one.parts, part), (*one.holes, hole))
                continue
        found.append(Stretch((part,)))
    return found


def joined(traces: Sequence[Trace], holes: Sequence[int]) -> Trace:
    """One trace of several that follow each other.

    Parameters
    ----------
    traces : sequence of Trace
        At least one, of two samples or more each.
    holes : sequence of int
        Cycles missing between each of them and the next.

    Returns
    -------
    Trace
        With the first one's label and cycle. The valves' signals are NaN in the holes.
    """
    if len(traces) == 1:
        return traces[0]
    cylinders = traces[0].valve_signal.shape[1]
    unknown = [np.full((n, cylinders), np.nan) for n in holes]
    return replace(
        traces[0],
        time_s=_bridged([t.time_s for t in traces], holes),
        q=_bridged([t.q for t in traces], holes),
        stroke=_bridged([t.stroke for t in traces], holes),
        p_a=_bridged([t.p_a for t in traces], holes),
        p_b=_bridged([t.p_b for t in traces], holes),
        supply=_bridged([t.supply for t in traces], holes),
        tank=_bridged([t.tank for t in traces], holes),
        valve_signal=_laid([t.valve_signal for t in traces], unknown),
        joint_torque=_bridged([t.joint_torque for t in traces], holes),
        q_ref=_complete([t.q_ref for t in traces], holes),
        oil_c=_complete([t.oil_c for t in traces], holes),
        latched=_latched(traces, holes),
    )


def _complete(parts: Sequence[FloatArray | None], holes: Sequence[int]) -> FloatArray | None:
    """What is there throughout or is not used at all."""
    known = [part for part in parts if part is not None]
    return _bridged(known, holes) if len(known) == len(parts) else None


def _bridged(parts: Sequence[FloatArray], holes: Sequence[int]) -> FloatArray:
    between = [
        _cubic(before[-2:], after[:2], n)
        for (before, after), n in zip(pairwise(parts), holes, strict=True)
    ]
    return _laid(parts, between)


def _cubic(before: FloatArray, after: FloatArray, count: int) -> FloatArray:
    """Lagrange's polynomial through two readings at either side of a hole, in the hole."""
    at = np.array([-1.0, 0.0, count + 1.0, count + 2.0])
    where = np.arange(1.0, count + 1.0)
    weights = np.ones((count, 4))
    for k in range(4):
        others = np.delete(at, k)
        weights[:, k] = np.prod((where[:, None] - others) / (at[k] - others), axis=1)
    return np.asarray(np.tensordot(weights, np.concatenate([before, after]), axes=1))


def _laid(parts: Sequence[_Values], between: Sequence[_Values]) -> _Values:
    """Parts with what lies between them, in turn."""
    result = [parts[0]]
    for hole, part in zip(between, parts[1:], strict=True):
        result += [hole, part]
    return np.concatenate(result)


def _latched(traces: Sequence[Trace], holes: Sequence[int]) -> BoolArray | None:
    """While every valve was held shut: in a hole as before it."""
    if all(t.latched is None for t in traces):
        return None
    parts = [
        np.zeros(t.samples, dtype=np.bool_) if t.latched is None else t.latched for t in traces
    ]
    held = [np.full(n, part[-1]) for n, part in zip(holes, parts[:-1], strict=True)]
    return _laid(parts, held)
