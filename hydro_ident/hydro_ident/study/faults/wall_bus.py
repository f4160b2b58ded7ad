"""What the campaign in device time draws for the bus, put on a real one by the proxy."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import asdict
from functools import partial

from hydro_hw_bridge.faults import bus_injections
from hydro_hw_bridge.faults.bus_faults import BusFault
from hydro_hw_bridge.faults.injection import Injection
from hydro_hw_bridge.faults.naming import Diagnosis
from hydro_hw_bridge.protocol.codec import Codec
from hydro_ident.errors import IdentError
from hydro_ident.study.faults.promised import wall_ms
from hydro_ident.study.faults.wall_outcomes import Judgement, WallOutcome, judgement, worst_of
from hydro_ident.study.faults.wall_time import WallRun
from hydro_model.robot import Robot

#: Draws an injection: as those of `bus_injections`.
Draw = Callable[[random.Random, Codec, int], Injection]
#: Without a stuck sensor, which needs a machine that moves; the bridge's own end of the bus, which
#: no proxy reaches, is that of `wall_link`.
DRAWN: dict[str, Draw] = {
    "lost": bus_injections.lost,
    "late": bus_injections.late,
    "split": bus_injections.split,
    "repeated": bus_injections.repeated,
    "reordered": bus_injections.reordered,
    "corrupt": bus_injections.corrupt,
    "counters": bus_injections.counters,
    "sensor": bus_injections.sensor,
    "babble": bus_injections.babble,
    "foreign": bus_injections.foreign,
    "intruder": bus_injections.intruder,
    "answers": bus_injections.answers,
}


class BusDeeds:
    """Faults on the bus, each drawn as in device time, judged by valves and `/diagnostics`.

    Parameters
    ----------
    run : WallRun
    robot : Robot
        Whose mapping and frames the bus has.
    """

    def __init__(self, run: WallRun, robot: Robot) -> None:
        self._run = run
        self._codec = Codec.load(None, None, robot)

    def deeds(self) -> dict[str, Callable[[random.Random], WallOutcome]]:
        """Injections by kind."""
        return {f"bus, drawn: {kind}": partial(self._drawn, kind) for kind in DRAWN}

    def _drawn(self, kind: str, source: random.Random) -> WallOutcome:
        injection = DRAWN[kind](source, self._codec, 0)
        if not isinstance(injection.fault, BusFault):
            raise IdentError(f"expected a fault of the bus, found {injection.fault}")
        fault = asdict(injection.fault)
        del fault["first_cycle"]
        cycles = injection.limit_cycles
        before = self._run.drive_and_ask()
        since = self._run.put_on_the_bus(fault)
        limit_ms = None if cycles is None else wall_ms(cycles)
        found = self._run.measured(f"bus, drawn: {kind}", since, limit_ms)
        now = self._run.diagnosed()
        return worst_of(found, _judged(injection, before, now))


def _judged(injection: Injection, before: Diagnosis, now: Diagnosis) -> Judgement:
    """What a fault did that it must not, or did not show as."""
    reason = now.texts[1]
    missing = injection.unnamed(now, before, lockstep=False)
    if injection.wrongly_tripped(reason, lockstep=False, late=True):
        missing.append(f"tripped: {reason}")
    return judgement([f"{injection.kind}: {text}" for text in missing], reason)
