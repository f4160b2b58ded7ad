"""What injections into running processes gave, and how it is published."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro_ident.study.faults.stage import Stage


@dataclass(frozen=True, slots=True)
class WallOutcome:
    """One injection into running processes.

    Attributes
    ----------
    kind : str
    limit_ms, stop_ms : float or None
        Promised and measured, from the fault to the valves at 0 V; None where driving on is right.
    late_timer_ms : float
        Greatest lateness of the bare timer meanwhile.
    broken : str
        What was not kept, beyond the time; empty where all was.
    """

    kind: str
    limit_ms: float | None
    stop_ms: float | None
    late_timer_ms: float
    broken: str


def worst_of(outcome: WallOutcome, also: str) -> WallOutcome:
    """An outcome of which something more was not kept.

    `also` says what, empty where nothing is: the first that was found stays.
    """
    return outcome if outcome.broken else replace(outcome, broken=also)


def summary(found: list[WallOutcome], stage: Stage, unasked: int, left_out: int) -> dict[str, Any]:
    """Outcomes as they are published, beside the bare timer's lateness.

    `unasked` counts trips that nobody caused, `left_out` what could not be judged.
    """
    kinds: dict[str, list[WallOutcome]] = {}
    for one in found:
        kinds.setdefault(one.kind, []).append(one)
    _, late = stage.timer_lateness()
    late_ms = late / 1e6
    return {
        "injections": len(found),
        "left_out": left_out,
        "trips_by_the_busy_computer": unasked,
        "kinds": {kind: _row(of) for kind, of in sorted(kinds.items())},
        "timer_late_ms": {
            **{f"p{p:g}": float(np.percentile(late_ms, p)) for p in (50, 99, 99.9)},
            "max": float(late_ms.max()),
            "wakes": int(late_ms.size),
        },
        "broken": [{"kind": one.kind, "what": one.broken} for one in found if one.broken],
    }


def _row(found: list[WallOutcome]) -> dict[str, Any]:
    """A kind as a whole, and by each promise that injections of it were held to."""
    row: dict[str, Any] = {"injections": len(found), **_times(found)}
    limits = sorted({one.limit_ms for one in found if one.limit_ms is not None})
    by_limit = [[one for one in found if one.limit_ms == limit] for limit in limits]
    return row | {"promises": [{"injections": len(of), **_times(of)} for of in by_limit]}


def _times(found: list[WallOutcome]) -> dict[str, Any]:
    stops = [one for one in found if one.limit_ms is not None and one.stop_ms is not None]
    if not stops:
        return {}
    times = [one.stop_ms or 0.0 for one in stops]
    above = [o for o in stops if (o.stop_ms or 0.0) > (o.limit_ms or 0.0)]
    stalls = [o for o in above if (o.stop_ms or 0.0) - (o.limit_ms or 0.0) <= o.late_timer_ms]
    return {
        "promised_ms": stops[0].limit_ms,
        "p50_ms": float(np.percentile(times, 50)),
        "p90_ms": float(np.percentile(times, 90)),
        "max_ms": max(times),
        "above": len(above),
        "above_with_the_timer_as_late": len(stalls),
        "timer_max_ms": max(one.late_timer_ms for one in stops),
    }
