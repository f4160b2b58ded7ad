"""The way out to the valves: the gate's output as frames, and what of it is on the wire."""

from __future__ import annotations

from collections.abc import Callable

import can

from hydro_hw_bridge.bus.own_frames import OwnFrames
from hydro_hw_bridge.gate.gate import Gate
from hydro_hw_bridge.gate.held_voltages import WATCHDOG_S
from hydro_hw_bridge.monitoring.valve_echo import ValveEcho
from hydro_hw_bridge.protocol.bridge_step import Sample, Step, ValveState
from hydro_hw_bridge.protocol.codec import Codec


class ValveFrames:
    """Answers cycles with the gate's output, whatever that is, and keeps what left.

    Parameters
    ----------
    codec : Codec
    gate : Gate
    send : callable
        Sends a frame at once; False where the bus did not take it.

    Attributes
    ----------
    own : OwnFrames
    spoke : bool
        A frame was sent.
    on_wire_v : tuple of float
        What the valves get by the newest frame that left, V; 0 V before the first, and once the
        amplifiers are off for want of another.
    answered : int
        Sample counter of the cycle that was answered last; -1 where none was.
    echo : ValveEcho
        What became of them, by the amplifiers.
    """

    def __init__(self, codec: Codec, gate: Gate, send: Callable[[can.Message], bool]) -> None:
        self._codec, self._gate, self._send = codec, gate, send
        self.own = OwnFrames()
        self.echo = ValveEcho(codec.echo_spans, gate.held)
        self.spoke = False
        self._answer: can.Message | None = None
        self._asked = gate.output
        self._zero_v = (0.0,) * len(codec.valve_names)
        self._answer_v = self.on_wire_v = self._zero_v
        self.answered = -1
        self._stated = self._left = -1

    def forget(self) -> None:
        """The device counts anew: it was not answered yet, and its valves are at 0 V."""
        self.answered = self._stated = -1
        self.on_wire_v = self._zero_v
        self.echo.forget()
        self._gate.held.forget()

    def answer(self, counter: int) -> can.Message | None:
        """Send the gate's output as the answer to a cycle.

        Parameters
        ----------
        counter : int
            Its sample counter.

        Returns
        -------
        can.Message or None
            What was sent; None where the bus did not take it.
        """
        output = self._asked = self._gate.output
        self._answer = self._codec.encode_command(counter, output.voltages, output.enable)
        self.own.add(bytes(self._answer.data))
        # A frame with enable off is 0 V at the valves, whatever the wire has for 0 V.
        asked_v = output.voltages
        self._answer_v = self._codec.quantised(asked_v) if output.enable else asked_v
        self.answered = counter
        return self.repeat()

    def repeat(self) -> can.Message | None:
        """Send the newest answer, again if need be; only what left is on the wire.

        Returns
        -------
        can.Message or None
            As of `answer`.
        """
        if self._answer is None or not self._send(self._answer):
            return None
        self.spoke, self._left = True, self.answered
        self.echo.sent(self._asked.voltages)
        self.on_wire_v = self._answer_v
        return self._answer

    def step(self, counter: int, newest: Sample | None, begun: int | None) -> Step:
        """Answer a cycle, and tell what followed for the newest that is whole.

        Where a later one has begun, what leaves now is in force in that one: up to its begin
        the valves had what they had.

        Parameters
        ----------
        counter : int
            Sample counter of the cycle that is answered.
        newest : Sample or None
            The newest that is whole.
        begun : int or None
            Sample counter of the newest that has begun.
        """
        over = newest is not None and newest.counter != begun
        before = self.state_of(newest) if over else ()
        answer = self.answer(counter)
        stated = newest is not None and newest.counter == counter and answer is not None
        own = self.state_of(newest) if stated else ()
        return Step(valve_states=(*before, *own), answer=answer)

    def state_of(self, sample: Sample | None) -> tuple[ValveState, ...]:
        """The valve state of the newest cycle, once.

        Parameters
        ----------
        sample : Sample or None
            That cycle; None where there was none.
        """
        if sample is None or sample.counter == self._stated:
            return ()
        self._stated = sample.counter
        if self._are_off(sample):
            # Of a bus that takes nothing they do not hear the 0 V that is meant for them.
            self.on_wire_v = self._zero_v
        return (ValveState(sample.stamp_ns, self.on_wire_v, sample.readings.spools),)

    def _are_off(self, sample: Sample) -> bool:
        """Whether the amplifiers are off in a cycle, by themselves or as they were told."""
        status = sample.readings.status
        if status.amplifier_watchdog:
            return True
        if self._codec.tells_amplifiers:
            return not status.amplifier_enabled
        # Those that do not say are off without a frame, by the watchdog that they have to have.
        unheard = sample.counter - self._left
        return unheard * self._gate.limits.period_s >= WATCHDOG_S
