"""The safety gate: the only way from a command to the valves. Pure, default deny.

It waits for a first good command, then drives, and trips on the first thing that is not right. A
trip means 0 V and enable off, latched with its reason until cleared. Counters are sample counters
of the device, so ages are device time in lockstep and in real time alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from hydro_hw_bridge.gate.amplifier_watch import AmplifierWatch
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.held_voltages import ROUNDING_V, HeldVoltages
from hydro_hw_bridge.gate.output_ramp import RATE_FACTOR, OutputRamp
from hydro_hw_bridge.gate.permissives import Inputs, missing_permissive


class GateState(Enum):
    """WAITING: 0 V until a first good command; DRIVING; TRIPPED: 0 V until cleared."""

    WAITING = "waiting"
    DRIVING = "driving"
    TRIPPED = "tripped"


class Outcome(Enum):
    """What became of one command."""

    ACCEPTED = "accepted"
    REPEATED = "repeated"
    OUTDATED = "outdated"
    RELEASED = "released"
    DENIED = "denied"


@dataclass(frozen=True, slots=True)
class Output:
    """What goes to the amplifiers: V per valve, and enable."""

    voltages: tuple[float, ...]
    enable: bool


#: Of what a command says, so many names with so many characters are told.
_NAMES_TOLD, _NAME_LENGTH = 8, 40


class Gate:
    """One gate for all valves of a machine.

    Parameters
    ----------
    limits : GateLimits

    Attributes
    ----------
    state : GateState
    reason : str
        Of the latched trip; empty when not tripped.
    trips : int
        Since the start.
    faults : dict of str
        Standing conditions outside the commands, by name: none may be there to drive.
    held : HeldVoltages
        Where the valves may be; for whoever sends the output to keep.
    """

    def __init__(self, limits: GateLimits) -> None:
        self.limits = limits
        self.state = GateState.WAITING
        self.reason = ""
        self.trips = 0
        self.faults: dict[str, str] = {}
        self._zero = (0.0,) * len(limits.valve_names)
        self._inputs: Inputs | None = None
        self._defect = ""
        self._defect_at = 0
        self._newest: int | None = None
        self._first = 0
        self._accepted = 0
        self._command = self._zero
        self.held = HeldVoltages(limits)
        self._ramp = OutputRamp(limits, self.held)
        self._amplifiers = AmplifierWatch(limits, self.held)
        self._released: int | None = None

    def carry_over(self, other: Gate) -> None:
        """Take over what must outlive a gate: its trip with the reason, faults and counts.

        Parameters
        ----------
        other : Gate
            The one before this.
        """
        self.trips, self.faults = other.trips, dict(other.faults)
        self._ramp.cleared = other._ramp.cleared
        if other.state is GateState.TRIPPED:
            self.state, self.reason = GateState.TRIPPED, other.reason

    @property
    def output(self) -> Output:
        """What the amplifiers shall do now."""
        if self.state is not GateState.DRIVING:
            return Output(self._zero, enable=False)
        return Output(self._ramp.applied_v, enable=True)

    def arm(self) -> None:
        """Wait for a first command of the newest or a later cycle; a trip stays latched."""
        self._first = 0 if self._newest is None else self._newest
        if self.state is not GateState.TRIPPED:
            self._wait()
        if self.faults:
            self.trip(next(iter(self.faults.values())))

    def forget(self) -> None:
        """The device counts anew: nothing known of its cycles holds any longer."""
        self._newest = self._inputs = self._released = None
        self._first = 0
        self._defect = ""

    def _wait(self) -> None:
        self.state, self.reason = GateState.WAITING, ""
        self._ramp.reset()

    def trip(self, reason: str) -> None:
        """0 V and enable off, until cleared. The first reason is kept.

        Parameters
        ----------
        reason : str
        """
        if self.state is GateState.TRIPPED:
            return
        self._wait()
        self.state, self.reason = GateState.TRIPPED, reason
        self.trips += 1

    def set_fault(self, name: str, reason: str) -> None:
        """Trip, and refuse to be cleared as long as the fault stands.

        Parameters
        ----------
        name, reason : str
        """
        self.faults[name] = reason
        self.trip(reason)

    def end_fault(self, name: str) -> None:
        """The fault is gone; its trip stays until cleared."""
        self.faults.pop(name, None)

    def clear(self) -> tuple[bool, str]:
        """Clear a trip whose cause is gone; then wait for a first good command.

        Returns
        -------
        done : bool
        text : str
            What was cleared, or why it was refused.
        """
        if self.state is not GateState.TRIPPED:
            return True, f"not tripped ({self.state.value})"
        cause = next(iter(self.faults.values()), "") or self._missing() or self._fresh_defect()
        if cause:
            return False, f"still there: {cause}"
        reason = self.reason
        self._wait()
        self._ramp.cleared = True
        self.arm()
        return True, f"cleared: {reason}"

    def _fresh_defect(self) -> str:
        """What is wrong with the last command, as long as it is not a thing of the past."""
        if self._newest is None or self._newest - self._defect_at > self.limits.max_age_cycles:
            return ""
        return self._defect

    def advance(self, counter: int, whole: int | None = None, missing: Sequence[str] = ()) -> None:
        """A cycle of the device began: time went on.

        Parameters
        ----------
        counter : int
            Its sample counter.
        whole : int, optional
            That of the newest cycle that was whole, where it is known.
        missing : sequence of str, optional
            Frames that the cycle before lacked.
        """
        self._newest = counter
        if self.state is GateState.DRIVING:
            age = counter - self._accepted
            if age > self.limits.max_age_cycles:
                starved = None if whole is None else counter - whole
                self.trip(self._too_old(age, starved, missing))

    def _too_old(self, age: int, starved: int | None, missing: Sequence[str]) -> str:
        """No command came, or none could: there was nothing that one could answer."""
        if starved is None or starved < self.limits.max_age_cycles:
            return f"no command for {self._milliseconds(age)} ({self._age_limit()})"
        lacking = f", missing {', '.join(missing)}" if missing else ""
        return f"no whole cycle for {self._milliseconds(starved)}{lacking} ({self._age_limit()})"

    def check(self, inputs: Inputs) -> None:
        """Hold the machine's inputs of a complete cycle against the permissives.

        Parameters
        ----------
        inputs : Inputs
        """
        self._inputs = inputs
        if self.state is GateState.DRIVING:
            silent = self._amplifiers.look(inputs.amplifiers_on, self._driven_cycles())
            reason = self._missing() or silent
            if reason:
                self.trip(reason)

    def command(
        self,
        counter: int | None,
        names: Sequence[str],
        voltages: Sequence[float],
        sender: str = "",
    ) -> Outcome:
        """Judge one command.

        Parameters
        ----------
        counter : int or None
            Sample counter of the cycle whose stamp it carries; None for a stamp of no complete
            cycle.
        names : sequence of str
            Valves, in any order, each once.
        voltages : sequence of float
            V.
        sender : str, optional
            What is wrong with who sends it: nothing is driven by it. Said behind what is wrong
            with the command itself.

        Returns
        -------
        Outcome
            ACCEPTED, and `output` follows it; REPEATED or OUTDATED, ignored; RELEASED, the
            controller took its command back to 0 V, or said 0 V again; DENIED, the gate is or
            now is tripped.
        """
        defect, values = self._judge(names, voltages)
        self._defect, self._defect_at = defect, self._newest or 0
        if self.state is GateState.TRIPPED:
            return Outcome.DENIED
        if counter is None or self._newest is None or counter > self._newest:
            return self._deny("command with a stamp that is of no complete cycle", sender)
        if defect or sender:  # whichever cycle it answers: who sends it is not sound
            return self._deny(defect, sender)
        if counter < self._first:
            return Outcome.OUTDATED
        if self.state is GateState.DRIVING and counter <= self._accepted:
            return self._again(counter, values)
        if self.state is GateState.DRIVING:
            return self._follow(counter, values)
        if self._newest - counter > self.limits.first_age_cycles:
            return Outcome.OUTDATED  # nothing is driven yet: go on waiting for a fresh one
        return self._begin(counter, values)

    def _deny(self, *reasons: str) -> Outcome:
        self.trip("; ".join(filter(None, reasons)))
        return Outcome.DENIED

    def _again(self, counter: int, values: tuple[float, ...]) -> Outcome:
        """A command for a cycle that was answered already."""
        if counter < self._accepted:
            return Outcome.OUTDATED
        if values == self._zero:
            return self._release(counter)
        if values == self._command:
            return Outcome.REPEATED
        return self._deny("two different commands for one stamp: is there a second controller?")

    def _release(self, counter: int) -> Outcome:
        """A controller that stops takes its last command back: not an error, and 0 V at once.

        Twice at once no controller stops: somebody else goes on driving. 0 V that is said again
        takes back nothing that anybody could go on with.
        """
        if self._command != self._zero:
            before, self._released = self._released, counter
            if before is not None and counter - before <= self.limits.max_age_cycles:
                return self._deny(
                    f"commands taken back twice in {self._milliseconds(counter - before)}:"
                    " is there a second controller?"
                )
        self._wait()
        self._first = counter + 1
        return Outcome.RELEASED

    def _begin(self, counter: int, values: tuple[float, ...]) -> Outcome:
        missing = self._missing()
        if missing:
            return self._deny(missing)
        self.state = GateState.DRIVING
        self._ramp.begin(counter)
        self._amplifiers.begin()
        self._accept(counter, values)
        return Outcome.ACCEPTED

    def _follow(self, counter: int, values: tuple[float, ...]) -> Outcome:
        cycles = counter - self._accepted
        legal = self.limits.legal_step_v * cycles
        if values == self._zero:
            # Whoever stops may stop at once.
            self._accept(counter, values)
            return Outcome.ACCEPTED
        for name, value, before in zip(
            self.limits.valve_names, values, self._command, strict=True
        ):
            step = abs(value - before)
            if step > RATE_FACTOR * legal + ROUNDING_V:
                return self._deny(
                    f"{name}: step of {step:.3f} V in {self._milliseconds(cycles)}"
                    f" (limit {RATE_FACTOR * legal:.3f} V)"
                )
        self._accept(counter, values)
        return Outcome.ACCEPTED

    def _accept(self, counter: int, values: tuple[float, ...]) -> None:
        self._accepted, self._command = counter, values
        if self._inputs is not None and self._inputs.amplifiers_on is False:
            # They would come on at the voltage of then, in one step.
            self._ramp.hold(counter)
        else:
            self._ramp.follow(counter, values)

    def _judge(
        self, names: Sequence[str], voltages: Sequence[float]
    ) -> tuple[str, tuple[float, ...]]:
        """What is wrong with a command by itself, and its voltages in the gate's order."""
        valves = self.limits.valve_names
        if sorted(names) != sorted(valves) or len(voltages) != len(valves):
            return (
                f"command for valves {_told(names) or 'none'} with {len(voltages)} voltages,"
                f" expected each of {', '.join(valves)} once"
            ), ()
        at = dict(zip(names, voltages, strict=True))
        values = tuple(float(at[name]) for name in valves)
        for name, value, rated in zip(valves, values, self.limits.rated_voltage_v, strict=True):
            if not math.isfinite(value):
                return f"{name}: command is not finite ({value})", values
            if abs(value) > rated:
                return f"{name}: command of {value:.3f} V (rated {rated:g} V)", values
        return "", values

    def _missing(self) -> str:
        """The first permissive that is not there; empty where all are."""
        return missing_permissive(self._inputs, self.limits, settled=self._settled())

    def _settled(self) -> bool:
        """Whether the amplifiers had time to answer to enable: before, their watchdog is tripped
        for want of enabled frames."""
        return (
            self.state is GateState.DRIVING and self._driven_cycles() > self.limits.max_age_cycles
        )

    def _driven_cycles(self) -> int:
        """How many cycles were driven until the newest."""
        return 0 if self._newest is None else self._ramp.driven_cycles(self._newest)

    def _milliseconds(self, cycles: int) -> str:
        return f"{1e3 * self.limits.period_s * cycles:.0f} ms"

    def _age_limit(self) -> str:
        return f"limit {self._milliseconds(self.limits.max_age_cycles)}"


def _told(names: Sequence[str]) -> str:
    """Names out of a message, which may hold anything, as text for a log."""
    shown = [
        name[:_NAME_LENGTH].encode("unicode_escape").decode("ascii")
        for name in names[:_NAMES_TOLD]
    ]
    rest = [f"and {len(names) - _NAMES_TOLD} more"] if len(names) > _NAMES_TOLD else []
    return ", ".join(shown + rest)
