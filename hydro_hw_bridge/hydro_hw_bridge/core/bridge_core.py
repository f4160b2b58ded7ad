"""The bridge without bus, threads and ROS: frames and commands in, samples and answers out."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import can

from hydro_hw_bridge.core.command_intake import CommandIntake
from hydro_hw_bridge.core.supervision import FOREIGN, Supervision
from hydro_hw_bridge.core.valve_frames import ValveFrames
from hydro_hw_bridge.gate.gate import Gate, GateState, Outcome
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.assembler import WARY_CYCLES, Assembler, Cycle, CycleKind
from hydro_hw_bridge.protocol.bridge_step import NOTHING, Sample, Step
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Frame
from hydro_hw_bridge.protocol.sample_clock import SampleClock

#: In lockstep a cycle that is held is told again after a second: few are.
_WARY_IN_LOCKSTEP = 5
#: Cycles that are still answered with 0 V after deactivation: any one frame may be lost.
CLOSING_CYCLES = 5


def _taken(_frame: can.Message) -> bool:
    return True


class BridgeCore:
    """State machine between device and controller.

    In real time the device is told 0 V on every cycle while the bridge is active and does not
    drive, and every accepted command at once. In lockstep a frame answers a cycle: commands do,
    and a tripped gate does, so that device time goes on; while waiting for subscribers or for a
    first command nothing does, and the device repeats its cycle.

    Frames of the device go to `Supervision`, commands to `CommandIntake`; both go to the gate,
    and what that gives goes out by `ValveFrames`. A `Step` says what followed.

    Not thread-safe: callers hold one lock around every method. Frames are sent inside, so the
    order on the bus is the order of decisions: nothing decided before a stop is sent after it.

    Parameters
    ----------
    codec : Codec
    limits : GateLimits
    lockstep : bool
    send : callable
        Sends a frame at once; False where the bus did not take it.
    hears_itself : bool, optional
        What was sent may be heard again. Elsewhere every valve frame heard is another's.

    Attributes
    ----------
    gate : Gate
    clock : SampleClock
    assembler : Assembler
    commands : CommandCounters
    watch : ReadingsWatch
    echo : ValveEcho
    active : bool
    ready : bool
        The subscribers that the bridge was told to wait for are there.
    sample : Sample or None
        The newest cycle that was whole.
    """

    def __init__(
        self,
        codec: Codec,
        limits: GateLimits,
        *,
        lockstep: bool,
        send: Callable[[can.Message], bool] = _taken,
        hears_itself: bool = False,
    ) -> None:
        self.codec = codec
        self.lockstep, self._hears_itself = lockstep, hears_itself
        self.gate = Gate(limits)
        self.clock = SampleClock(round(limits.period_s * 1e9), whole_seconds=lockstep)
        wary = _WARY_IN_LOCKSTEP if lockstep else WARY_CYCLES
        self.assembler = Assembler(codec.cycle_frames, codec.sample_counter, wary)
        self._supervision = Supervision(codec, self.gate, lockstep=lockstep)
        self._intake = CommandIntake(self.gate, self.clock)
        self._valves = ValveFrames(codec, self.gate, send)
        self.commands = self._intake.counters
        self.watch = self._supervision.watch
        self.echo = self._valves.echo
        self.active = False
        self.ready = False
        self.sample: Sample | None = None
        self._begun: int | None = None
        self._closing = 0

    @property
    def spoke(self) -> bool:
        """A valve frame was sent."""
        return self._valves.spoke

    @property
    def read_late(self) -> int:
        """Cycles whose sync frame had waited too long to be read."""
        return self._supervision.read_late

    def carry_over(self, other: BridgeCore) -> None:
        """Take over what must outlive a core: a trip, the stamp from which on others grow, and
        which frames on the bus are its own.

        Parameters
        ----------
        other : BridgeCore
            The one before this.
        """
        # A trip is cleared by somebody who has seen its reason, not by starting anew.
        self.gate.carry_over(other.gate)
        self.clock.carry_over(other.clock)
        self._valves.own.take_over(other._valves.own)

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
            What was sent; None before the first cycle, or where the bus did not take it.
        """
        counter = self._to_answer
        return None if counter is None else self._valves.answer(counter)

    @property
    def _to_answer(self) -> int | None:
        """The cycle that is answered where the bridge speaks by itself; None before the first.

        In lockstep one that is whole: the device waits for the answer to it. In real time the
        newest that has begun, as amplifiers may take none for an older one.
        """
        if not self.lockstep:
            return self._begun
        return None if self.sample is None else self.sample.counter

    def receive(self, frame: Frame, now_ns: int) -> Step:
        """Take a frame of the device.

        Parameters
        ----------
        frame : Frame
        now_ns : int
            ROS time at which it came, used for the first sync frame only.
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
        held = NOTHING
        if cycle is not None and cycle.counter != counter:
            # It was held until this sync frame, and is over before what that says is looked at.
            held, cycle = self._cycle(cycle), None
        was = self.gate.state
        advanced, unfinished = counter != before, False
        if advanced:
            whole = None if self.sample is None else self.sample.counter
            unfinished = self._begun is not None and self._begun != whole
            self._begun = self.clock.extend(counter)
            self.gate.advance(self._begun, whole, self.assembler.missing)
        if counters.contradicted != contradicted and self.active:
            self._supervision.contradicted(frame)
        if frame.role == "sync":
            self._supervision.sync(frame, counter, advanced=advanced, active=self.active)
        if cycle is not None:
            return self._cycle(cycle)
        after = self._after(was)
        if unfinished and after is NOTHING:
            after = self._beside_samples()
        return after if held is NOTHING else held.and_then(after)

    def _beside_samples(self) -> Step:
        """In real time 0 V goes on where cycles lack a frame: any one 0 V may be lost."""
        answer = None if self.lockstep else self._own_answer()
        return NOTHING if answer is None else Step(answer=answer)

    def _restart(self) -> None:
        self._supervision.restarted()
        self.gate.forget()
        self._intake.forget()
        self._valves.forget()
        self.sample = self._begun = None

    def _cycle(self, cycle: Cycle) -> Step:
        if cycle.kind is CycleKind.REPEAT and self.sample is not None:
            return self._repeated(self.sample)
        late = self._valves.state_of(self.sample)
        counter = self.clock.extend(cycle.counter)
        readings = self.codec.readings(cycle.data)
        self.sample = Sample(self.clock.stamp_ns(counter), counter, readings, False)
        self._intake.sampled(counter)
        self.echo.heard(readings.echo, counter)
        on_wire_v = self._valves.on_wire_v
        self._supervision.cycle(readings, counter, on_wire_v, active=self.active)
        if self.codec.tells_clock:
            self._supervision.compare_clocks(readings.status, active=self.active)
        answer = self._own_answer()
        # Inactive in lockstep the cycle is still open: it may be answered once active.
        stated = answer is not None or not (self.active or self.lockstep)
        own = self._valves.state_of(self.sample) if stated else ()
        return Step(self.sample, (*late, *own), answer)

    def _repeated(self, known: Sample) -> Step:
        """A cycle that the device sent again, as its answer did not come or was lost."""
        self.sample = Sample(known.stamp_ns, known.counter, known.readings, True)
        answered = self._valves.answered == known.counter
        if answered and self.active and self.gate.state is GateState.DRIVING:
            # In real time an old command must not keep the amplifiers' watchdog quiet.
            answer = self._valves.repeat() if self.lockstep else None
        else:
            answer = self._own_answer()
        own = self._valves.state_of(self.sample) if answer is not None else ()
        return Step(None if answered else self.sample, own, answer)

    def _own_answer(self) -> can.Message | None:
        """What the bridge answered to the newest cycle without a command."""
        counter = self._to_answer
        if counter is None or (self.active and self.gate.state is GateState.DRIVING):
            return None
        if not self.active:
            if not self._closing:
                return None
            self._closing -= 1
        elif (
            self.lockstep
            and self.gate.state is GateState.WAITING
            and self._valves.answered != counter
        ):
            return None
        return self._valves.answer(counter)

    def command(
        self,
        stamp_ns: int,
        names: Sequence[str],
        voltages: Sequence[float],
        number: int | None = None,
        unheard_s: float = 0.0,
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
        unheard_s : float, optional
            For how long, by now, no new cycle of the device has been read. After a stall of this
            process a command may be taken before what the device said meanwhile: in real time
            it is as old as that, and drives nothing.
        """
        if not self.active or not self.ready or self.sample is None:
            self.commands.not_driving += 1
            return NOTHING
        begins_none = self._supervision.outdated and self.gate.state is GateState.WAITING
        if begins_none or self._supervision.too_long(unheard_s):
            self.commands.outdated += 1
            return NOTHING
        was = self.gate.state
        outcome, counter = self._intake.judge(stamp_ns, names, voltages, number)
        if outcome is Outcome.ACCEPTED and counter is not None:
            return self._valves.step(counter, self.sample, self._begun)
        if outcome is Outcome.RELEASED or self.gate.state is not was:
            return self.stop_now()
        return NOTHING

    def stop_now(self) -> Step:
        """The gate stopped driving: tell the device at once."""
        counter = self._to_answer
        if not self.active or self.gate.state is GateState.DRIVING or counter is None:
            return NOTHING
        return self._valves.step(counter, self.sample, self._begun)

    def _after(self, was: GateState) -> Step:
        """What follows where the gate is not as it was: it stopped driving."""
        return NOTHING if self.gate.state is was else self.stop_now()

    def silence(self, elapsed_s: float, *, others: bool = False) -> Step:
        """The device began no new cycle for a while, as of `Supervision.silence`.

        Parameters
        ----------
        elapsed_s : float
        others : bool, optional
            Other frames of the device come.
        """
        was = self.gate.state
        self._supervision.silence(elapsed_s, others=others)
        return self._after(was)

    def waited(self, waited_s: float) -> Step:
        """A sync frame had waited to be read, as of `Supervision.waited`.

        Parameters
        ----------
        waited_s : float
        """
        was = self.gate.state
        self._supervision.waited(waited_s)
        return self._after(was)

    def paced(self, at_s: float) -> Step:
        """The newest cycle's sync frame came, as of `Supervision.paced`.

        Parameters
        ----------
        at_s : float
        """
        counter = self.assembler.counter
        if counter is None:
            return NOTHING
        was = self.gate.state
        self._supervision.paced(self.clock.extend(counter), at_s, active=self.active)
        return self._after(was)

    def hear_command(self, frame: Frame) -> Step:
        """Take a valve frame off the bus: nothing is driven beside another sender.

        Parameters
        ----------
        frame : Frame
            Intact.
        """
        if self._hears_itself and frame.data in self._valves.own:
            return NOTHING
        self.commands.foreign += 1
        return self.condition(FOREIGN, "valve frames of another sender are on the bus")

    def fault(self, name: str, reason: str) -> Step:
        """A standing fault outside the commands began.

        Parameters
        ----------
        name, reason : str
        """
        was = self.gate.state
        self._supervision.fault(name, reason, active=self.active)
        return self._after(was)

    def condition(self, name: str, reason: str) -> Step:
        """A condition outside the commands, as it stands now.

        Parameters
        ----------
        name : str
        reason : str
            Empty: it does not hold.
        """
        was = self.gate.state
        self._supervision.condition(name, reason, active=self.active)
        return self._after(was)
