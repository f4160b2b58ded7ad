"""Evenly spread parts of long recordings: what of them is searched, fitted and verified on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hydro_ident.estimate.traces import Trace
from hydro_ident.mismatch.settings import PART_S


def spread_parts(traces: tuple[Trace, ...], longest_s: float) -> tuple[Trace, ...]:
    """Evenly spread parts of long recordings; recordings of usual length as they are.

    Parameters
    ----------
    traces : tuple of Trace
    longest_s : float
        Length of all parts together, each of `PART_S` or what a trace's share makes.

    Returns
    -------
    tuple of Trace
        The same object where nothing is left out.
    """
    total = _length_s(traces)
    if total <= longest_s:
        return traces
    parts: list[Trace] = []
    for trace in traces:
        own_s = trace.samples * trace.step_s * longest_s / total
        count = max(1, round(own_s / PART_S))
        size = round(own_s / count / trace.step_s)
        for k in range(count):
            begin = max(round((k + 0.5) * trace.samples / count - 0.5 * size), 0)
            parts.append(_part(trace, begin, min(begin + size, trace.samples), k))
    return tuple(parts)


def _length_s(traces: Sequence[Trace]) -> float:
    return sum(t.samples * t.step_s for t in traces)


def partly(what: str, whole: tuple[Trace, ...], parts: tuple[Trace, ...]) -> tuple[str, ...]:
    """How much of long recordings was looked at."""
    if parts is whole:
        return ()
    return (
        f"{what} {_length_s(parts):.0f} s of {_length_s(whole):.0f} s recorded, in {len(parts)}"
        " evenly spread parts (--longest for more)",
    )


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
    )
