"""From sensor frame to valve frame: bridge and controller against the echo of their messages."""

from __future__ import annotations

import statistics
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass

from hydro_ident.bench.chain import LARGEST_AGE_MS, Running, echo, product
from hydro_ident.bench.job import Row, against_limit, ratio_of
from hydro_ident.bench.processes import cpu_s
from hydro_ident.bench.timed_bus import IN_FLIGHT, lateness
from hydro_ident.errors import IdentError

SECONDS, _SETTLE_S = 20.0, 1.0
_ECHO_GOAL, _CPU_LIMIT = 1.0 / 1.5, 0.30
#: With more of the cycles unanswered than this the machine cannot keep the rate.
_LOST_SHARE = 0.02
ECHO = "rclpy echo over the same bus"
#: Of the rows in which an answer to a newer cycle counts as well.
REACTION = " as new or newer"
QUANTILES = {"p50": 50.0, "p99.9": 99.9}


@dataclass(frozen=True, slots=True)
class Round:
    """One chain for a while.

    Attributes
    ----------
    latency_s, reaction_s : dict of str to float
        By `QUANTILES`, over all cycles: those that never were are infinitely late.
    core_share : dict of str to float
        CPU time of each process by wall time.
    lost, cycles : int
        Cycles that were never answered, of how many.
    """

    latency_s: dict[str, float]
    reaction_s: dict[str, float]
    core_share: dict[str, float]
    lost: int
    cycles: int


def measured(chain: AbstractContextManager[Running], seconds: float) -> Round:
    """Run a chain, then take its measure.

    Parameters
    ----------
    chain : context manager of Running
    seconds : float
        How long it is measured.

    Raises
    ------
    IdentError
        It does not answer, or leaves too many cycles unanswered.
    """
    with chain as running:
        time.sleep(_SETTLE_S)
        running.bus.begin()
        began = time.perf_counter()
        before = _cpu_s(running)
        time.sleep(seconds)
        after, wall = _cpu_s(running), time.perf_counter() - began
        lost, cycles = running.bus.lost, running.bus.cycles
        times, reactions = running.bus.latencies_s(), running.bus.reactions_s()
        running.check()
    if not times.size or lost > _LOST_SHARE * cycles:
        raise IdentError(
            f"chain: {lost} of {cycles} cycles were not answered, expected at most"
            f" {_LOST_SHARE:.0%}: the machine is too busy to measure it"
        )
    shares = {name: (after[name] - before[name]) / wall for name in after}
    unmet = max(cycles - reactions.size - IN_FLIGHT, 0)
    late = {name: lateness(times, lost, at) for name, at in QUANTILES.items()}
    reacted = {name: lateness(reactions, unmet, at) for name, at in QUANTILES.items()}
    return Round(late, reacted, shares, lost, cycles)


def chain_rows(rounds: int, seconds: float = SECONDS) -> list[Row]:
    """Latencies against the echo and CPU against its limit, in turns.

    Parameters
    ----------
    rounds : int
        Of both.
    seconds : float
        Of each.
    """
    pairs = [
        (measured(_patient(seconds), seconds), measured(echo(), seconds)) for _ in range(rounds)
    ]
    products, echoes = zip(*pairs, strict=True)
    counts = {
        "lost_ours": sum(one.lost for one in products),
        "cycles_ours": sum(one.cycles for one in products),
        "lost_theirs": sum(one.lost for one in echoes),
        "cycles_theirs": sum(one.cycles for one in echoes),
    }
    rows = []
    for kind, of in (("", "latency_s"), (REACTION, "reaction_s")):
        for name in QUANTILES:
            ours, theirs = (
                statistics.median(getattr(one, of)[name] for one in side)
                for side in (products, echoes)
            )
            job = f"bridge and controller, sensor frame to valve frame{kind}, {name}"
            ratio = ratio_of(theirs, ours)
            rows.append(Row(job, ECHO, ours, theirs, ratio, _ECHO_GOAL, rounds, **counts))
    for name in ("bridge", "controller"):
        share = statistics.median(one.core_share[name] for one in products)
        job = f"{name} at 500 Hz: share of a core"
        rows.append(against_limit(job, "30 % of a core", share, _CPU_LIMIT, rounds=rounds))
    return rows


def _patient(seconds: float) -> AbstractContextManager[Running]:
    """The product with a gate that forgives: one late command shall not end the measurement."""
    return product(seconds / 60.0, LARGEST_AGE_MS)


def _cpu_s(running: Running) -> dict[str, float]:
    """CPU time of every process so far, s."""
    return {name: cpu_s(process.pid) for name, process in running.processes.items()}
