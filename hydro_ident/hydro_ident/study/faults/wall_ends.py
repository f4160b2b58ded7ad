"""Faults at the machine's two ends, with real processes: permissives, and publishers."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from functools import partial

from hydro_hw_bridge.faults.bus_injections import TOO_OLD
from hydro_hw_bridge.faults.command_faults import BAD, HARMLESS
from hydro_hw_bridge.faults.machine_faults import MISSING
from hydro_hw_bridge.faults.measured_rig import ALL
from hydro_hw_bridge.faults.naming import Named
from hydro_hw_bridge.faults.other_injections import HARMLESS_SHOWS, SAID
from hydro_hw_bridge.gate.output_ramp import REENABLE_S
from hydro_ident.study.faults.promised import AGE_MS, AT_ONCE_MS
from hydro_ident.study.faults.stage import until
from hydro_ident.study.faults.wall_outcomes import Judgement, WallOutcome, worst_of
from hydro_ident.study.faults.wall_time import LATCHED_S, WallRun

#: Sizes of the faults of publishers that have one, in the unit of their kind.
_AMOUNT = {"beyond": 10.5, "leap": 8.0, "second_controller": 5.0, "late": 15.0}
#: For how many cycles those last that do not act by a single command.
_CYCLES = {"silent": 40, "late": 40, "twice": 40, "backwards": 40}


class EndDeeds:
    """Injections into the publisher of commands and into what lets the machine drive.

    Parameters
    ----------
    run : WallRun
    """

    def __init__(self, run: WallRun) -> None:
        self._run = run

    def deeds(self) -> dict[str, Callable[[random.Random], WallOutcome]]:
        """Injections by kind."""
        deeds: dict[str, Callable[[random.Random], WallOutcome]] = {
            f"publisher: {kind}": partial(self._publisher, kind)
            for kind in (*BAD, "silent", "late", *HARMLESS)
        }
        deeds |= {f"machine: {kind}": partial(self._permissive, kind) for kind in MISSING}
        return deeds | {"driven again after a trip": self._again}

    def _publisher(self, kind: str, source: random.Random) -> WallOutcome:
        """Bad, late or no commands end driving, and are named; harmless ones are counted."""
        run, harmless = self._run, kind in HARMLESS
        named = Named(("trips",), SAID.get(kind, TOO_OLD))
        limit_ms: float | None = AGE_MS if kind in _CYCLES else AT_ONCE_MS
        if harmless:
            named, limit_ms = Named((HARMLESS_SHOWS[kind],)), None
        before = run.drive_and_ask()
        cycles, amount = _CYCLES.get(kind, 1), _AMOUNT.get(kind, 0.0)
        run.stage.mark()
        run.ros.begin_fault(kind, cycles, amount, source.randrange(2))
        until(lambda: run.ros.fault_at_ns is not None, 5.0, "the fault to begin")
        found = run.measured(f"publisher: {kind}", run.ros.fault_at_ns or 0, limit_ms)
        found = worst_of(found, run.not_shown(named, before, drives_on=harmless))
        if not harmless:  # else the gate has no trip, and would see the publisher leap to 0 V
            run.ros.end_fault()
        return found

    def _permissive(self, kind: str, source: random.Random) -> WallOutcome:
        """One opens, and closes again: the trip stays."""
        run = self._run
        before = run.drive_and_ask()
        time.sleep(source.uniform(0.0, 0.05))
        since = run.stage.tell_timed("rig", kind)
        found = run.measured(f"machine: {kind}", since, AT_ONCE_MS)
        closed = run.stage.tell_timed("rig", ALL)
        named = Named(("trips",), MISSING[kind])
        found = worst_of(found, run.not_shown(named, before, drives_on=False))
        time.sleep(LATCHED_S)
        moved = run.stage.moved_ns(closed) is not None
        return worst_of(found, "not latched" if moved else "")

    def _again(self, source: random.Random) -> WallOutcome:
        """After a trip that was cleared the valves are slow for a second."""
        found = self._permissive(source.choice(tuple(MISSING)), source)
        run = self._run
        run.drive()
        # Not only until the fault that comes next: the whole second.
        time.sleep(REENABLE_S)
        again = run.measured("driven again after a trip", time.monotonic_ns(), None)
        return worst_of(again, Judgement(found.broken, found.excused))
