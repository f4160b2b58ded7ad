"""Valve frames on their way to the amplifiers, by the amplifiers' own counts of them. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from hydro_hw_bridge.gate.held_voltages import PATIENCE, HeldVoltages
from hydro_hw_bridge.protocol.bridge_step import EchoCounters
from hydro_hw_bridge.protocol.frames import Echo


class ValveEcho:
    """Compares what left with what was heard.

    Parameters
    ----------
    spans : sequence of int
        After how many `Echo.taken` and `Echo.refused` begin anew; empty: nothing is told.
    held : HeldVoltages
        Told what left and how much of it was taken.

    Attributes
    ----------
    counters : EchoCounters
    """

    def __init__(self, spans: Sequence[int], held: HeldVoltages) -> None:
        self._spans, self._held = tuple(spans), held
        self.counters = EchoCounters()
        self.forget()

    def forget(self) -> None:
        """The device counts anew, or was not heard for long: what is under way is unknown."""
        self._known: tuple[Echo, int] | None = None
        self._open = 0
        self._recent: deque[int] = deque(maxlen=PATIENCE)

    def sent(self, voltages: tuple[float, ...]) -> None:
        """A valve frame left.

        Parameters
        ----------
        voltages : tuple of float
            As of `HeldVoltages.sent`.
        """
        self._held.sent(voltages, told=bool(self._spans))
        if self._known is not None:
            self._open += 1

    def heard(self, echo: Echo | None, counter: int) -> None:
        """What the amplifiers say in a cycle.

        Parameters
        ----------
        echo : Echo or None
        counter : int
            The cycle's sample counter, without wrap.
        """
        if echo is None:
            return
        # A count that may have gone around says nothing.
        if self._known is None or not 0 < counter - self._known[1] < min(self._spans):
            self.forget()
        else:
            before, since = self._known
            taken = (echo.taken - before.taken) % self._spans[0]
            self._held.took(taken, since, counter)
            self._compare(before, echo, taken)
        self._known = echo, counter

    def _compare(self, before: Echo, now: Echo, taken: int) -> None:
        refused = (now.refused - before.refused) % self._spans[1]
        self.counters.refused += refused
        self._open -= taken + refused
        surplus = max(-self._open, 0)
        self.counters.surplus += surplus
        self._open += surplus
        self._recent.append(self._open)
        # What was open all the while is not under way any more.
        lost = min(self._recent) if len(self._recent) == PATIENCE else 0
        if lost:
            self.counters.lost += lost
            self._open -= lost
            self._recent.clear()
