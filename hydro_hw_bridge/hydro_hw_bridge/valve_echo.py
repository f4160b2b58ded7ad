"""Valve frames on their way to the amplifiers, by the amplifiers' own counts of them. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from hydro_hw_bridge.bridge_step import EchoCounters
from hydro_hw_bridge.frames import Echo

#: Cycles after which a frame that nobody has heard is lost: twice what a command may be old.
PATIENCE = 10


class ValveEcho:
    """Compares what left with what was heard.

    Parameters
    ----------
    spans : sequence of int
        After how many `Echo.taken` and `Echo.refused` begin anew; empty: nothing is told.

    Attributes
    ----------
    counters : EchoCounters
    """

    def __init__(self, spans: Sequence[int]) -> None:
        self._spans = tuple(spans)
        self.counters = EchoCounters()
        self.forget()

    def forget(self) -> None:
        """The device counts anew, or was not heard for long: what is under way is unknown."""
        self._known: tuple[Echo, int] | None = None
        self._open = 0
        self._recent: deque[int] = deque(maxlen=PATIENCE)

    def sent(self) -> None:
        """A valve frame left."""
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
            self._compare(self._known[0], echo)
        self._known = echo, counter

    def _compare(self, before: Echo, now: Echo) -> None:
        taken = (now.taken - before.taken) % self._spans[0]
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
