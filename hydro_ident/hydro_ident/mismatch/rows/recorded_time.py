"""Time that was recorded: its spans, and instants spread over them."""

from __future__ import annotations

import numpy as np

from hydro_ident.mismatch.rows.material import Material

#: A hole that is no pause, and what at least lies between two instants, in s.
INSTANT_S = 2.0


def recorded_spans(material: Material) -> list[tuple[float, float]]:
    """Spans of any recording without a pause, each recording from its beginning on.

    Parameters
    ----------
    material : Material
        With rows.

    Returns
    -------
    list of (float, float)
        When each begins and ends, in s, in order of time and apart.
    """
    last = float(material.time_s.max())
    times = sorted(
        (float(s.trace.time_s[0]), float(s.trace.time_s[-1])) for s in material.stretches
    )
    begin, end = times[0]
    spans = []
    for next_begin, next_end in times[1:]:
        if next_begin - end > INSTANT_S:
            spans.append((begin, end))
            begin = next_begin
        end = max(end, next_end)
    spans.append((begin, end))
    # Rows are thinner than samples: what is after the last of them shows in none.
    spans = [(a, min(b, last)) for a, b in spans if a < last]
    first, until = spans[0]
    return [(0.0 if first <= INSTANT_S else first, until), *spans[1:]]


def spread_instants(material: Material, most: int) -> list[float]:
    """Instants evenly over what was recorded, as if it had no pauses.

    Parameters
    ----------
    material : Material
    most : int
        How many at most; fewer where they would lie closer than 2 s.

    Returns
    -------
    list of float
        In s, in order; empty without rows.
    """
    if not material.size:
        return []
    begins, ends = np.array(recorded_spans(material)).T
    passed = np.concatenate(([0.0], np.cumsum(ends - begins)))
    count = int(min(most, max(1, passed[-1] / INSTANT_S - 1)))
    at = np.linspace(0.0, passed[-1], count + 2)[1:-1]
    span = np.clip(np.searchsorted(passed, at, side="right") - 1, 0, begins.size - 1)
    return [float(t) for t in begins[span] + (at - passed[span])]
