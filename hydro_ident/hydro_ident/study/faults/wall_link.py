"""Faults of the bridge's own end of the bus, which no proxy reaches, with real processes."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from hydro_hw_bridge.bus.simulated_faults import INTERFACE, begun_ns
from hydro_hw_bridge.faults.bus_faults import LINK
from hydro_hw_bridge.faults.naming import Named
from hydro_ident.errors import IdentError
from hydro_ident.study.faults.promised import WATCHDOG_MS
from hydro_ident.study.faults.stage import until
from hydro_ident.study.faults.wall_outcomes import WallOutcome, worst_of
from hydro_ident.study.faults.wall_time import LATCHED_S, WallRun

GONE, WELL = "gone", "ok"
#: What each has to show as: counters, and words of the trip's reason.
NAMED = {
    "bus_off": Named(("bus_error_frames",), "bus-off"),
    "queue_full": Named(("bus_dropped",), "valve frames cannot be sent"),
}
#: What a bridge that has lost its interface says last.
LOST_WORDS = "the interface is gone"


class LinkDeeds:
    """Injections into the interface that the bridge opens, as it names it by its parameter.

    Parameters
    ----------
    run : WallRun
    """

    def __init__(self, run: WallRun) -> None:
        self._run = run
        self._control = run.stage.folder / "link"

    def deeds(self) -> dict[str, Callable[[random.Random], WallOutcome]]:
        """Injections by kind."""
        deeds = {kind: self._gone if kind == GONE else self._cut for kind in LINK}
        return {f"bus, own end: {kind}": partial(deed, kind) for kind, deed in deeds.items()}

    @contextmanager
    def _bridge_with_faults(self) -> Iterator[None]:
        """A bridge whose interface fails on command, in the place of the other one meanwhile."""
        run = self._run
        _, _, place = run.bridge_bus.partition(":")
        self._control.write_text(WELL, encoding="utf-8")
        run.stage.end("bridge")
        try:
            run.start_bridge(f"{INTERFACE}:{place}:{self._control}")
            yield
        finally:
            run.stage.end("bridge")
        run.start_bridge()

    def _begin(self, word: str) -> int:
        """Let the interface be as the word says; the monotonic time, ns, at which it was."""
        said = len(self._run.stage.said("bridge"))
        self._run.stage.mark()
        self._control.write_text(word, encoding="utf-8")
        told = partial(self._told_ns, word, said)
        until(lambda: told() is not None, 5.0, f"the interface to be '{word}'")
        return told() or 0

    def _told_ns(self, word: str, said: int) -> int | None:
        return begun_ns(self._run.stage.said("bridge")[said:], word)

    def _cut(self, kind: str, source: random.Random) -> WallOutcome:
        """The bridge hears or sends nothing: 0 V by the amplifiers, latched, named, cleared."""
        run = self._run
        with self._bridge_with_faults():
            before = run.drive_and_ask()
            time.sleep(source.uniform(0.0, 0.05))
            since = self._begin(kind)
            found = run.measured(f"bus, own end: {kind}", since, WATCHDOG_MS)
            found = worst_of(found, run.not_shown(NAMED[kind], before, drives_on=False))
            cleared, said = run.ros.clear_trip()
            found = worst_of(found, f"cleared while it stands: {said}" if cleared else "")
            back = self._begin(WELL)
            time.sleep(2 * LATCHED_S)
            moved = run.stage.moved_ns(back) is not None
            found = worst_of(found, "driven unasked once the bus was back" if moved else "")
            run.drive()
            return found

    def _gone(self, kind: str, source: random.Random) -> WallOutcome:
        """The bridge ends and says why; another one, once it is back, is not driven unasked."""
        run = self._run
        with self._bridge_with_faults():
            run.drive()
            time.sleep(source.uniform(0.0, 0.05))
            since = self._begin(kind)
            found = run.measured(f"bus, own end: {kind}", since, WATCHDOG_MS)
            until(lambda: not run.stage.running("bridge"), 10.0, "the bridge to end")
            try:
                until(self._lost, 5.0, "its last diagnostics")
            except IdentError:
                found = worst_of(found, f"not in /diagnostics: {LOST_WORDS}")
            run.ros.publishing = False
        time.sleep(2 * LATCHED_S)
        moved = run.stage.moved_ns(since + round(1e6 * (found.stop_ms or 0.0))) is not None
        return worst_of(found, "driven unasked by the next bridge" if moved else "")

    def _lost(self) -> bool:
        return LOST_WORDS in self._run.ros.diagnosis.get("can_bridge", {}).get("message", "")
