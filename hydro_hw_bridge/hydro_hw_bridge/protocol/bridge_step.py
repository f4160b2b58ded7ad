"""What follows from a frame or a command: samples and valve states to publish, answers sent."""

from __future__ import annotations

from dataclasses import dataclass

import can

from hydro_hw_bridge.protocol.frames import Readings


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
    """What followed from a frame or a command.

    Attributes
    ----------
    sample : Sample or None
        To publish.
    valve_states : tuple of ValveState
        To publish.
    answer : can.Message or None
        Has been sent; None where there was nothing to send or the bus did not take it.
    """

    sample: Sample | None = None
    valve_states: tuple[ValveState, ...] = ()
    answer: can.Message | None = None

    def and_then(self, later: Step) -> Step:
        """Both, one after the other.

        Parameters
        ----------
        later : Step
            Of the same frame.
        """
        return Step(
            later.sample or self.sample,
            (*self.valve_states, *later.valve_states),
            later.answer or self.answer,
        )


NOTHING = Step()


@dataclass(slots=True)
class CommandCounters:
    """Commands by what became of them; `not_driving` came while inactive or not ready.

    As `Outcome` of the gate: `accepted` ones are driven; `repeated` said the same for a cycle
    again; `outdated` came for an older one; `released` took the last command back, 0 V in its
    place, or said 0 V again; `denied` tripped the gate, or came while it was tripped. `foreign`
    are valve frames on the bus that the bridge did not send.
    """

    accepted: int = 0
    repeated: int = 0
    outdated: int = 0
    released: int = 0
    denied: int = 0
    not_driving: int = 0
    foreign: int = 0


@dataclass(slots=True)
class EchoCounters:
    """Valve frames that went wrong behind the bridge, by what the amplifiers say.

    Attributes
    ----------
    lost : int
        Left, and were not heard within `valve_echo.PATIENCE` cycles.
    refused : int
        Were heard, and failed their check or came too late.
    surplus : int
        Were heard and did not leave here: sent again on their way, or another sender's.
    """

    lost: int = 0
    refused: int = 0
    surplus: int = 0


@dataclass(slots=True)
class ReadingCounters:
    """Cycles with readings that cannot be, since the start.

    Attributes
    ----------
    jumps : int
        Positions that moved faster than the joint can.
    out_of_range : int
        Pressures that cannot be.
    stuck : int
        Encoders without a count of motion under an open valve.
    still : int
        Pressures without any noise for seconds: named, no reason to stop.
    strokes, temperatures : int
        Strokes and temperatures of the oil that cannot be: named, no reason to stop.
    """

    jumps: int = 0
    out_of_range: int = 0
    stuck: int = 0
    still: int = 0
    strokes: int = 0
    temperatures: int = 0
