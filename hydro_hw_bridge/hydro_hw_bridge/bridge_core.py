"""The bridge without bus, threads and ROS: frames and commands in, samples and answers out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import can

from hydro_hw_bridge.assembler import Assembler, Cycle, CycleKind
from hydro_hw_bridge.codec import Codec, Frame, Readings
from hydro_hw_bridge.gate import Gate, GateLimits, GateState, Inputs, Outcome
from hydro_hw_bridge.sample_clock import SampleClock

SUPPLY = "supply"
#: Wall time without a frame of the device after which a bridge in real time stops driving.
SILENCE_S = 0.05


@dataclass(frozen=True, slots=True)
class Sample:
    """A complete cycle with its stamp.

    Attributes
    ----------
    stamp_ns : int
        ROS time.
    counter : int
        Sample counter without wrap.
    readings : Readings
    repeated : bool
        Sent again under the same counter.
    """

    stamp_ns: int
    counter: int
    readings: Readings
    repeated: bool


@dataclass(frozen=True, slots=True)
class ValveState:
    """Voltages on the wire during a cycle, and the measured spools of that cycle."""

    stamp_ns: int
    voltages: tuple[float, ...]
    spools: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Step:
    """What follows from a frame or a command: publish these, send that.

    Attributes
    ----------
    sample : Sample or None
        To publish.
    valve_states : tuple of ValveState
        To publish.
    answer : can.Message or None
        To send.
    """

    sample: Sample | None = None
    valve_states: tuple[ValveState, ...] = ()
    answer: can.Message | None = None


NOTHING = Step()


@dataclass(slots=True)
class CommandCounters:
    """Commands by what became of them; `not_driving` came while inactive or not ready."""

    accepted: int = 0
    repeated: int = 0
    outdated: int = 0
    released: int = 0
    denied: int = 0
    not_driving: int = 0


class BridgeCore:
    """State machine between device and controller.

    In real time the device is told 0 V on every cycle while the bridge is active and does not
    drive, and every accepted command at once. In lockstep a frame answers a cycle: commands do,
    and a tripped gate does, so that device time goes on; while waiting for subscribers or for a
    first command nothing does, and the device repeats its cycle.

    Not thread-safe: callers hold one lock around every method.

    Parameters
    ----------
    codec : Codec
    limits : GateLimits
    lockstep : bool

    Attributes
    ----------
    gate : Gate
    clock : SampleClock
    assembler : Assembler
    commands : CommandCounters
    active : bool
    ready : bool
        The subscribers that the bridge was told to wait for are there.
    unknown_frames : int
    """

    def __init__(self, codec: Codec, limits: GateLimits, *, lockstep: bool) -> None:
        self.codec = codec
        self.lockstep = lockstep
        self.gate = Gate(limits)
        self.clock = SampleClock(round(limits.period_s * 1e9), whole_seconds=lockstep)
        self.assembler = Assembler(codec.cycle_frames, codec.sample_counter)
        self.commands = CommandCounters()
        self.active = False
        self.ready = False
        self.sample: Sample | None = None
        self.unknown_frames = 0
        self._answer: can.Message | None = None
        self._answered = -1
        self._stated = -1
        self._zero = (0.0,) * len(codec.valve_names)
        self._on_wire = self._zero

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
        """Stop driving; the returned frame (0 V, enable off) is to be sent."""
        self.active = self.ready = False
        self.gate.arm()
        return self.zero_frame()

    def zero_frame(self) -> can.Message | None:
        """0 V and enable off, answering the newest cycle; None before the first one."""
        if self.sample is None:
            return None
        return self._encode(self.sample.counter)

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
        before, restarts = self.assembler.counter, self.assembler.counters.restarts
        cycle = self.assembler.add(frame)
        counter = self.assembler.counter
        if counter is None:
            return NOTHING
        if self.assembler.counters.restarts != restarts:
            self._restart()
            before = None
        if before is None:
            self.clock.start(counter, now_ns)
        was = self.gate.state
        if counter != before:
            self.gate.advance(self.clock.extend(counter))
        if cycle is not None:
            return self._cycle(cycle)
        return NOTHING if self.gate.state is was else self.stop_now()

    def _restart(self) -> None:
        if self.gate.state is GateState.DRIVING:
            self.gate.trip("the device restarted: its sample counter went back")
        self.gate.forget()
        self._answered = self._stated = -1
        self.sample = None

    def _cycle(self, cycle: Cycle) -> Step:
        repeated = cycle.kind is CycleKind.REPEAT
        if repeated and self.sample is not None:
            known = self.sample
            self.sample = Sample(known.stamp_ns, known.counter, known.readings, True)
            if self._answered == known.counter:
                return Step(answer=self._answer if self.active else None)
            return Step(self.sample, answer=self._own_answer())
        late = self._state_of_last()
        counter = self.clock.extend(cycle.counter)
        readings = self.codec.readings(cycle.data)
        self.sample = Sample(self.clock.stamp_ns(counter), counter, readings, False)
        self.gate.check(self._inputs(readings))
        if not self.active:
            self._on_wire = self._zero
            # In lockstep the cycle is still open: it may be answered once the bridge is active.
            own = () if self.lockstep else self._state_of_last()
            return Step(self.sample, (*late, *own))
        answer = self._own_answer()
        own = () if answer is None else self._state_of_last()
        return Step(self.sample, (*late, *own), answer)

    def _inputs(self, readings: Readings) -> Inputs:
        names, status = self.codec.pressure_names, readings.status
        supply = readings.pressures_pa[names.index(SUPPLY)] if SUPPLY in names else math.nan
        return Inputs(
            emergency_stop_ok=status.emergency_stop_ok,
            pump_on=status.pump_on,
            enable_switch=status.enable_switch,
            amplifier_watchdog=status.amplifier_watchdog,
            supply_pa=supply,
        )

    def _own_answer(self) -> can.Message | None:
        """What the bridge answers to the newest cycle without a command."""
        if self.sample is None or not self.active or self.gate.state is GateState.DRIVING:
            return None
        if self.lockstep and self.gate.state is GateState.WAITING:
            return None
        return self._encode(self.sample.counter)

    def _encode(self, counter: int) -> can.Message:
        """The gate's output as a frame, which becomes the answer to a cycle."""
        output = self.gate.output
        self._on_wire = self.codec.quantised(output.voltages)
        self._answer = self.codec.encode_command(counter, output.voltages, output.enable)
        self._answered = counter
        return self._answer

    def _state_of_last(self) -> tuple[ValveState, ...]:
        """The valve state of the newest cycle, once."""
        sample = self.sample
        if sample is None or sample.counter == self._stated:
            return ()
        self._stated = sample.counter
        return (ValveState(sample.stamp_ns, self._on_wire, sample.readings.spools),)

    def command(self, stamp_ns: int, names: Sequence[str], voltages: Sequence[float]) -> Step:
        """Take a command.

        Parameters
        ----------
        stamp_ns : int
            Of the state it was computed from.
        names : sequence of str
        voltages : sequence of float
            V.

        Returns
        -------
        Step
        """
        if not self.active or not self.ready or self.sample is None:
            self.commands.not_driving += 1
            return NOTHING
        counter = self.clock.counter_of(stamp_ns)
        was = self.gate.state
        outcome = self.gate.command(counter, names, voltages)
        name = outcome.value
        setattr(self.commands, name, getattr(self.commands, name) + 1)
        if outcome is Outcome.ACCEPTED and counter is not None:
            answer = self._encode(counter)
            return Step(valve_states=self._state_at(counter), answer=answer)
        if outcome is Outcome.RELEASED or self.gate.state is not was:
            return self.stop_now()
        return NOTHING

    def _state_at(self, counter: int) -> tuple[ValveState, ...]:
        newest = self.sample is not None and self.sample.counter == counter
        return self._state_of_last() if newest else ()

    def stop_now(self) -> Step:
        """The gate stopped driving: tell the device at once."""
        if not self.active or self.gate.state is GateState.DRIVING or self.sample is None:
            return NOTHING
        answer = self._encode(self.sample.counter)
        return Step(valve_states=self._state_of_last(), answer=answer)

    def silence(self, elapsed_s: float) -> Step:
        """The device sent nothing for a while of wall time.

        In lockstep that is its right; in real time it ends driving.

        Parameters
        ----------
        elapsed_s : float

        Returns
        -------
        Step
        """
        if self.lockstep or elapsed_s < SILENCE_S or self.gate.state is not GateState.DRIVING:
            return NOTHING
        self.gate.trip(f"nothing from the device for {1e3 * SILENCE_S:.0f} ms")
        return self.stop_now()

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
