"""Machine, bridge and controller in one process, cycle by cycle, with faults between them.

The rig's core with its amplifiers, the bridge's core and the fault line are the real ones; what
is left out is DDS, threads and the wall clock: time is the device's. The same arguments give the
same run. What is recorded is what stands at the valves: the amplifiers' output.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import can

from hydro_hw_bridge.bus.link import CommandLink
from hydro_hw_bridge.core.bridge_core import BridgeCore
from hydro_hw_bridge.core.bridge_turns import SECOND_BRIDGE
from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE, BusFault
from hydro_hw_bridge.faults.command_faults import Command, CommandFault, Publisher
from hydro_hw_bridge.faults.line import FaultLine
from hydro_hw_bridge.faults.line_bus import LineBus
from hydro_hw_bridge.faults.machine_faults import PERMISSIVES, SUPPLY, MachineFault
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.bridge_step import Sample, Step
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame, Readings
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.device import Device

START_NS = 1_700_000_000_000_000_000
#: Kinds of faults that are in a sample or nowhere.
READ_WHOLE = ("jump", "extreme", "clock_bit")
#: A cycle in lockstep is sent so many times before the bench gives up on an answer.
TRIES = 3


class Commander(Protocol):
    """A sound publisher of commands."""

    def answer(self, sample: Sample) -> Command | None:
        """The command that follows from a sample."""


class WatchedCodec(Codec):
    """A codec that remembers the frames that samples were made of."""

    made_of: list[Mapping[str, bytes]]

    def readings(self, data: Mapping[str, bytes]) -> Readings:
        """The readings of one cycle."""
        self.made_of.append(dict(data))
        return super().readings(data)


@dataclass(frozen=True, slots=True)
class ValveInput:
    """What stands at the valves over one cycle.

    Attributes
    ----------
    cycle : int
        Cycles of the device since the start.
    voltages : tuple of float
        V.
    enabled, watchdog : bool
        Of the amplifiers.
    gate : str
        State of the bridge's gate.
    age_cycles : int
        Cycles since the sample that the newest command taken by the amplifiers answers.
    permitted : bool
        Emergency stop, pump and enable switch were all closed.
    """

    cycle: int
    voltages: tuple[float, ...]
    enabled: bool
    watchdog: bool
    gate: str
    age_cycles: int
    permitted: bool = True

    @property
    def stopped(self) -> bool:
        """0 V everywhere, and not enabled."""
        return not self.enabled and not any(self.voltages)


@dataclass
class Bench:
    """One machine with its bridge and controller.

    `rows` collects what the valves got.

    Parameters
    ----------
    rig : RigCore
    codec : WatchedCodec
    limits : GateLimits
    commander : Commander
    bus, publisher, machine : sequences of faults
    lockstep : bool
    """

    rig: RigCore
    codec: WatchedCodec
    limits: GateLimits
    commander: Commander
    bus: Sequence[BusFault] = ()
    publisher: Sequence[CommandFault] = ()
    machine: Sequence[MachineFault] = ()
    lockstep: bool = False
    rows: list[ValveInput] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.codec.made_of = []
        self.cycle = self.steps = 0
        self.line = FaultLine(self.codec, self.bus)
        self.end = LineBus(self.line)
        self.device = Device(self.rig, self.codec, self.end, lockstep=self.lockstep)
        self._publisher = Publisher(self.publisher, round(1e9 * self.limits.period_s))
        self._inbox: list[can.Message] = []
        self._others_answer = any(
            fault.kind == "foreign" and fault.direction == BRIDGE for fault in self.bus
        )
        self._unanswered: Sample | None = None
        self._answered_cycle = 0
        self._silent = 0
        self._shown_cycle = -1
        self._dropped: set[MachineFault] = set()
        self._whole: set[int] = set()
        self._told: dict[int, int] = {}
        self.start_bridge()

    def start_bridge(self) -> None:
        """A bridge that was just started and activated."""
        self.link = CommandLink(self.end, self.limits.max_age_cycles)
        self.core = BridgeCore(
            self.codec, self.limits, lockstep=self.lockstep, send=self.link.send
        )
        self.core.activate(ready=True)
        self._inbox.clear()
        self._silent = 0

    def run(self, cycles: int) -> None:
        """Go on for so many cycles of the device."""
        for _ in range(cycles):
            self.step()

    def step(self) -> None:
        """One cycle of the device; in lockstep, where nobody answers, a few tries of it."""
        self._step()
        self.steps += 1

    def _step(self) -> None:
        self._turn_inputs()
        if self._acting("device_restart"):
            self.rig.counter = 0
        newest: CommandFrame | None = None
        for _ in range(TRIES if self.lockstep else 1):
            newest = self._try()
            if newest is not None:
                break
        if newest is None and self.lockstep:
            return  # the device waits: nothing of its time passes
        if newest is None:
            self.rig.actuate(None)
        else:
            span = (1 << newest.answered_bits) - 1
            self._answered_cycle = self.cycle - ((self.rig.counter - newest.answered) & span)
            self.rig.actuate(newest.voltages, newest.enable)
        self._record()
        self.cycle += 1

    def _try(self) -> CommandFrame | None:
        """Send the cycle's frames; the newest valid answer."""
        self.end.out.clear()
        arriving: list[can.Message] = []
        self._told[self.rig.counter] = self.line.cycle + 1
        if not self._acting("device_silent"):
            for message in self.device.frames():
                arriving += self.line.take(message, DEVICE)
        self._inbox += arriving
        if not self._acting("bridge_dead", "bridge_stopped"):
            self._let_bridge_work()
        answers = self.line.late_answers()
        for message in self.end.out:
            carried = self.line.take(message, BRIDGE)
            answers += carried
            if self._others_answer:  # on the bus, where the bridge hears them, too
                self._inbox += [one for one in carried if one is not message]
        newest = None
        for message in answers:
            command = self.device.decoded(message)
            if command is not None and self.device.takes(command):
                newest = command
        return newest

    def _let_bridge_work(self) -> None:
        inbox, self._inbox = self._inbox, []
        heard = False
        for message in inbox:
            frame = self.codec.receive(message)
            if frame is None:
                continue
            if frame.role == "command":
                if frame.intact:
                    self._follow(self.core.hear_command(frame))
                continue
            heard = heard or (frame.role == "sync" and frame.intact)
            if frame.role == "claim":
                if frame.intact:
                    self.core.fault(SECOND_BRIDGE, "a second bridge is on the bus")
                continue
            self._follow(self.core.receive(frame, self._now_ns()))
        self._silent = 0 if heard else self._silent + 1
        self.core.silence(self._silent * self.limits.period_s)
        self._let_controller_work()
        self.end.look()
        for name, reason in self.link.conditions():
            self.core.condition(name, reason)
        if self._acting("deactivated"):
            self.core.deactivate()

    def _now_ns(self) -> int:
        steps = (f for f in self.machine if f.kind == "clock_step")
        stepped = sum(f.amount for f in steps if self.cycle >= f.first_cycle)
        return START_NS + round(1e9 * (self.cycle * self.limits.period_s + stepped))

    def _follow(self, step: Step) -> None:
        if step.sample is not None:
            self.samples.append(step.sample)
            self._whole.add(self._told.get(step.sample.counter, self.line.cycle))
            self._unanswered = step.sample

    def _let_controller_work(self) -> None:
        """It answers the newest sample, however many came at once."""
        sample = self._unanswered
        commands = self._publisher.due(self.cycle)
        if sample is not None and not self._acting("controller_stopped"):
            self._unanswered = None
            command = self.commander.answer(sample)
            if command is not None:
                commands += self._publisher.take(command, self.cycle)
        for one in commands:
            self._follow(self.core.command(one.stamp_ns, one.names, one.voltages))

    def _acting(self, *kinds: str) -> bool:
        return any(f.kind in kinds and f.acts(self.steps) for f in self.machine)

    def _turn_inputs(self) -> None:
        self.rig.set_inputs(
            **{field_name: not self._acting(kind) for kind, field_name in PERMISSIVES.items()}
        )
        # What was sent of a cycle stays: in lockstep it is sent again until it is answered.
        if self.rig.cycles != self._shown_cycle:
            for fault in self.machine:
                if fault.kind == SUPPLY and fault.acts(self.steps):
                    self.rig.drop_supply(fault.amount)
                    self._dropped.add(fault)
        self._shown_cycle = self.rig.cycles

    def _record(self) -> None:
        amplifier = self.rig.amplifier
        self.rows.append(
            ValveInput(
                self.cycle,
                tuple(amplifier.output_v.tolist()),
                amplifier.enabled,
                amplifier.tripped,
                self.core.gate.state.value,
                self.cycle - self._answered_cycle,
                not self._acting(*PERMISSIVES),
            )
        )

    def absent(self) -> set[BusFault | CommandFault | MachineFault]:
        """Faults that did not take place.

        Those of the publisher met no command, as there was no sample to answer; a supply's fell
        into one cycle of lockstep that had been sent before and was sent again; of a sensor's none
        of its cycles was whole.
        """
        supply = {fault for fault in self.machine if fault.kind == SUPPLY}
        unread = {
            fault
            for fault in self.bus
            if fault.kind in READ_WHOLE and not any(map(fault.acts, self._whole))
        }
        return (set(self.publisher) - self._publisher.met) | (supply - self._dropped) | unread

    def be_sound(self) -> None:
        """End what is still wrong with the publisher: in lockstep its cycles may not have come."""
        if any(fault.acts(self.cycle) for fault in self.publisher):
            self._publisher = Publisher((), round(1e9 * self.limits.period_s))

    def partial_samples(self) -> list[str]:
        """Samples that are not, frame by frame, what the device sent in one of its cycles."""
        return [text for data in self.codec.made_of if (text := self._partial(data))]

    def _partial(self, data: Mapping[str, bytes]) -> str:
        sync = self.codec.cycle_frames[0]
        frame = self.codec.receive(
            can.Message(
                arbitration_id=self.codec.device_ids[0], is_extended_id=False, data=data[sync]
            )
        )
        assert frame is not None
        counter = self.codec.sample_counter(frame)
        sent = self.line.sent(counter)
        ids = dict(zip(self.codec.cycle_frames, self.codec.device_ids, strict=True))
        wrong = [n for n, i in ids.items() if data.get(n) not in sent.get(i, set())]
        return f"cycle {counter}: {', '.join(wrong)} not of it" if wrong else ""
