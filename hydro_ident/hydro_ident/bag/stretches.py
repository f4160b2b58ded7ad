"""A bag from front to end as stretches that do not overlap, in flat memory.

Every stretch holds the messages up to a stamp behind which nothing older is to come. Where that
does not hold, or a later part of the bag changes what an earlier one meant, the bag is read again
with what was learnt; where stamps do not let it go by stretches at all, as one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from hydro_ident.bag.decoder import Decoder
from hydro_ident.bag.diagnostics import Status
from hydro_ident.bag.intervals import UndecidedError
from hydro_ident.bag.mcap_records import McapFile
from hydro_ident.bag.mcap_types import FileHealth, MessageBlock
from hydro_ident.bag.reader import (
    PROJECT_METADATA,
    TopicInfo,
    count_block,
    files_of,
    malformed_notes,
    no_message,
)
from hydro_ident.bag.recorded_run import Recording
from hydro_ident.bag.stretch_cycles import CycleMaker, Known, LearntError
from hydro_ident.bag.topic_windows import TopicWindows
from hydro_ident.bag.window import Window
from hydro_ident.errors import BagError
from hydro_model.arrays import IntArray
from hydro_model.command_line.terminal import advance
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import CHAMBER_PRESSURES

#: A stretch is made once so many messages have come, or so much memory holds them; and how late
#: one may be behind the newest.
ROWS, _HELD_BYTES, LATE_S = 1 << 15, 1 << 23, 2.0
#: Who looks a bag over reads it twice: rates come first, then what is missing by them.
READINGS = 2


@dataclass(frozen=True, slots=True)
class Stretch:
    """What a stretch of a bag adds.

    Attributes
    ----------
    stamps : mapping of str to (N,) int64 array
        New stamps by topic, increasing.
    cycles : Recording or None
        Its cycles, none of which may be there, without what needs the whole recording (period,
        gaps, losses, dead sensors); None without a robot.
    statuses : list of Status
        What nodes said, in file order.
    """

    stamps: Mapping[str, IntArray]
    cycles: Recording | None
    statuses: list[Status]


@dataclass(slots=True)
class Passage:
    """Reads a bag once.

    Parameters
    ----------
    path : Path
    robot_of : callable
        The robot to read it for, from its metadata.
    known : Known
    rows : int
        As `ROWS`.
    late_s : float
        As `LATE_S`.
    reading : int
        Which of two this is, 1 or 2, for the progress.
    repeated : bool
        It is made once more, with what was learnt.

    Attributes
    ----------
    infos : dict of str to TopicInfo
        Every topic met, by name once all was read.
    decoder : Decoder
    notes : list of str
        What could not be read, in words; complete once all was read.
    healths : list of FileHealth
    metadata : dict of str to str
    maker : CycleMaker or None
        None without a robot.
    """

    path: Path
    robot_of: Callable[[Mapping[str, str]], Robot | None]
    known: Known = field(default_factory=Known)
    rows: int = ROWS
    late_s: float = LATE_S
    reading: int = 1
    repeated: bool = False
    infos: dict[str, TopicInfo] = field(default_factory=dict)
    decoder: Decoder = field(init=False)
    notes: list[str] = field(default_factory=list)
    healths: list[FileHealth] = field(default_factory=list)
    metadata: dict[str, str] = field(default_factory=dict)
    maker: CycleMaker | None = None
    _named: str = ""
    _begun: bool = False
    #: Of the last block, of whichever file: what is enough is asked between files, too.
    _buffer: bytes | None = None
    _topics: TopicWindows = field(init=False)

    def __post_init__(self) -> None:
        self.decoder = Decoder(self.path, self.notes, diagnostics=True)
        self._topics = TopicWindows(self.path, self.notes, self.decoder, self.known, self.late_s)

    @property
    def windows(self) -> dict[str, Window]:
        """Every topic that could be decoded."""
        return self._topics.windows

    def stretches(self) -> Iterator[Stretch]:
        """Read it.

        Yields
        ------
        Stretch

        Raises
        ------
        LearntError
            It has to be read again.
        BagError
            As `read_bag`.
        """
        files, notes, self.metadata = files_of(self.path)
        self.notes += notes
        for number, file in enumerate(files, 1):
            yield from self._blocks(file, number, len(files))
            self.healths.append(file.health)
            self.metadata.update(file.metadata.get(PROJECT_METADATA, {}))
            self.notes += file.health.told
        if not self.infos:
            raise no_message(self.path, self.notes)
        yield self._stretch(self.metadata, last=True)
        self._check_robot()
        self.infos = dict(sorted(self.infos.items()))
        for builder in self.decoder.builders.values():
            builder.check()
        self.notes += malformed_notes({t: b.malformed for t, b in self.decoder.builders.items()})

    def _blocks(self, file: McapFile, number: int, files: int) -> Iterator[Stretch]:
        once_more = " once more" if self.repeated else ""
        what = f"reading {self.reading} of {READINGS}{once_more}: file {number} of {files}"
        before = (self.reading - 1) * files + number - 1
        for block in file.blocks():
            # Blocks of one buffer belong together: their messages lie side by side in the file.
            if block.data is not self._buffer and self._enough():
                so_far = {**self.metadata, **file.metadata.get(PROJECT_METADATA, {})}
                yield self._stretch(so_far, last=False)
            self._buffer = block.data
            size = file.health.size_bytes
            advance(what, before * size + file.health.read_bytes, READINGS * files * size)
            self._take_in(block)

    def _take_in(self, block: MessageBlock) -> None:
        count_block(self.infos, block)
        self.decoder.add(block)

    def _enough(self) -> bool:
        builders = self.decoder.builders.values()
        waiting = sum(builder.waiting for builder in builders) + len(self.decoder.statuses)
        held = sum(builder.held_bytes for builder in builders)
        return not self.known.whole and (waiting >= self.rows or held >= _HELD_BYTES)

    def _check_robot(self) -> None:
        """See that the stretches were made for the robot that the whole bag names."""
        named = self.metadata.get("robot", "")
        if named == self._named:
            return
        robot, used = (
            self.robot_of(self.metadata),
            None if self.maker is None else self.maker.robot,
        )
        if (robot and robot.name) != (used and used.name):
            raise LearntError(replace(self.known, robot=named))

    def _begin(self, metadata: Mapping[str, str]) -> None:
        self._begun = True
        known = self.known.robot
        named = self._named = metadata.get("robot", "") if known is None else known
        robot = self.robot_of({"robot": named} if named else {})
        if robot is not None:
            self.maker = CycleMaker(self.path, robot, self.known)

    def _stretch(self, metadata: Mapping[str, str], *, last: bool) -> Stretch:
        if not self._begun:
            self._begin(metadata)
        maker = self.maker
        robot = None if maker is None else maker.robot
        self._topics.collect(robot, bare=maker is not None and maker.bare)
        given = self._topics.give(last=last)
        stamps = {name: series.stamp_ns for name, series in given.items()}
        cycles = None
        if self.maker is not None:
            pressures = self._topics.joined.get(CHAMBER_PRESSURES)
            there = CHAMBER_PRESSURES in self.known.waits or bool(pressures and pressures.count)
            cycles = self.maker.cycles(given, pressures=there)
        return Stretch(stamps, cycles, self.decoder.take_statuses())


def look_through(
    path: Path,
    robot_of: Callable[[Mapping[str, str]], Robot | None],
    begin: Callable[[Known], Callable[[Stretch], None]],
    known: Known | None = None,
    reading: int = 1,
    rows: int = ROWS,
    late_s: float = LATE_S,
) -> Passage:
    """Read a bag by stretches, as often as it takes.

    Parameters
    ----------
    path : Path
    robot_of : callable
        The robot to read it for, from its metadata.
    begin : callable
        Called with what is known before each reading: what takes its stretches.
    known : Known, optional
        By an earlier passage.
    reading, rows, late_s
        As of `Passage`.

    Returns
    -------
    Passage
        The one that went through.

    Raises
    ------
    BagError
        As `read_bag`.
    """
    known = known or Known()
    tried: set[Known] = set()
    while known not in tried:
        repeated = bool(tried)
        tried.add(known)
        passage = Passage(path, robot_of, known, rows, late_s, reading, repeated)
        take = begin(known)
        try:
            for stretch in passage.stretches():
                take(stretch)
            return passage
        except LearntError as error:
            known = error.known
        except UndecidedError:
            # Of the whole every interval is kept apart.
            known = replace(known, whole=True)
    raise BagError(f"{path}: expected the same in each reading, found that it changes: {known}")
