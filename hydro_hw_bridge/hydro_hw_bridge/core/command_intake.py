"""The way in of commands: the cycle that each answers, who sends it, and what the gate says."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from hydro_hw_bridge.gate.gate import Gate, GateState, Outcome
from hydro_hw_bridge.protocol.bridge_step import CommandCounters
from hydro_hw_bridge.protocol.sample_clock import SampleClock

#: Samples that a command may answer: older ones are gone.
_ANSWERABLE = 64


class CommandIntake:
    """Takes commands to the gate by the cycles that they answer.

    Parameters
    ----------
    gate : Gate
    clock : SampleClock
        Of the stamps that commands carry.

    Attributes
    ----------
    counters : CommandCounters
    """

    def __init__(self, gate: Gate, clock: SampleClock) -> None:
        self._gate, self._clock = gate, clock
        self.counters = CommandCounters()
        self._whole: deque[int] = deque(maxlen=_ANSWERABLE)
        self._number: int | None = None

    def sampled(self, counter: int) -> None:
        """A cycle became a sample: commands may answer it.

        Parameters
        ----------
        counter : int
            Its sample counter.
        """
        self._whole.append(counter)

    def forget(self) -> None:
        """The device counts anew: what came before is no sample any longer."""
        self._whole.clear()

    def judge(
        self,
        stamp_ns: int,
        names: Sequence[str],
        voltages: Sequence[float],
        number: int | None,
    ) -> tuple[Outcome, int | None]:
        """Have the gate judge a command. There has been a sample.

        Parameters
        ----------
        stamp_ns : int
            Of the state it was computed from.
        names : sequence of str
        voltages : sequence of float
            V.
        number : int or None
            Of the message, counted by its publisher.

        Returns
        -------
        outcome : Outcome
        counter : int or None
            Of the sample that it answers; None where there was no such sample.
        """
        counter = self._answerable(stamp_ns)
        outcome = self._gate.command(counter, names, voltages, self._second(number))
        name = outcome.value
        setattr(self.counters, name, getattr(self.counters, name) + 1)
        return outcome, counter

    def _answerable(self, stamp_ns: int) -> int | None:
        """The counter of the sample with this stamp; None where there was no sample.

        A cycle of which a frame was lost is no sample: nobody can answer it.
        """
        counter = self._clock.counter_of(stamp_ns)
        outdated = counter is not None and counter < self._whole[0]
        return counter if outdated or counter in self._whole else None

    def _second(self, number: int | None) -> str:
        """Why a command is of a second publisher: one counts its messages up, two in turns."""
        last, self._number = self._number, number
        if number is None or last is None or number > last:
            return ""
        if self._gate.state is not GateState.DRIVING:
            return ""  # one that began anew while nothing is driven
        return "commands of two publishers: is there a second controller?"
