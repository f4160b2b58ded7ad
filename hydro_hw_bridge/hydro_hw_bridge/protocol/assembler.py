"""Frames to whole cycles: never part of one, never two mixed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from hydro_hw_bridge.protocol.frames import Frame

_WRAP = 1 << 32
#: A counter further ahead than this (37 h at 500 Hz) went back, whenever it will come around.
_FURTHEST = 1 << 26
#: One sync frame further ahead than this (2 s at 500 Hz) may be noise that passes its check.
_SURE = 1 << 10
#: For so many cycles (1 s at 500 Hz) frames of somebody else are looked out for.
WARY_CYCLES = 500
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
    held : int
        Whole cycles that were given out as the next began, as somebody else was heard.
    begun_again : int
        Sync frames that came once more under the present sample counter.
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
    held: int = 0
    begun_again: int = 0


class Assembler:
    """Collects the frames of one cycle after another; the sync frame goes first.

    Noise passes the checks of a frame once in 4096 times. If it is the last of a cycle that was
    missing, the cycle is whole before the device's own frame contradicts it. So once there was a
    frame too many in a cycle, spoilt beside one that is not, whole cycles are held for a while
    until the sync frame behind them: by then whatever contradicts them has come.

    Parameters
    ----------
    frames : sequence of str
        Names of the frames of a cycle, sync first.
    sample_counter : callable
        Takes the sync frame.
    wary : int
        For how many cycles whole ones are held after a frame too many.

    Attributes
    ----------
    counters : CycleCounters
    counter : int or None
        Of the present cycle, complete or not.
    missing : tuple of str
        Frames that the last cycle before it lacked; empty since one was whole.
    """

    def __init__(
        self,
        frames: Sequence[str],
        sample_counter: Callable[[Frame], int],
        wary: int = WARY_CYCLES,
    ) -> None:
        self.counters = CycleCounters()
        self.counter: int | None = None
        self.missing: tuple[str, ...] = ()
        self._names, self._size = tuple(frames), len(frames)
        self._sample_counter = sample_counter
        self._kind = CycleKind.NEW
        self._data: dict[str, bytes] = {}
        self._seen: set[str] = set()
        self._spoilt: set[str] = set()
        self._longest = wary
        self._wary = 0
        self._idle = False
        self._spoilt_sync = False
        # Before the first cycle there is none to be missed.
        self._emitted = True
        self._open = False
        self._first_try = True
        self._leapt: int | None = None

    @property
    def whole(self) -> int:
        """Cycles that were whole so far, those sent again included."""
        return self.counters.complete + self.counters.repeated

    def add(self, frame: Frame) -> Cycle | None:
        """Take one frame of role sync or cycle.

        Parameters
        ----------
        frame : Frame

        Returns
        -------
        Cycle or None
            The cycle that this frame completes, or shows that nothing contradicts.
        """
        if not frame.intact:
            self.counters.corrupt += 1
            self._heard_spoilt(frame)
            return None
        if frame.role == "sync":
            return self._sync(frame)
        if not self._belongs(frame):
            return None
        self._take(frame)
        self._beside_spoilt(frame)
        if not self._emitted and self._wary:
            return None
        return self._emit() if self._is_whole() else None

    def _heard_spoilt(self, frame: Frame) -> None:
        """One beside another that is not spoilt is not the device's; a sync frame counts alone.

        Behind a whole cycle it may be the next one's, whose sync frame was spoilt or lost as well:
        that sync frame tells, by coming.
        """
        if frame.role == "sync":
            self._spoilt_sync = True
        elif self._is_whole():
            self._idle = True
        else:
            self._spoilt.add(frame.name)
            self._beside_spoilt(frame)

    def _beside_spoilt(self, frame: Frame) -> None:
        if frame.name in self._seen and frame.name in self._spoilt:
            self._wary = self._longest

    def _take(self, frame: Frame) -> None:
        self._seen.add(frame.name)
        self._data.setdefault(frame.name, frame.data)

    def _is_whole(self) -> bool:
        return len(self._seen if self._emitted else self._data) == self._size

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
        self._open, self._wary = False, self._longest
        if not self._emitted:
            self._data, self._seen = {}, set()

    def _emit(self) -> Cycle:
        kind = self._kind
        if self._emitted:
            kind = CycleKind.REPEAT
            self.counters.repeated += 1
        else:
            self.counters.complete += 1
        self._emitted, self.missing = True, ()
        # Two tries together may have made it whole: the rest of the second is no repeat.
        self._seen = set(self._data)
        return Cycle(self.counter or 0, kind, self._data)

    def _sync(self, frame: Frame) -> Cycle | None:
        """The cycle that was held until now, or one that has no other frame."""
        counter = self._sample_counter(frame)
        if frame.alive is not None and frame.alive != counter & _ALIVE:
            self.counters.corrupt += 1
            return None
        ahead = 0 if self.counter is None else (counter - self.counter) % _WRAP
        if ahead > _SURE and not self._is_sure(counter):
            return None
        self._leapt = None
        back = ahead > _FURTHEST
        held = None if back else self._held()
        if back:
            self.counters.restarts += 1
            self._begin(counter, CycleKind.RESTART)
        elif ahead or self.counter is None:
            self.counters.lost += max(ahead - 1, 0)
            if ahead > 1:
                self.missing = self._names[:1]
            elif not self._emitted:
                self._lacks()
            if ahead == 1 and self._idle and not self._spoilt_sync:
                self._wary = self._longest
            self._begin(counter, CycleKind.NEW)
        else:
            # Begun, and begun again before it was whole; a sync frame that came twice is no try.
            self.counters.begun_again += 1
            if len(self._seen) > 1 or not self.missing:  # else no try, which says nothing new
                self._lacks()
            self.counters.incomplete += not self._emitted and len(self._seen) > 1
            self._seen, self._spoilt = set(), set()
            self._open, self._first_try = True, False
        self._take(frame)
        return self._emit() if self._is_whole() else held

    def _lacks(self) -> None:
        """What kept the last try from being whole; of a contradicted one nothing is left."""
        there = self._seen if self._emitted else set(self._data)
        if there:
            self.missing = tuple(name for name in self._names if name not in there)

    def _is_sure(self, counter: int) -> bool:
        """One sync frame far from the present came late or is noise; two in a row are not.

        From the past they are a device that restarted.
        """
        before, self._leapt = self._leapt, counter
        sure = before is not None and (counter - before) % _WRAP in (0, 1)
        if not sure:
            self.counters.out_of_order += 1
            # Frames that follow belong to that cycle, not to the present one.
            self._open = False
        return sure

    def _held(self) -> Cycle | None:
        if self._emitted or not self._open or not self._is_whole():
            return None
        self.counters.held += 1
        return self._emit()

    def _begin(self, counter: int, kind: CycleKind) -> None:
        self.counters.incomplete += not self._emitted
        self._wary = max(self._wary - 1, 0)
        self.counter, self._kind = counter, kind
        self._data, self._seen, self._spoilt = {}, set(), set()
        self._idle = self._spoilt_sync = False
        self._emitted, self._open, self._first_try = False, True, True
