"""One injection on the bench, and whether every promise was kept at the valves."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

from hydro_hw_bridge.core.bridge_turns import SECOND_BRIDGE
from hydro_hw_bridge.core.supervision import FOREIGN as FOREIGN_COMMANDS
from hydro_hw_bridge.faults.bench import Bench, Commander, ValveInput, WatchedCodec
from hydro_hw_bridge.faults.bus_faults import BRIDGE, LINK, BusFault
from hydro_hw_bridge.faults.command_faults import CommandFault
from hydro_hw_bridge.faults.injection import AGE, AT_ONCE, WATCHDOG, Injection
from hydro_hw_bridge.faults.machine_faults import MachineFault
from hydro_hw_bridge.faults.naming import Diagnosis
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.rig.core import RigCore

#: Cycles after the fault until the trip is cleared, and those of driving again after that.
AFTER, AGAIN = 12, 30
#: Half a step of the wire's voltage, twice: two rounded values.
ROUNDING_V = 1e-3
#: Somebody whose frames nothing tells from the machine's: samples may hold them.
FOREIGN = "foreign"
#: While these last only the amplifiers are left, who hold a command for the watchdog's time.
UNWATCHED = (*LINK, "bridge_dead", "bridge_stopped")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one injection did.

    Attributes
    ----------
    injection : Injection
    lockstep : bool
    stop_cycles : int or None
        From the first cycle of the fault to 0 V at the valves, both counted; None: it drove on.
    tripped : bool
        The gate latched.
    reason : str
    broken : tuple of str
        Promises that were not kept; empty where all were.
    step_v, reenable_step_v : float
        Largest step per cycle at the valves while driving, and after re-enabling.
    named : tuple of str
        Counters of `/diagnostics` that grew with the fault.
    """

    injection: Injection
    lockstep: bool
    stop_cycles: int | None
    tripped: bool
    reason: str
    broken: tuple[str, ...]
    step_v: float
    reenable_step_v: float
    named: tuple[str, ...]


@dataclass
class Trial:
    """Runs injections.

    Parameters
    ----------
    codec : WatchedCodec
    limits : GateLimits
    make_rig : callable
        A fresh rig for a seed.
    make_commander : callable
        A fresh, sound publisher for a seed.
    """

    codec: WatchedCodec
    limits: GateLimits
    make_rig: Callable[[int], RigCore]
    make_commander: Callable[[int], Commander]
    bench: Bench = field(init=False)

    def run(self, injection: Injection, seed: int, *, lockstep: bool = False) -> Outcome:
        """Run one injection.

        Parameters
        ----------
        injection : Injection
        seed : int
            Of rig and commander.
        lockstep : bool

        Returns
        -------
        Outcome
        """
        bench = self.bench = self._bench_of(injection, seed, lockstep=lockstep)
        bench.run(injection.first_cycle)
        before = Diagnosis.of(bench.core, bench.end)
        rest = AFTER + random.Random(seed).randrange(8)
        bench.run(injection.end_cycle - injection.first_cycle + rest)
        core = bench.core
        after = Diagnosis.of(core, bench.end)
        tripped, reason = core.gate.state is GateState.TRIPPED, core.gate.reason
        broken = self._judged(bench, injection)
        broken += injection.unnamed(after, before, bench.absent(), lockstep=lockstep)
        if tripped and injection.wrongly_tripped(reason, lockstep=lockstep):
            broken.append(f"tripped: {reason}")
        rows = list(bench.rows)
        step_v = max((_step(a, b) for a, b in pairwise(rows)), default=0.0)
        again_v = 0.0
        if tripped or not core.active or "bridge_dead" in injection.kinds:
            again_v, complaint = self._drive_again(bench, injection.kinds, lockstep=lockstep)
            broken += complaint
        if FOREIGN not in injection.kinds:
            broken += [f"partial sample: {text}" for text in bench.partial_samples()]
        stop = _first_stop(rows, injection.fault.first_cycle)
        named = tuple(sorted(after.grown(before)))
        return Outcome(
            injection, lockstep, stop, tripped, reason, tuple(broken), step_v, again_v, named
        )

    def _bench_of(self, injection: Injection, seed: int, *, lockstep: bool) -> Bench:
        faults = injection.faults
        return Bench(
            self.make_rig(seed),
            self.codec,
            self.limits,
            self.make_commander(seed),
            bus=[one for one in faults if isinstance(one, BusFault)],
            publisher=[one for one in faults if isinstance(one, CommandFault)],
            machine=[one for one in faults if isinstance(one, MachineFault)],
            lockstep=lockstep,
        )

    def _judged(self, bench: Bench, injection: Injection) -> list[str]:
        rows, first = bench.rows, injection.fault.first_cycle
        broken = []
        if not any(r.enabled and any(r.voltages) for r in rows[: injection.first_cycle]):
            broken.append("the valves were not driven before the fault")
        broken += [f"driven at cycle {r.cycle} without a permissive" for r in rows if _unmet(r)]
        stop, limit = _first_stop(rows, first), injection.limit_cycles
        # In lockstep only what is answered at once: the device's time waits for the rest.
        told = limit is not None and (limit == AT_ONCE or not bench.lockstep)
        if told and (stop is None or stop > (limit or 0)):
            broken.append(f"0 V after {stop} cycles, promised within {limit}")
        oldest = max((r.age_cycles for r in rows if not r.stopped and any(r.voltages)), default=0)
        most = sum(self._held(fault) for fault in injection.faults)
        if oldest > most:
            broken.append(f"a command {oldest} cycles old at the valves, promised at most {most}")
        return [*broken, *_steps_above(rows, 2.0 * self.limits.legal_step_v), *_unlatched(rows)]

    def _held(self, fault: BusFault | CommandFault | MachineFault) -> int:
        """How old, in cycles, a command may be at the valves while a fault lasts.

        Of several at once each has its time: one may begin as another ends.
        """
        if fault.kind in UNWATCHED:
            return AGE + WATCHDOG
        if isinstance(fault, BusFault) and fault.direction == BRIDGE:
            return AGE + WATCHDOG
        if fault.kind == "late" and isinstance(fault, BusFault):
            # By its sync frames the bridge counts the time: late, that is behind by as much.
            clock_late = fault.frames == self.codec.device_ids[:1]
            return AGE + fault.amount if clock_late else AGE
        return AGE

    def _drive_again(
        self, bench: Bench, kinds: frozenset[str], *, lockstep: bool
    ) -> tuple[float, list[str]]:
        """Clear the trip as an operator does, and drive: slowly."""
        core = bench.core
        bench.be_sound()
        if "bridge_dead" in kinds:
            bench.start_bridge()
        elif not core.active:
            core.activate(ready=True)
        for gone in (SECOND_BRIDGE, FOREIGN_COMMANDS):
            core.gate.end_fault(gone)
        _outlast_link(bench)
        for _ in range(2 * AFTER):
            if core.gate.clear()[0]:
                break
            bench.step()
        else:
            return 0.0, [f"not to be cleared: {core.gate.clear()[1]}"]
        start = len(bench.rows)
        bench.run(AGAIN)
        rows = bench.rows[start - 1 :]
        if not any(row.enabled for row in rows[1:]):
            return 0.0, ["not driving again after the trip was cleared"]
        if lockstep and "bridge_dead" in kinds:
            # Its time stood still at the voltage of before, which may still be on its way out of
            # the amplifiers; a new bridge ramps from 0 V.
            rows = rows[1 + bench.rig.truth.command_delay_cycles :]
        largest = max((_step(a, b) for a, b in pairwise(rows)), default=0.0)
        cleared = not kinds & {"bridge_dead", "deactivated"}
        most = self.limits.reenable_step_v if cleared else self.limits.legal_step_v
        above = largest > most + ROUNDING_V
        return largest, [f"step of {largest:.3f} V after re-enabling"] if above else []


def _outlast_link(bench: Bench) -> None:
    """Go on until the bridge's end of the bus is well.

    Its faults last by the machine's cycles: one that was silent meanwhile has them stand longer.
    """
    for _ in range(max((fault.cycles for fault in bench.bus), default=0)):
        if bench.line.link == "ok":
            return
        bench.step()


def _unmet(row: ValveInput) -> bool:
    """Driven although a permissive is open."""
    return not row.permitted and not row.stopped


def _first_stop(rows: list[ValveInput], first: int) -> int | None:
    """Cycles from `first` to the first row at 0 V, both counted."""
    found = [row.cycle for row in rows if row.cycle >= first and row.stopped]
    return found[0] - first + 1 if found else None


def _step(before: ValveInput, after: ValveInput) -> float:
    """The step to a voltage other than 0, however many cycles lie between the two answers."""
    pairs = zip(before.voltages, after.voltages, strict=True)
    return max(abs(b - a) for a, b in pairs) if any(after.voltages) else 0.0


def _steps_above(rows: list[ValveInput], most_v: float) -> list[str]:
    worst = max((_step(a, b) for a, b in pairwise(rows)), default=0.0)
    return [f"step of {worst:.3f} V per cycle"] if worst > most_v + ROUNDING_V else []


def _unlatched(rows: list[ValveInput]) -> list[str]:
    """A trip that ended by itself, or valves that moved again during one."""
    latched = False
    for before, row in pairwise(rows):
        latched = latched or (row.gate == "tripped" and row.stopped)
        if before.gate == "tripped" and row.gate != "tripped":
            return [f"the trip ended by itself at cycle {row.cycle}"]
        if latched and not row.stopped:
            return [f"the valves moved at cycle {row.cycle} although tripped"]
    return []
