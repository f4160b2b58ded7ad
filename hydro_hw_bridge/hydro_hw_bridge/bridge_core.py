"""The bridge without bus, threads and ROS: frames and commands in, samples and answers out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

import can

from hydro_hw_bridge.assembler import Assembler, Cycle, CycleKind
from hydro_hw_bridge.bridge_step import NOTHING, CommandCounters, Sample, Step, ValveState
from hydro_hw_bridge.codec import Codec, Frame, Readings, Status
from hydro_hw_bridge.gate import Gate, GateState, Outcome
from hydro_hw_bridge.gate_limits import GateLimits
from hydro_hw_bridge.own_frames import OwnFrames
from hydro_hw_bridge.permissives import Inputs
from hydro_hw_bridge.plausibility import ReadingsWatch
from hydro_hw_bridge.sample_clock import SampleClock

SUPPLY = "supply"
#: Samples that a command may answer: older ones are gone.
_ANSWERABLE = 64
#: Cycles that are still answered with 0 V after deactivation: any one frame may be lost.
CLOSING_CYCLES = 5
#: Name of the fault of a device on another clock than the bridge was told.
OTHER_CLOCK = "other_clock"
#: Name of the fault of readings that cannot be.
IMPOSSIBLE = "impossible_readings"
#: Name of the fault of valve frames that are not the bridge's.
FOREIGN = "foreign_commands"
#: How the reason begins where this computer, not the device, is late.
READ_LATE = "the device's frames waited"
CLOCK_WORDS = {True: "lockstep", False: "real_time"}


def _taken(_frame: can.Message) -> bool:
    return True


class BridgeCore:
    """State machine between device and controller.

    In real time the device is told 0 V on every cycle while the bridge is active and does not
    drive, and every accepted command at once. In lockstep a frame answers a cycle: commands do,
    and a tripped gate does, so that device time goes on; while waiting for subscribers or for a
    first command nothing does, and the device repeats its cycle.

    Not thread-safe: callers hold one lock around every method. Frames are sent inside, so the
    order on the bus is the order of decisions: nothing decided before a stop is sent after it.

    Parameters
    ----------
    codec : Codec
    limits : GateLimits
    lockstep : bool
    send : callable
        Sends a frame at once; False where the bus did not take it.

    Attributes
    ----------
    gate : Gate
    clock : SampleClock
    assembler : Assembler
    commands : CommandCounters
    watch : ReadingsWatch
    active : bool
    ready : bool
        The subscribers that the bridge was told to wait for are there.
    spoke : bool
        A valve frame was sent.
    read_late : int
        Cycles whose sync frame had waited too long to be read.
    """

    def __init__(
        self,
        codec: Codec,
        limits: GateLimits,
        *,
        lockstep: bool,
        send: Callable[[can.Message], bool] = _taken,
    ) -> None:
        self.codec = codec
        self.lockstep = lockstep
        self.spoke = False
        self._send = send
        self.gate = Gate(limits)
        self.clock = SampleClock(round(limits.period_s * 1e9), whole_seconds=lockstep)
        self.assembler = Assembler(codec.cycle_frames, codec.sample_counter)
        self.commands = CommandCounters()
        self.watch = ReadingsWatch(codec, limits.period_s)
        self.active = False
        self.ready = False
        self.sample: Sample | None = None
        self._answer: can.Message | None = None
        self._answer_v = self._on_wire = (0.0,) * len(codec.valve_names)
        self._answered = -1
        self._stated = -1
        self._closing = 0
        self._standing_still = 0
        self._supply_pa: float | None = None
        self._whole: deque[int] = deque(maxlen=_ANSWERABLE)
        self._number: int | None = None
        self._quiet = self._behind = False
        self.read_late = 0
        self._own = OwnFrames()

    def carry_over(self, other: BridgeCore) -> None:
        """Take over what must outlive a core: a trip, and which frames on the bus are its own.

        Parameters
        ----------
        other : BridgeCore
            The one before this.
        """
        # A trip is cleared by somebody who has seen its reason, not by starting anew.
        self.gate.carry_over(other.gate)
        self._own.take_over(other._own)

    def activate(self, *, ready: bool = False) -> None:
        """From now on, drive.

        Parameters
        ----------
        ready : bool
            There are no subscribers to wait for.
        """
        self.active, self.ready = True, ready
        self.gate.arm()

    def deactivate(self) -> can.Message | None:
        """Stop driving: 0 V and enable off now, and for a few cycles to come.

        Returns
        -------
        can.Message or None
            As of `send_zero`; None where it was not active.
        """
        if not self.active:
            return None
        self.active = self.ready = False
        self._closing = CLOSING_CYCLES
        self.gate.arm()
        return self.send_zero()

    def send_zero(self) -> can.Message | None:
        """While not driving: 0 V and enable off, once more, as the answer to the newest cycle.

        Returns
        -------
        can.Message or None
            What was sent; None before the first cycle or where the bus did not take it.
        """
        return None if self.sample is None else self._emit(self.sample.counter)

    def receive(self, frame: Frame, now_ns: int) -> Step:
        """Take a frame of the device.

        Parameters
        ----------
        frame : Frame
        now_ns : int
            ROS time, used for the first sync frame only.

        Returns
        -------
        Step
        """
        before, counters = self.assembler.counter, self.assembler.counters
        restarts, contradicted = counters.restarts, counters.contradicted
        cycle = self.assembler.add(frame)
        counter = self.assembler.counter
        if counter is None:
            return NOTHING
        if counters.restarts != restarts:
            self._restart()
            before = None
        if before is None:
            self.clock.start(counter, now_ns)
        was = self.gate.state
        if counter != before:
            self.gate.advance(self.clock.extend(counter))
        if counters.contradicted != contradicted and self.active:
            self.gate.trip(f"two different frames {frame.name} of one cycle: a second device?")
        if frame.role == "sync":
            self._look_at_sync(frame, counter)
        if cycle is not None:
            return self._cycle(cycle)
        return NOTHING if self.gate.state is was else self.stop_now()

    def _look_at_sync(self, sync: Frame, counter: int) -> None:
        """The permissives act at once, whether or not the rest of the cycle comes."""
        if not sync.intact or self.codec.sample_counter(sync) != counter:
            return
        self._quiet = False
        if self._supply_pa is not None:
            self.gate.check(_inputs(self.codec.status(sync), self._supply_pa))

    def _restart(self) -> None:
        if self.gate.state is GateState.DRIVING:
            self.gate.trip("the device restarted: its sample counter went back")
        self.gate.forget()
        self.watch.forget()
        self._answered = self._stated = -1
        self._on_wire = (0.0,) * len(self._on_wire)
        self.sample = self._supply_pa = None
        self._whole.clear()

    def _cycle(self, cycle: Cycle) -> Step:
        if cycle.kind is CycleKind.REPEAT and self.sample is not None:
            return self._repeated(self.sample)
        self._standing_still = 0
        late = self._state_of_last()
        counter = self.clock.extend(cycle.counter)
        readings = self.codec.readings(cycle.data)
        self.sample = Sample(self.clock.stamp_ns(counter), counter, readings, False)
        self._whole.append(counter)
        self._supply_pa = self._supply(readings)
        self.gate.check(_inputs(readings.status, self._supply_pa))
        self._look_at(readings, counter)
        self._compare_clocks(readings)
        answer = self._own_answer()
        # Inactive in lockstep the cycle is still open: it may be answered once active.
        stated = answer is not None or not (self.active or self.lockstep)
        own = self._state_of_last() if stated else ()
        return Step(self.sample, (*late, *own), answer)

    def _repeated(self, known: Sample) -> Step:
        """A cycle that the device sent again, as its answer did not come or was lost."""
        self.sample = Sample(known.stamp_ns, known.counter, known.readings, True)
        answered = self._answered == known.counter
        if not self.lockstep:
            self._stands_still()
        if answered and self.active and self.gate.state is GateState.DRIVING:
            # In real time an old command must not keep the amplifiers' watchdog quiet.
            answer = self._transmit() if self.lockstep else None
        else:
            answer = self._own_answer()
        own = self._state_of_last() if answer is not None else ()
        return Step(None if answered else self.sample, own, answer)

    def _stands_still(self) -> None:
        """In real time no cycle is sent again: ages cannot be told by a counter that stands."""
        self._standing_still += 1
        if (
            self._standing_still > self.gate.limits.max_age_cycles
            and self.gate.state is GateState.DRIVING
        ):
            self.gate.trip(
                f"the device's sample counter stood still for {self._standing_still} cycles"
            )

    def _look_at(self, readings: Readings, counter: int) -> None:
        """Nothing is driven by readings that cannot be."""
        found = self.watch.look(readings, counter, self._on_wire)
        if found.passing and self.active:
            self.gate.trip(found.passing)
        self._stands(IMPOSSIBLE, found.standing)

    def _compare_clocks(self, readings: Readings) -> None:
        """A device on the other clock cannot be driven: neither would wait for the other."""
        if not self.codec.tells_clock:
            return
        found, told = CLOCK_WORDS[readings.status.lockstep], CLOCK_WORDS[self.lockstep]
        reason = f"the device's clock is {found}, the bridge's parameter 'clock' says {told}"
        self._stands(OTHER_CLOCK, "" if found == told else reason)

    def _stands(self, name: str, reason: str) -> None:
        """A fault of the cycle at hand, which is not answered yet; empty: there is none."""
        if not reason:
            self.gate.end_fault(name)
        elif self.active:
            self.gate.set_fault(name, reason)
        else:
            self.gate.faults[name] = reason

    def _supply(self, readings: Readings) -> float:
        names = self.codec.pressure_names
        return readings.pressures_pa[names.index(SUPPLY)] if SUPPLY in names else math.nan

    def _own_answer(self) -> can.Message | None:
        """What the bridge answered to the newest cycle without a command."""
        if self.sample is None or (self.active and self.gate.state is GateState.DRIVING):
            return None
        if not self.active:
            if not self._closing:
                return None
            self._closing -= 1
        elif (
            self.lockstep
            and self.gate.state is GateState.WAITING
            and self._answered != self.sample.counter
        ):
            return None
        return self._emit(self.sample.counter)

    def _emit(self, counter: int) -> can.Message | None:
        """Send the gate's output as the answer to a cycle."""
        output = self.gate.output
        self._answer = self.codec.encode_command(counter, output.voltages, output.enable)
        self._own.add(bytes(self._answer.data))
        self._answer_v = self.codec.quantised(output.voltages)
        self._answered = counter
        return self._transmit()

    def _transmit(self) -> can.Message | None:
        """Send the newest answer; only what left is on the wire."""
        if self._answer is None or not self._send(self._answer):
            return None
        self.spoke = True
        self._on_wire = self._answer_v
        return self._answer

    def _state_of_last(self) -> tuple[ValveState, ...]:
        """The valve state of the newest cycle, once."""
        sample = self.sample
        if sample is None or sample.counter == self._stated:
            return ()
        self._stated = sample.counter
        return (ValveState(sample.stamp_ns, self._on_wire, sample.readings.spools),)

    def command(
        self,
        stamp_ns: int,
        names: Sequence[str],
        voltages: Sequence[float],
        number: int | None = None,
    ) -> Step:
        """Take a command.

        Parameters
        ----------
        stamp_ns : int
            Of the state it was computed from.
        names : sequence of str
        voltages : sequence of float
            V.
        number : int, optional
            Of the message, counted by its publisher.

        Returns
        -------
        Step
        """
        if not self.active or not self.ready or self.sample is None:
            self.commands.not_driving += 1
            return NOTHING
        if (self._quiet or self._behind) and self.gate.state is GateState.WAITING:
            self.commands.outdated += 1
            return NOTHING
        counter = self._answerable(stamp_ns)
        was = self.gate.state
        self._look_at_number(number)
        outcome = self.gate.command(counter, names, voltages)
        name = outcome.value
        setattr(self.commands, name, getattr(self.commands, name) + 1)
        if outcome is Outcome.ACCEPTED and counter is not None:
            answer = self._emit(counter)
            return Step(valve_states=self._state_at(counter, answer), answer=answer)
        if outcome is Outcome.RELEASED or self.gate.state is not was:
            return self.stop_now()
        return NOTHING

    def _answerable(self, stamp_ns: int) -> int | None:
        """The counter of the sample with this stamp; None where there was no sample.

        A cycle of which a frame was lost is no sample: nobody can answer it.
        """
        counter = self.clock.counter_of(stamp_ns)
        outdated = counter is not None and counter < self._whole[0]
        return counter if outdated or counter in self._whole else None

    def _look_at_number(self, number: int | None) -> None:
        """One publisher counts its messages up; two count in turns."""
        last, self._number = self._number, number
        if number is None or last is None or number > last:
            return
        if self.gate.state is GateState.DRIVING:
            self.gate.trip("commands of two publishers: is there a second controller?")

    def _state_at(self, counter: int, answer: can.Message | None) -> tuple[ValveState, ...]:
        """The valve state of the newest cycle, if this is its answer."""
        newest = self.sample is not None and self.sample.counter == counter
        return self._state_of_last() if newest and answer is not None else ()

    def stop_now(self) -> Step:
        """The gate stopped driving: tell the device at once."""
        if not self.active or self.gate.state is GateState.DRIVING or self.sample is None:
            return NOTHING
        counter = self.sample.counter
        answer = self._emit(counter)
        return Step(valve_states=self._state_at(counter, answer), answer=answer)

    def silence(self, elapsed_s: float) -> Step:
        """The device sent nothing for a while of wall time.

        In lockstep that is its right; in real time it ends driving as soon as the newest command
        is as old as one may be, and what was heard before begins none.

        Parameters
        ----------
        elapsed_s : float

        Returns
        -------
        Step
        """
        most_s = self.gate.limits.max_age_s
        self._quiet = not self.lockstep and elapsed_s > most_s
        if not self._quiet or self.gate.state is not GateState.DRIVING:
            return NOTHING
        self.gate.trip(f"nothing from the device for {1e3 * most_s:.0f} ms")
        return self.stop_now()

    def waited(self, waited_s: float) -> Step:
        """A sync frame, as just taken in, had waited in this computer to be read.

        What a reader answers that lags is older than it looks by the samples' own count: in real
        time that ends driving as silence does, and begins none.

        Parameters
        ----------
        waited_s : float

        Returns
        -------
        Step
        """
        most_s = self.gate.limits.max_age_s
        self._behind = not self.lockstep and waited_s > most_s
        self.read_late += self._behind
        if not self._behind or self.gate.state is not GateState.DRIVING:
            return NOTHING
        self.gate.trip(
            f"{READ_LATE} for {1e3 * waited_s:.0f} ms to be read (limit {1e3 * most_s:.0f} ms)"
        )
        return self.stop_now()

    def hear_command(self, frame: Frame) -> Step:
        """Take a valve frame off the bus: nothing is driven beside another sender.

        Parameters
        ----------
        frame : Frame
            Intact. Some buses let a sender hear its own.

        Returns
        -------
        Step
        """
        if frame.data in self._own:
            return NOTHING
        self.commands.foreign += 1
        return self.condition(FOREIGN, "valve frames of another sender are on the bus")

    def fault(self, name: str, reason: str) -> Step:
        """A standing fault outside the commands began.

        Parameters
        ----------
        name, reason : str

        Returns
        -------
        Step
        """
        if not self.active:
            self.gate.faults[name] = reason
            return NOTHING
        was = self.gate.state
        self.gate.set_fault(name, reason)
        return self.stop_now() if self.gate.state is not was else NOTHING

    def condition(self, name: str, reason: str) -> Step:
        """A condition outside the commands, as it stands now.

        Parameters
        ----------
        name : str
        reason : str
            Empty: it does not hold.

        Returns
        -------
        Step
        """
        if not reason:
            self.gate.end_fault(name)
            return NOTHING
        return NOTHING if name in self.gate.faults else self.fault(name, reason)


def _inputs(status: Status, supply_pa: float) -> Inputs:
    return Inputs(
        emergency_stop_ok=status.emergency_stop_ok,
        pump_on=status.pump_on,
        enable_switch=status.enable_switch,
        amplifier_watchdog=status.amplifier_watchdog,
        supply_pa=supply_pa,
    )
