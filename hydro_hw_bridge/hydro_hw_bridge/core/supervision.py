"""The way of faults: whatever ends driving besides commands, as a reason for the gate to trip.

Looked at are the permissives and readings of every cycle, the clock that the device runs on, how
old in real time is what it says, and who else is on the bus.
"""

from __future__ import annotations

import math

from hydro_hw_bridge.gate.gate import Gate, GateState
from hydro_hw_bridge.gate.permissives import EMERGENCY_STOP, Inputs
from hydro_hw_bridge.monitoring.period_watch import PeriodWatch
from hydro_hw_bridge.monitoring.plausibility import ReadingsWatch
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.e2e import ALIVE_MASK
from hydro_hw_bridge.protocol.frames import Frame, Readings, Status

SUPPLY = "supply"
#: Name of the fault of a device on another clock than the bridge was told.
OTHER_CLOCK = "other_clock"
#: Name of the fault of a device that is faster than its robot file says.
OTHER_PERIOD = "other_period"
#: Name of the fault of readings that cannot be.
IMPOSSIBLE = "impossible_readings"
#: Name of the fault of valve frames that are not the bridge's.
FOREIGN = "foreign_commands"
#: How the reason begins where this computer, not the device, is late.
READ_LATE = "the device's frames waited"
CLOCK_WORDS = {True: "lockstep", False: "real_time"}


class Supervision:
    """Trips the gate; what follows from that is for others to send.

    Its methods are told whether the bridge is `active`: faults that begin before that trip
    nothing, and are there when it is activated as long as they stand.

    Parameters
    ----------
    codec : Codec
    gate : Gate
    lockstep : bool

    Attributes
    ----------
    watch : ReadingsWatch
    read_late : int
        Cycles whose sync frame had waited too long to be read.
    """

    def __init__(self, codec: Codec, gate: Gate, *, lockstep: bool) -> None:
        self._codec, self._gate, self._lockstep = codec, gate, lockstep
        self.watch = ReadingsWatch(codec, gate.limits.period_s)
        self.read_late = 0
        self._period = PeriodWatch(gate.limits.period_s)
        self._standing_still = 0
        self._supply_pa: float | None = None
        self._quiet = self._behind = self._pressed = False

    @property
    def outdated(self) -> bool:
        """What was heard of the device last is older than a command may be."""
        return self._quiet or self._behind or self._stands_still

    # -- frames and cycles of the device

    def restarted(self) -> None:
        """The device counts anew: that ends driving."""
        if self._gate.state is GateState.DRIVING:
            self._gate.trip("the device restarted: its sample counter went back")
        self.watch.forget()
        self._period.forget()
        self._supply_pa = None

    def contradicted(self, frame: Frame) -> None:
        """Nothing is driven by a cycle that came in two versions.

        Parameters
        ----------
        frame : Frame
            The second.
        """
        self._gate.trip(f"two different frames {frame.name} of one cycle: a second device?")

    def sync(self, sync: Frame, counter: int, *, advanced: bool, active: bool) -> None:
        """The permissives act at once, whether or not the rest of the cycle comes.

        Of a frame from afar, which may be late or noise, nothing is taken but an emergency stop,
        and that where the next sync frame says it, too: a counter that runs wild is no reason not
        to see it.

        Parameters
        ----------
        sync : Frame
        counter : int
            Sample counter of the newest cycle.
        advanced : bool
            This frame began it.
        active : bool
        """
        if not sync.intact:
            return
        own = self._codec.sample_counter(sync)
        if sync.alive not in (None, own & ALIVE_MASK):
            return
        if advanced:
            self._standing_still, self._quiet = 0, False
        else:
            self._count_standing()
        status = self._codec.status(sync)
        before, self._pressed = self._pressed, not status.emergency_stop_ok
        if own == counter or (before and self._pressed):
            self._check(status, active=active)

    def _count_standing(self) -> None:
        """In real time no cycle is begun again: ages cannot be told by a counter that stands."""
        if self._lockstep:
            return
        self._standing_still += 1
        if self._stands_still and self._gate.state is GateState.DRIVING:
            self._gate.trip(
                f"the device's sample counter stood still for {self._standing_still} cycles"
            )

    @property
    def _stands_still(self) -> bool:
        return self._standing_still > self._gate.limits.max_age_cycles

    def cycle(
        self, readings: Readings, counter: int, on_wire_v: tuple[float, ...], *, active: bool
    ) -> None:
        """Look at a new cycle: nothing is driven by readings that cannot be.

        Parameters
        ----------
        readings : Readings
        counter : int
            Sample counter without wrap.
        on_wire_v : tuple of float
            V per valve.
        active : bool
        """
        self._supply_pa = self._supply(readings)
        self._check(readings.status, active=active)
        found = self.watch.look(readings, counter, on_wire_v)
        if found.passing and active:
            self._gate.trip(found.passing)
        self._stands(IMPOSSIBLE, found.standing, active=active)

    def compare_clocks(self, status: Status, *, active: bool) -> None:
        """A device on the other clock cannot be driven: neither would wait for the other.

        Parameters
        ----------
        status : Status
            Of the newest cycle, of a device that tells its clock.
        active : bool
        """
        found, told = CLOCK_WORDS[status.lockstep], CLOCK_WORDS[self._lockstep]
        reason = f"the device's clock is {found}, the bridge's parameter 'clock' says {told}"
        self._stands(OTHER_CLOCK, "" if found == told else reason, active=active)

    def _supply(self, readings: Readings) -> float:
        names = self._codec.pressure_names
        return readings.pressures_pa[names.index(SUPPLY)] if SUPPLY in names else math.nan

    def _check(self, status: Status, *, active: bool) -> None:
        if self._supply_pa is not None:
            self._gate.check(self._inputs(status, self._supply_pa))
        if active and not status.emergency_stop_ok:
            # Whoever presses it while nothing is driven yet does not want what comes next, nor
            # does he wait for a first cycle that is whole.
            self._gate.trip(EMERGENCY_STOP)

    def _inputs(self, status: Status, supply_pa: float) -> Inputs:
        return Inputs(
            emergency_stop_ok=status.emergency_stop_ok,
            pump_on=status.pump_on,
            enable_switch=status.enable_switch,
            amplifier_watchdog=status.amplifier_watchdog,
            supply_pa=supply_pa,
            amplifiers_on=status.amplifier_enabled if self._codec.tells_amplifiers else None,
        )

    def _stands(self, name: str, reason: str, *, active: bool) -> None:
        """A fault of the cycle at hand; empty: there is none."""
        if reason:
            self.fault(name, reason, active=active)
        else:
            self._gate.end_fault(name)

    # -- wall time

    def silence(self, elapsed_s: float, *, others: bool = False) -> None:
        """The device began no new cycle for a while of wall time.

        In lockstep that is its right; in real time it ends driving as soon as the newest command
        is as old as one may be, and what was heard before begins none.

        Parameters
        ----------
        elapsed_s : float
        others : bool, optional
            Other frames of the device come.
        """
        # Until a sync frame begins the next cycle: what waits to be read may say less.
        self._quiet = self._quiet or self.too_long(elapsed_s)
        if self._quiet and self._gate.state is GateState.DRIVING:
            most_ms = f"{1e3 * self._gate.limits.max_age_s:.0f} ms"
            if self._standing_still:
                self._gate.trip(f"the device's sample counter did not go on for {most_ms}")
            else:
                what = "no sync frame" if others else "nothing"
                self._gate.trip(f"{what} from the device for {most_ms}")

    def too_long(self, elapsed_s: float) -> bool:
        """Whether so much wall time makes a command too old: in lockstep none does.

        Parameters
        ----------
        elapsed_s : float
            Since the cycle that it answers, or a later one, was read.
        """
        return not self._lockstep and elapsed_s > self._gate.limits.max_age_s

    def waited(self, waited_s: float) -> None:
        """A sync frame, as just taken in, had waited in this computer to be read.

        What a reader answers that lags is older than it looks by the samples' own count: in real
        time that ends driving as silence does, and begins none.

        Parameters
        ----------
        waited_s : float
        """
        most_s = self._gate.limits.max_age_s
        self._behind = self.too_long(waited_s)
        self.read_late += self._behind
        if self._behind and self._gate.state is GateState.DRIVING:
            self._gate.trip(
                f"{READ_LATE} for {1e3 * waited_s:.0f} ms to be read (limit {1e3 * most_s:.0f} ms)"
            )

    def paced(self, counter: int, at_s: float, *, active: bool) -> None:
        """A cycle came: in real time none is driven of a device that is faster than all think.

        Parameters
        ----------
        counter : int
            Sample counter without wrap.
        at_s : float
            On a clock that never steps, s.
        active : bool
        """
        if not self._lockstep:
            self.condition(OTHER_PERIOD, self._period.look(counter, at_s), active=active)

    # -- conditions

    def fault(self, name: str, reason: str, *, active: bool) -> None:
        """A standing fault began.

        Parameters
        ----------
        name, reason : str
        active : bool
        """
        if active:
            self._gate.set_fault(name, reason)
        else:
            self._gate.faults[name] = reason

    def condition(self, name: str, reason: str, *, active: bool) -> None:
        """A condition as it stands now.

        Parameters
        ----------
        name : str
        reason : str
            Empty: it does not hold.
        active : bool
        """
        if not reason:
            self._gate.end_fault(name)
        elif name not in self._gate.faults:
            self.fault(name, reason, active=active)
