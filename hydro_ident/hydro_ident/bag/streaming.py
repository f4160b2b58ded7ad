"""A bag of any length as pieces that overlap, read once from the front in flat memory.

A piece owns the cycles of its core and carries some seconds more on either side, over which
filters settle: what is computed for the core is what the whole bag in memory would give.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.arrivals import LATE_S, Arrivals, arrivals_of, is_joined
from hydro_ident.bag.clock_restarts import continued
from hydro_ident.bag.decoder import Decoder
from hydro_ident.bag.grid import runs
from hydro_ident.bag.mcap_types import FileHealth
from hydro_ident.bag.reader import (
    PROJECT_METADATA,
    Bag,
    TopicInfo,
    count_block,
    files_of,
    malformed_notes,
    no_message,
)
from hydro_ident.bag.recording import RECORDING_TOPICS, Earlier, Recording, recording_of
from hydro_ident.bag.series import Series
from hydro_ident.bag.window import Window, joined
from hydro_ident.errors import NoCyclesError
from hydro_model.arrays import BoolArray, IntArray
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, DIAGNOSTICS, JOINT_STATES

#: Cycles on either side of a core. The slowest filter (10 Hz, fourth order) forgets a sample to
#: 1e-21 within it.
OVERLAP_S = 2.0
PIECE_S = 60.0
_TOPICS = tuple(topic for topic in RECORDING_TOPICS if topic != DIAGNOSTICS)


#: The fields of a recording that have a row per cycle.
COLUMNS = (
    *("stamp_ns", "q", "stroke", "effort", "p_a", "p_b", "supply", "tank", "valve_v"),
    *("command_v", "spool", "latched", "q_ref", "qd_ref", "force_ref", "tip_ref"),
)


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch of a recording.

    Attributes
    ----------
    recording : Recording
        The core with what overlaps.
    core : slice
        The cycles that this piece owns.
    start_ns : int
        First stamp of the whole recording.
    """

    recording: Recording
    core: slice
    start_ns: int

    @staticmethod
    def whole(recording: Recording) -> Piece:
        """A recording in memory as one piece."""
        return Piece(recording, slice(0, len(recording)), int(recording.stamp_ns[0]))


def stream_recordings(
    path: str | Path, robot: Robot, piece_s: float = PIECE_S, overlap_s: float = OVERLAP_S
) -> Iterator[Piece]:
    """Read a bag piece by piece.

    Parameters
    ----------
    path : str or Path
        rosbag2 directory or MCAP file.
    robot : Robot
    piece_s : float
        Length of a core.
    overlap_s : float
        Length of the overlap on either side.

    Yields
    ------
    Piece
        Notes, damage and the project's metadata are those known so far: complete with the last.

    Raises
    ------
    BagError
        As `read_recording`.
    """
    reader = _Reader(Path(path), robot, round(piece_s * 1e9), round(overlap_s * 1e9))
    yield from reader.pieces()


@dataclass(slots=True)
class _Reader:
    """Messages on their way from the file to a piece."""

    path: Path
    robot: Robot
    piece_ns: int
    overlap_ns: int
    infos: dict[str, TopicInfo] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    healths: list[FileHealth] = field(default_factory=list)
    metadata: dict[str, str] = field(default_factory=dict)
    decoder: Decoder = field(init=False)
    windows: dict[str, Window] = field(default_factory=dict)
    #: First stamp of the recording, of the core to come, and of the median period.
    start_ns: int = 0
    core_ns: int = 0
    begun: bool = False  # these are known; a stamp may be negative
    period_s: float = 0.0
    latched: bool = False
    earlier: Earlier = field(default_factory=Earlier)
    #: What is still to come, known from the first possible cut on, and blocks of it so far.
    arrivals: Arrivals | None = None
    joined_blocks: int = 0
    #: Nothing is cut before so many: the messages before had no cycle yet.
    cut_from: int = 0

    def __post_init__(self) -> None:
        self.decoder = Decoder(self.path, self.notes, diagnostics=False)

    def pieces(self) -> Iterator[Piece]:
        files, notes, self.metadata = files_of(self.path)
        self.notes += notes
        for file in files:
            for block in file.blocks():
                count_block(self.infos, block)
                if block.channel.topic in _TOPICS:
                    self.decoder.add(block)
                    self.joined_blocks += is_joined(block)
                    if self._enough():
                        yield from self._cut(last=False)
            self.metadata.update(file.metadata.get(PROJECT_METADATA, {}))
            self.notes += file.health.told
            self.healths.append(file.health)
        if not self.infos:
            raise no_message(self.path, self.notes)
        yield from self._cut(last=True)

    def _enough(self) -> bool:
        """Whether the messages read fill a core and its overlap, to which nothing will come."""
        builder = self.decoder.builders.get(JOINT_STATES)
        first, last = (-1, -1) if builder is None else builder.stamp_span_ns
        if first < 0:
            return False
        begin = self.core_ns if self.begun else first
        least = begin + self.piece_ns + self.overlap_ns
        if last <= least or self.joined_blocks < self.cut_from:
            return False
        if self.arrivals is None:
            # What is shorter than a piece is never looked through.
            self.arrivals = arrivals_of(self.path)
        there = {*self.kept, *self.decoder.builders}
        pressures = CHAMBER_PRESSURES in there or not self.arrivals.pressures
        return pressures and self.arrivals.oldest_ns(self.joined_blocks) > least

    def _cut(self, last: bool) -> Iterator[Piece]:
        """Turn what was read into pieces, keeping what the next one overlaps."""
        self._collect(whole=last and not self.begun)
        bag = self._bag()
        if JOINT_STATES not in self.kept and not last:
            return
        complete_ns = None
        if not last and self.arrivals is not None:
            complete_ns = self.arrivals.oldest_ns(self.joined_blocks) - 1
        try:
            recording = self._recording(bag, complete_ns)
        except NoCyclesError:
            if last:
                raise
            # Pressures may begin later than a piece is long; each look joins all there is.
            self.cut_from = 2 * self.joined_blocks
            return
        while True:
            stamps = recording.stamp_ns
            if not self.begun:
                self.begun = True
                self.start_ns = self.core_ns = int(stamps[0])
            safe_ns = int(stamps[-1])
            if complete_ns is not None:
                safe_ns = min(safe_ns, complete_ns)
            self._pass_over(stamps, safe_ns)
            end_ns = self.core_ns + self.piece_ns
            # What would be left must be longer than the overlap, or the last core takes it.
            final = last and int(stamps[-1]) <= end_ns + self.overlap_ns
            if not final and safe_ns <= end_ns + self.overlap_ns:
                break
            yield self._piece(recording, end_ns if not final else None)
            if final:
                return
            self.core_ns = end_ns
        # The last cycle before the core stays however old it is: a gap has two ends.
        before = int(np.searchsorted(stamps, self.core_ns)) - 1
        kept_ns = self.core_ns - self.overlap_ns - round(LATE_S * 1e9)
        self._forget(min(kept_ns, int(stamps[max(before, 0)])))

    def _pass_over(self, stamp_ns: IntArray, safe_ns: int) -> None:
        """Begin the core behind the whole pieces in which nothing was recorded.

        A pause may be long, and a stamp that changed on the disk lie years ahead.
        """
        following = int(np.searchsorted(stamp_ns, self.core_ns))
        if following < len(stamp_ns):
            empty_ns = min(int(stamp_ns[following]), safe_ns) - self.core_ns
            self.core_ns += max(0, empty_ns) // self.piece_ns * self.piece_ns

    def _piece(self, recording: Recording, end_ns: int | None) -> Piece:
        stamps = recording.stamp_ns
        begin = int(np.searchsorted(stamps, self.core_ns - self.overlap_ns))
        core = int(np.searchsorted(stamps, self.core_ns))
        stop = len(stamps) if end_ns is None else int(np.searchsorted(stamps, end_ns))
        far = np.inf if end_ns is None else end_ns + self.overlap_ns
        end = len(stamps) if end_ns is None else int(np.searchsorted(stamps, far))
        part = cut_recording(recording, slice(begin, end))
        if self.latched and core > begin:
            part = replace(part, latched=_still_latched(part))
        piece = Piece(part, slice(core - begin, stop - begin), self.start_ns)
        # The next piece begins an overlap before this core's end.
        if end_ns is not None:
            edge = int(np.searchsorted(part.stamp_ns, end_ns - self.overlap_ns))
            self.latched = bool(part.latched[min(edge, len(part) - 1)])
        return piece

    def _recording(self, bag: Bag, complete_ns: int | None) -> Recording:
        repeats = {topic: window.repeats for topic, window in self.windows.items()}
        earlier = replace(self.earlier, repeats=repeats, complete_ns=complete_ns)
        recording = recording_of(bag, self.robot, earlier)
        self.earlier = self.earlier.after(recording)
        if self.period_s == 0.0:
            self.period_s = recording.period_s
        return replace(recording, period_s=self.period_s)

    @property
    def kept(self) -> dict[str, Series]:
        """What was read and may be needed yet, by topic."""
        return {topic: w.kept for topic, w in self.windows.items() if w.kept is not None}

    def _collect(self, *, whole: bool) -> None:
        taken = self.decoder.take()
        if whole:  # as a bag is whose clock starts over
            taken, restarts = continued(self.path, taken)
            self.notes += restarts
        for topic, fresh in taken.items():
            window = self.windows.setdefault(topic, Window())
            if len(fresh):
                window.add(fresh)
            else:  # it may tell of messages that could not be decoded
                window.kept = fresh if window.kept is None else joined(window.kept, fresh)

    def _forget(self, before_ns: int) -> None:
        for window in self.windows.values():
            window.forget(before_ns)

    def _bag(self) -> Bag:
        malformed = malformed_notes(
            {s.topic: (s.malformed, s.malformed_why) for s in self.kept.values()}
        )
        notes = tuple(dict.fromkeys([*self.notes, *malformed]))
        infos = dict(sorted(self.infos.items()))
        return Bag(self.path, tuple(self.healths), infos, self.kept, self.metadata, notes)


def cut_recording(recording: Recording, part: slice) -> Recording:
    """Some cycles of a recording.

    Parameters
    ----------
    recording : Recording
    part : slice

    Returns
    -------
    Recording
        Views; losses, gaps and notes stay those of the whole.
    """
    return map_columns(recording, lambda values: values[part])


def map_columns(recording: Recording, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Recording:
    """A recording with every array over its cycles changed alike.

    `change` takes such an array and returns another of as many columns.
    """
    columns: dict[str, Any] = {name: getattr(recording, name) for name in COLUMNS}
    changed: dict[str, Any] = {
        name: None if v is None else change(v) for name, v in columns.items()
    }
    result: Recording = replace(recording, **changed)
    return result


def _still_latched(part: Recording) -> BoolArray:
    """The latch of the piece before holds to the end of its stretch of zeros."""
    latched = part.latched.copy()
    if part.valve_v is not None:
        told = part.valve_v[:, part.told]
        still = (np.nan_to_num(told, nan=1.0) == 0.0).all(axis=1)
        for begin, end in runs(still)[:1]:
            if begin == 0:
                latched[:end] = True
    return latched
