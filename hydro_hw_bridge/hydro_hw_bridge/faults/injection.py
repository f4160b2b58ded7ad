"""An injection: one fault or several, what is promised of it, and where it must show."""

from __future__ import annotations

import re
from collections.abc import Container
from dataclasses import dataclass

from hydro_hw_bridge.faults.bus_faults import LINK, BusFault
from hydro_hw_bridge.faults.command_faults import CommandFault
from hydro_hw_bridge.faults.machine_faults import MachineFault
from hydro_hw_bridge.faults.naming import NONE_SHOWS, Diagnosis, Named

#: Cycles of 2 ms: at once (the answer of the same cycle), a command's age, the watchdog.
AT_ONCE, AGE, WATCHDOG = 1, 6, 25
#: Without samples, sync frames or commands for so many cycles driving ends with the next one.
STARVED = AGE - 1
#: 0.5 s of a valve open by a fifth: those of the wave are so for 78 % of the time.
STUCK = 330


@dataclass(frozen=True, slots=True)
class Injection:
    """One fault, or several at once, and what is promised.

    Attributes
    ----------
    group : {"bus", "publisher", "machine", "several"}
    fault : BusFault, CommandFault or MachineFault
        Of several the first.
    limit_cycles : int or None
        Cycles from the first one of the fault to 0 V and enable off at the valves; None where
        driving on is right.
    named : Named
    in_lockstep : Named or None
        What it has to show as there, where that differs.
    sensor : str
        Whose value is stuck: encoder, pressure or stroke.
    parts : tuple of Injection
        Of several: each by itself.
    may_trip : str
        Regular expression: reasons for which driving may end where that is left to chance.
    may_trip_late : str
        The same where a computer is late by a part of a cycle: the fault is one short of what
        ends driving. In device time nobody is late.
    """

    group: str
    fault: BusFault | CommandFault | MachineFault
    limit_cycles: int | None
    named: Named
    in_lockstep: Named | None = None
    sensor: str = ""
    parts: tuple[Injection, ...] = ()
    may_trip: str = ""
    may_trip_late: str = ""

    @property
    def kind(self) -> str:
        """Kind of the fault, with the direction of frames or the sensor."""
        if self.parts:
            return f"{len(self.parts)} faults"
        if isinstance(self.fault, BusFault) and self.fault.kind not in LINK:
            return f"{self.fault.kind} ({self.sensor or self.fault.direction})"
        return self.fault.kind

    @property
    def faults(self) -> tuple[BusFault | CommandFault | MachineFault, ...]:
        """All of them."""
        return tuple(part.fault for part in self.parts) or (self.fault,)

    @property
    def kinds(self) -> frozenset[str]:
        """Kinds of all of them, without more."""
        return frozenset(fault.kind for fault in self.faults)

    @property
    def first_cycle(self) -> int:
        """Of whichever is first."""
        return min(fault.first_cycle for fault in self.faults)

    @property
    def end_cycle(self) -> int:
        """Behind the last cycle of all, and behind what is held back until then."""
        return max(
            fault.first_cycle + fault.cycles + (int(fault.amount) if fault.kind == "late" else 0)
            for fault in self.faults
        )

    def naming(self, *, lockstep: bool) -> Named:
        """What it has to show as.

        Parameters
        ----------
        lockstep : bool
            The clock of the run.
        """
        return self.in_lockstep or self.named if lockstep else self.named

    def silent(self, *, lockstep: bool) -> str:
        """Key of what cannot show; empty where it has to.

        Parameters
        ----------
        lockstep : bool
            The clock of the run.
        """
        if not self.parts:
            return self.naming(lockstep=lockstep).silent
        none = all(part.silent(lockstep=lockstep) for part in self.parts)
        return NONE_SHOWS if none else ""

    def wrongly_tripped(self, reason: str, *, lockstep: bool, late: bool = False) -> bool:
        """Whether a trip is one that it must not make: driving on is right.

        Of several at once nothing is said.

        Parameters
        ----------
        reason : str
            Of the trip; empty where there is none.
        lockstep : bool
        late : bool
            On a computer that may be late.
        """
        named = self.naming(lockstep=lockstep)
        may_stop = self.parts or self.limit_cycles is not None
        if not reason or may_stop or named.says or "trips" in named.shows:
            return False
        allowed = (self.may_trip, self.may_trip_late if late else "")
        return not any(words and re.match(words, reason) for words in allowed)

    def unnamed(
        self,
        now: Diagnosis,
        before: Diagnosis,
        absent: Container[BusFault | CommandFault | MachineFault] = (),
        *,
        lockstep: bool,
    ) -> list[str]:
        """What had to show and does not, in words.

        Parameters
        ----------
        now, before : Diagnosis
            After the fault and before it.
        absent : container of faults
            Of several those that another kept from taking place.
        lockstep : bool
        """
        if not self.parts:
            return now.lacks(self.naming(lockstep=lockstep), before)
        missing = []
        for part in self.parts:
            if part.fault in absent:
                continue
            # Behind a trip another fault may be as good as not there: its reason is the first's.
            shows = part.naming(lockstep=lockstep).shows
            named = Named(shows=(*shows, "trips")) if shows else Named()
            missing += [f"{part.kind}: {text}" for text in now.lacks(named, before)]
        return missing
