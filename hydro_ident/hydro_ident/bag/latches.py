"""Stretches in which the gate held the valves at 0 V against the command."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.grid import runs
from hydro_model.arrays import BoolArray, FloatArray

#: A command this far from 0 V asks for motion, a step of a converter of twelve bits over +-10 V:
#: a smaller one is rounded to 0 V. The applied voltage may follow it this many cycles later; a
#: shorter disagreement is delay, not a latch.
_COMMANDED_V = 5e-3
FOLLOW_CYCLES = 3


@dataclass(slots=True)
class LatchFinder:
    """Finds latched cycles among cycles that come stretch by stretch."""

    _met: int = 0
    _open: bool = False
    #: Of the zeros that go on: the cycles in which motion was commanded, and the first of these;
    #: and whether it was in the last ones, which may be those that end the zeros.
    _denied: int = 0
    _first: int = 0
    _last: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))

    def add(self, applied_v: FloatArray, command_v: FloatArray) -> list[tuple[int, int]]:
        """Take in the next cycles.

        Parameters
        ----------
        applied_v, command_v : (N, m) array
            NaN where not recorded.

        Returns
        -------
        list of (int, int)
            Begin and end (exclusive) of the latches that ended, counted from the first cycle.
        """
        count, found = len(applied_v), []
        still = np.asarray((np.nan_to_num(applied_v, nan=1.0) == 0.0).all(axis=1), dtype=np.bool_)
        asked = np.asarray(np.any(np.abs(np.nan_to_num(command_v)) > _COMMANDED_V, axis=1))
        if self._open and count and not still[0]:
            found += self._ended(self._met)
        for begin, end in runs(still):
            self._go_on(self._met + begin, asked[begin:end])
            if end < count:
                found += self._ended(self._met + end)
        self._met += count
        return found

    def finish(self) -> list[tuple[int, int]]:
        """The latch that lasts to the end, if there is one."""
        return self._ended(self._met) if self._open else []

    @property
    def since(self) -> int | None:
        """First cycle of a latch that may go on; None where none does."""
        return self._first if self._open and self._denied else None

    def _go_on(self, begin: int, asked: BoolArray) -> None:
        if not self._open:
            self._open, self._denied, self._last = True, 0, asked[:0]
        begin -= len(self._last)
        asked = np.concatenate([self._last, asked])
        settled = max(0, len(asked) - FOLLOW_CYCLES)
        denied = np.flatnonzero(asked[:settled])
        if denied.size and not self._denied:
            self._first = begin + int(denied[0])
        self._denied += denied.size
        self._last = asked[settled:]

    def _ended(self, end: int) -> list[tuple[int, int]]:
        self._open = False
        return [(self._first, end)] if self._denied >= FOLLOW_CYCLES else []


def latched_cycles(
    count: int, applied_v: FloatArray | None, command_v: FloatArray | None
) -> BoolArray:
    """Cycles in which the gate held every valve at 0 V although motion was commanded.

    Parameters
    ----------
    count : int
        Number of cycles N.
    applied_v, command_v : (N, m) array or None
        From `/valve_state` and `/valve_command`; both are needed to tell.

    Returns
    -------
    (N,) bool array
        True in stretches of exact zeros that last longer than the delay from a command to its
        application, and in which a command was other than zero.
    """
    latched = np.zeros(count, dtype=np.bool_)
    if applied_v is None or command_v is None:
        return latched
    finder = LatchFinder()
    for begin, end in [*finder.add(applied_v, command_v), *finder.finish()]:
        latched[begin:end] = True
    return latched
