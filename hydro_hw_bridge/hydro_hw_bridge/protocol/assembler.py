"""Frames to whole cycles: never part of one, never two mixed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from hydro_hw_bridge.protocol.frames import Frame

_WRAP = 1 << 32
#: A counter further ahead than this (37 h at 500 Hz) went back, whenever it will come around.
_FURTHEST = 1 << 26
_ALIVE = 15


class CycleKind(Enum):
    """NEW; REPEAT: sent again under the same counter; RESTART: new, the device counts anew."""

    NEW = "new"
    REPEAT = "repeat"
    RESTART = "restart"


@dataclass(frozen=True, slots=True)
class Cycle:
    """A complete cycle.

    Attributes
    ----------
    counter : int
        Sample counter, 32 bits.
    kind : CycleKind
    data : dict from frame name to bytes
        As first received: a repeated cycle is accepted once.
    """

    counter: int
    kind: CycleKind
    data: dict[str, bytes]


@dataclass(slots=True)
class CycleCounters:
    """What was received since the start.

    Attributes
    ----------
    complete, repeated, restarts : int
        Cycles.
    lost : int
        Cycles whose sync frame did not arrive.
    incomplete : int
        Tries of cycles with a sync frame that lacked another frame.
    corrupt : int
        Frames with wrong length, CRC or alive counter.
    out_of_order : int
        Frames of another cycle than the present one.
    duplicates : int
        Frames that a cycle had already.
    contradicted : int
        Cycles with two different frames of one name, of which one is not the device's.
    """

    complete: int = 0
    repeated: int = 0
    restarts: int = 0
    lost: int = 0
    incomplete: int = 0
    corrupt: int = 0
    out_of_order: int = 0
    duplicates: int = 0
    contradicted: int = 0


class Assembler:
    """Collects the frames of one cycle after another; the sync frame goes first.

    Parameters
    ----------
    frames : sequence of str
        Names of the frames of a cycle, sync first.
    sample_counter : callable
        Takes the sync frame.

    Attributes
    ----------
    counters : CycleCounters
    counter : int or None
        Of the present cycle, complete or not.
    """

    def __init__(self, frames: Sequence[str], sample_counter: Callable[[Frame], int]) -> None:
        self.counters = CycleCounters()
        self.counter: int | None = None
        self._size = len(frames)
        self._sample_counter = sample_counter
        self._kind = CycleKind.NEW
        self._data: dict[str, bytes] = {}
        self._seen: set[str] = set()
        # Before the first cycle there is none to be missed.
        self._emitted = True
        self._open = False
        self._first_try = True
        self._backward: int | None = None

    def add(self, frame: Frame) -> Cycle | None:
        """Take one frame of role sync or cycle.

        Parameters
        ----------
        frame : Frame

        Returns
        -------
        Cycle or None
            The cycle that this frame completes.
        """
        if not frame.intact:
            self.counters.corrupt += 1
            return None
        taken = self._sync(frame) if frame.role == "sync" else self._belongs(frame)
        if not taken:
            return None
        self._seen.add(frame.name)
        self._data.setdefault(frame.name, frame.data)
        there = self._seen if self._emitted else self._data
        return self._emit() if len(there) == self._size else None

    def _belongs(self, frame: Frame) -> bool:
        expected = None if self.counter is None else self.counter & _ALIVE
        if not self._open or (frame.alive is not None and frame.alive != expected):
            self.counters.out_of_order += 1
            return False
        if frame.name in self._seen:
            # A device that sends a cycle again may have measured anew.
            if self._first_try and self._data[frame.name] != frame.data:
                self._contradict()
            else:
                self.counters.duplicates += 1
            return False
        return True

    def _contradict(self) -> None:
        """Nobody knows which of two frames is the device's: nothing more of this try is taken."""
        self.counters.contradicted += 1
        self._open = False
        if not self._emitted:
            self._data, self._seen = {}, set()

    def _emit(self) -> Cycle:
        kind = self._kind
        if self._emitted:
            kind = CycleKind.REPEAT
            self.counters.repeated += 1
        else:
            self.counters.complete += 1
        self._emitted = True
        # Two tries together may have made it whole: the rest of the second is no repeat.
        self._seen = set(self._data)
        return Cycle(self.counter or 0, kind, self._data)

    def _sync(self, frame: Frame) -> bool:
        counter = self._sample_counter(frame)
        if frame.alive is not None and frame.alive != counter & _ALIVE:
            self.counters.corrupt += 1
            return False
        if self.counter is None:
            self._begin(counter, CycleKind.NEW)
            return True
        ahead = (counter - self.counter) % _WRAP
        if ahead > _FURTHEST:
            return self._goes_back(counter)
        self._backward = None
        if ahead == 0:
            # Begun, and begun again before it was whole; a sync frame that came twice is no try.
            self.counters.incomplete += not self._emitted and len(self._seen) > 1
            self._seen = set()
            self._open, self._first_try = True, False
        else:
            self.counters.lost += ahead - 1
            self._begin(counter, CycleKind.NEW)
        return True

    def _goes_back(self, counter: int) -> bool:
        """One sync frame of the past came late; two in a row are a device that restarted."""
        before, self._backward = self._backward, counter
        restarted = before is not None and counter - before in (0, 1)
        if restarted:
            self.counters.restarts += 1
            self._begin(counter, CycleKind.RESTART)
        else:
            self.counters.out_of_order += 1
            # Frames that follow belong to that cycle, not to the present one.
            self._open = False
        return restarted

    def _begin(self, counter: int, kind: CycleKind) -> None:
        self.counters.incomplete += not self._emitted
        self.counter, self._kind = counter, kind
        self._data, self._seen = {}, set()
        self._emitted, self._open, self._first_try = False, True, True
