"""Where recordings come from, piece by piece: memory, or bags of any length on disk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from hydro_ident.bag.own_rate import at_own_rate
from hydro_ident.bag.reader import files_of
from hydro_ident.bag.recording import Recording
from hydro_ident.bag.streaming import COLUMNS, OVERLAP_S, PIECE_S, Piece, stream_recordings
from hydro_ident.errors import IdentError
from hydro_ident.estimate.signals.traces import Trace, traces_of_piece
from hydro_ident.recordings.cleaning import Cleaner
from hydro_ident.recordings.even_grid import on_even_grid
from hydro_model.robot import Robot

#: Longer than any recording: a piece is the whole.
WHOLE_S = 1.0e6
#: What short recordings may take that are kept between passes: half a dozen of a minute at 500 Hz.
KEPT_BYTES = 1 << 26


class Source(Protocol):
    """A recording that can be read again and again."""

    @property
    def name(self) -> str:
        """Of the bag."""
        ...

    def pieces(self, piece_s: float = PIECE_S, overlap_s: float = OVERLAP_S) -> Iterator[Piece]:
        """The recording from its start, in pieces that overlap."""
        ...


@dataclass(frozen=True, slots=True)
class BagSource:
    """A bag on disk; only a piece of it is in memory at a time.

    Attributes
    ----------
    path : Path
    robot : Robot
    called : str
        Name of its recordings, where another bag has the path's.
    """

    path: Path
    robot: Robot
    called: str = ""

    @property
    def name(self) -> str:
        """Of the bag."""
        return self.called or self.path.name

    def pieces(self, piece_s: float = PIECE_S, overlap_s: float = OVERLAP_S) -> Iterator[Piece]:
        """The bag from its start, in pieces that overlap."""
        read = stream_recordings(self.path, self.robot, piece_s, overlap_s)
        pieces = on_even_grid(at_own_rate(read))
        return (_called(piece, self.called) for piece in pieces) if self.called else pieces


@dataclass(frozen=True, slots=True)
class MemorySource:
    """A recording in memory, as one piece.

    Attributes
    ----------
    recording : Recording
    """

    recording: Recording

    @property
    def name(self) -> str:
        """Of the bag."""
        return self.recording.path.name

    def pieces(self, piece_s: float = PIECE_S, overlap_s: float = OVERLAP_S) -> Iterator[Piece]:
        """The recording as one piece.

        As one piece there is no overlap: `overlap_s` is not used.
        """
        yield from on_even_grid(at_own_rate([Piece.whole(self.recording)]))


@dataclass(slots=True)
class KeptSource:
    """A recording that is read once, for what needs the whole of it in memory anyway.

    Attributes
    ----------
    source : Source
    """

    source: Source
    _pieces: tuple[Piece, ...] | None = None

    @property
    def name(self) -> str:
        """Of the bag."""
        return self.source.name

    def pieces(self, piece_s: float = PIECE_S, overlap_s: float = OVERLAP_S) -> Iterator[Piece]:
        """The recording in as few pieces as it has clocks.

        `overlap_s` is how much neighbouring pieces share.
        """
        if self._pieces is None:
            self._pieces = tuple(self.source.pieces(WHOLE_S, overlap_s))
        yield from self._pieces


@dataclass(slots=True)
class Budget:
    """Memory that several sources share for what they keep.

    Attributes
    ----------
    left_bytes : int
    """

    left_bytes: int

    def spend(self, size: int) -> bool:
        """Take so many bytes, where they are left.

        `size` is their number.
        """
        if size > self.left_bytes:
            return False
        self.left_bytes -= size
        return True


@dataclass(slots=True)
class ShortSource:
    """A recording for many passes: where it comes as a single piece, it is read once.

    Longer ones are streamed in every pass, so that memory stays flat over their length.

    Attributes
    ----------
    source : Source
    budget : Budget
        Shared with other recordings.
    """

    source: Source
    budget: Budget
    _kept: Piece | None = None
    _kept_s: float = 0.0

    @property
    def name(self) -> str:
        """Of the bag."""
        return self.source.name

    def pieces(self, piece_s: float = PIECE_S, overlap_s: float = OVERLAP_S) -> Iterator[Piece]:
        """The recording from its start, in pieces that overlap.

        Parameters
        ----------
        piece_s, overlap_s : float
            As of `BagSource`.
        """
        if self._kept is not None and piece_s >= self._kept_s:
            yield self._kept
            return
        only: Piece | None = None
        for number, piece in enumerate(self.source.pieces(piece_s, overlap_s)):
            only = None if number else piece
            yield piece
        if only is not None and self._kept is None and self.budget.spend(_bytes_of(only)):
            self._kept, self._kept_s = only, piece_s


def short_kept(sources: Sequence[Source], most_bytes: int = KEPT_BYTES) -> tuple[Source, ...]:
    """Recordings that are read once each, as long as they are short and memory is given.

    Parameters
    ----------
    sources : sequence of Source
    most_bytes : int
        For all of them together.
    """
    budget = Budget(most_bytes)
    return tuple(ShortSource(source, budget) for source in sources)


def _bytes_of(piece: Piece) -> int:
    columns = (getattr(piece.recording, name) for name in COLUMNS)
    return sum(values.nbytes for values in columns if values is not None)


def bag_source(path: str | Path, robot: Robot) -> BagSource:
    """A bag on disk; raises BagError where there is none."""
    files_of(Path(path))
    return BagSource(Path(path), robot)


def bag_sources(
    bags: Sequence[str | Path], others: Sequence[str | Path], robot: Robot
) -> tuple[list[BagSource], list[BagSource]]:
    """Bags on disk, to learn from and to verify on, under names of their own.

    Runs of one name in folders of their own are usual: theirs is put before it.

    Parameters
    ----------
    bags, others : sequence of str or Path
    robot : Robot

    Returns
    -------
    sources, others : list of BagSource

    Raises
    ------
    BagError
        There is no bag.
    IdentError
        A bag is given twice.
    """
    sources = [bag_source(bag, robot) for bag in (*bags, *others)]
    paths = [source.path.resolve() for source in sources]
    for k, path in enumerate(paths):
        if path in paths[:k]:
            raise IdentError(f"expected each bag once, found '{sources[k].path}' twice")
    for depth in range(2, max((len(path.parts) for path in paths), default=0)):
        names = [source.name for source in sources]
        twice = [names.count(name) > 1 for name in names]
        if not any(twice):
            break
        longer = ["_".join(path.parts[-depth:]) for path in paths]
        sources = [
            replace(s, called=long) if again else s
            for s, long, again in zip(sources, longer, twice, strict=True)
        ]
    return sources[: len(bags)], sources[len(bags) :]


def _called(piece: Piece, name: str) -> Piece:
    recording = piece.recording
    return replace(piece, recording=replace(recording, path=recording.path.with_name(name)))


def sources_of(recordings: Sequence[Recording | Source]) -> tuple[Source, ...]:
    """Recordings in memory as sources; sources stay as they are."""
    return tuple(MemorySource(r) if isinstance(r, Recording) else r for r in recordings)


def check_names(sources: Sequence[Source]) -> None:
    """Hold-out blocks, labels and hashes go by a bag's name.

    Raises
    ------
    IdentError
        Two are of one name.
    """
    names = [source.name for source in sources]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise IdentError(f"expected bags of different names, found '{twice[0]}' more than once")


def first_traces(
    sources: Sequence[Source], longest_s: float, cleaner: Cleaner | None = None
) -> tuple[Trace, ...]:
    """The traces at the start of recordings, `longest_s` in total: what must be in memory whole.

    Parameters
    ----------
    sources : sequence of Source
    longest_s : float
    cleaner : Cleaner, optional
        What takes outliers out first.

    Returns
    -------
    tuple of Trace
        Nothing of the recordings behind that.
    """
    traces: list[Trace] = []
    left = longest_s
    for source in sources:
        if left <= 0.0:
            break
        piece = next(source.pieces(left))
        for trace in traces_of_piece(piece if cleaner is None else cleaner.cleaned(piece, {})):
            traces.append(trace)
            left -= (trace.owned.stop - trace.owned.start) * trace.step_s
    return tuple(traces)
