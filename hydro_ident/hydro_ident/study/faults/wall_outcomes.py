"""What injections into running processes gave, and how it is published."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hydro_hw_bridge.core.supervision import READ_LATE
from hydro_hw_bridge.faults.bus_injections import NO_SYNC, NO_WHOLE, NOTHING_HEARD, TOO_OLD
from hydro_ident.study.faults.stage import Stage

#: Reasons of trips that a stall of any process on the way makes.
STALLS = (TOO_OLD, NO_WHOLE, NOTHING_HEARD, NO_SYNC, READ_LATE, "the amplifiers' watchdog")


@dataclass(frozen=True, slots=True)
class Judgement:
    """What was found of an injection beside the time.

    Attributes
    ----------
    broken : str
        What was not kept, in words; empty where all was.
    excused : str
        Reason of a trip by a computer that stalls, where it stands in the place of what had to
        be seen: then nothing is known of that, and nothing is broken.
    """

    broken: str = ""
    excused: str = ""


def judgement(missing: list[str], reason: str) -> Judgement:
    """What follows from what is missing, where a bridge has tripped or not.

    Parameters
    ----------
    missing : list of str
        In words; empty where nothing is.
    reason : str
        Of its trip; empty without one.
    """
    if not missing:
        return Judgement()
    if reason.startswith(STALLS):
        return Judgement(excused=reason)
    return Judgement("; ".join(missing))


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
    excused : str
        As of a `Judgement`.
    waited_ms : mapping of str to float
        How long each process on the way to the valves waited for a core, its longest thread, from
        just before the fault until the stop was seen.
    """

    kind: str
    limit_ms: float | None
    stop_ms: float | None
    late_timer_ms: float
    broken: str
    excused: str = ""
    waited_ms: Mapping[str, float] = field(default_factory=dict)

    @property
    def above_ms(self) -> float:
        """By how much it came later than promised; 0 or less where it did not."""
        return (self.stop_ms or 0.0) - (self.limit_ms or 0.0)

    @property
    def all_waited_ms(self) -> float:
        """Of all processes: a command passes through one after the other."""
        return sum(self.waited_ms.values())


def worst_of(outcome: WallOutcome, also: Judgement | str) -> WallOutcome:
    """An outcome of which something more was not kept, or could not be judged.

    `also` says what; a text is what was not kept, empty where nothing is. The first that was found
    stays.
    """
    more = also if isinstance(also, Judgement) else Judgement(also)
    broken, excused = outcome.broken or more.broken, outcome.excused or more.excused
    return replace(outcome, broken=broken, excused=excused)


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
        "excused_by_a_stall": sum(bool(one.excused) for one in found),
        "kinds": {kind: _row(of) for kind, of in sorted(kinds.items())},
        "beyond_promise_ms": _beyond(found),
        "timer_late_ms": {
            **{f"p{p:g}": float(np.percentile(late_ms, p)) for p in (50, 99, 99.9)},
            "max": float(late_ms.max()),
            "wakes": int(late_ms.size),
        },
        "broken": [{"kind": one.kind, "what": one.broken} for one in found if one.broken],
    }


def _beyond(found: list[WallOutcome]) -> dict[str, Any]:
    """How much later than promised the valves were at 0 V, of all kinds; below 0: sooner."""
    beyond = [w.above_ms for w in found if w.limit_ms is not None and w.stop_ms is not None]
    if not beyond:
        return {}
    quantiles = {f"p{p:g}": float(np.percentile(beyond, p)) for p in (50, 90, 99)}
    return {"injections": len(beyond), **quantiles, "max": max(beyond)}


def _row(found: list[WallOutcome]) -> dict[str, Any]:
    """A kind as a whole, and by each promise that injections of it were held to, or none."""
    limits = sorted({one.limit_ms for one in found if one.limit_ms is not None})
    by_limit = [[one for one in found if one.limit_ms == limit] for limit in (*limits, None)]
    return _told(found) | {"promises": [_told(of) for of in by_limit if of]}


def _told(found: list[WallOutcome]) -> dict[str, Any]:
    excused = sum(bool(one.excused) for one in found)
    counts = {"injections": len(found), "excused_by_a_stall": excused}
    return {**counts, **_times(found), **_waits([one for one in found if one.waited_ms])}


def _times(found: list[WallOutcome]) -> dict[str, Any]:
    stops = [one for one in found if one.limit_ms is not None and one.stop_ms is not None]
    if not stops:
        return {}
    times = [one.stop_ms or 0.0 for one in stops]
    above = [one for one in stops if one.above_ms > 0.0]
    late = [one.above_ms <= one.late_timer_ms for one in above]
    waited = [one.above_ms <= one.all_waited_ms for one in above]
    return {
        "promised_ms": stops[0].limit_ms,
        "p50_ms": float(np.percentile(times, 50)),
        "p90_ms": float(np.percentile(times, 90)),
        "max_ms": max(times),
        "above": len(above),
        "above_with_the_timer_as_late": sum(late),
        "above_with_as_much_waiting": sum(waited),
        "above_with_neither": sum(not (a or b) for a, b in zip(late, waited, strict=True)),
        "timer_max_ms": max(one.late_timer_ms for one in stops),
    }


def _waits(found: list[WallOutcome]) -> dict[str, Any]:
    """How long processes waited for a core: all of them, and the worst of each."""
    if not found:
        return {}
    waits = [one.all_waited_ms for one in found]
    names = sorted({name for one in found for name in one.waited_ms})
    worst = {name: max(one.waited_ms.get(name, 0.0) for one in found) for name in names}
    return {
        "waited_p50_ms": float(np.percentile(waits, 50)),
        "waited_max_ms": max(waits),
        "waited_max_ms_by_process": worst,
    }
