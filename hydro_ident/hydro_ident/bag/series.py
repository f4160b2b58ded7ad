"""One topic of a bag as columns, built up block by block."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from hydro_ident.bag.entries import Entries, EntryMaker, repeated
from hydro_ident.bag.mcap_gather import rows_at
from hydro_ident.bag.mcap_types import MessageBlock
from hydro_ident.errors import BagError
from hydro_model.arrays import BoolArray, FloatArray, IntArray
from hydro_msgs_docs.cdr import FIELDS, JOINT_STATE, CdrError, Layout, layout_of

#: Layouts kept per topic; a topic with more is decoded all the same, only slower.
_KEPT_LAYOUTS = 16
#: Beyond these no machine's topic goes.
_MOST_NAMES = 1024
#: Every name has a column: so many numbers in all, and so many times those that are there.
_FREE_CELLS, _MOST_EMPTY = 1 << 22, 16


@dataclass(frozen=True, slots=True)
class Series:
    """The messages of one topic as columns, in file order.

    Attributes
    ----------
    topic, message_type : str
    stamp_ns, log_ns : (N,) int64 arrays
        Header stamp, and when the recorder received the message.
    names : tuple of str
        Column names of JointState topics: every name met, in order of appearance.
    fields : mapping of str to (N, k) array
        JointState: k = len(names), NaN where a message does not carry an entry, and only
        fields that some message filled. PointStamped: `point`, k = 3. Others k = 1.
    malformed : int
        Messages that could not be decoded.
    malformed_why : str
        What was wrong with the first of them.
    """

    topic: str
    message_type: str
    stamp_ns: IntArray
    log_ns: IntArray
    names: tuple[str, ...]
    fields: Mapping[str, FloatArray]
    malformed: int = 0
    malformed_why: str = ""

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def column(self, name: str, field_name: str) -> FloatArray | None:
        """Values of one entry, (N,), or None where no message carries it.

        `field_name` as in the message: position, effort.
        """
        if name not in self.names or field_name not in self.fields:
            return None
        values: FloatArray = self.fields[field_name][:, self.names.index(name)]
        return None if bool(np.isnan(values).all()) else values

    def tells_of(self, names: Collection[str]) -> BoolArray:
        """Messages that carry a number for one of some names, (N,)."""
        at = [i for i, name in enumerate(self.names) if name in names]
        told = np.zeros(len(self), dtype=np.bool_)
        for values in self.fields.values():
            told |= np.isfinite(values[:, at]).any(axis=1)
        return told


def too_empty(cells: int, filled: int) -> bool:
    """Whether a table of so many `cells` holds too few numbers (`filled`) to be made."""
    return cells > max(_FREE_CELLS, _MOST_EMPTY * filled)


@dataclass(slots=True)
class _Piece:
    row: IntArray
    stamp_ns: IntArray
    names: tuple[str, ...]
    fields: dict[str, FloatArray]


@dataclass(slots=True)
class SeriesBuilder:
    """Collects the messages of one topic into a `Series`.

    Parameters
    ----------
    topic, message_type : str
        The type is one of `hydro_msgs_docs.cdr.FIELDS`.
    """

    topic: str
    message_type: str
    _layouts: list[Layout] = field(default_factory=list)
    _pieces: list[_Piece] = field(default_factory=list)
    #: Messages of layouts beyond those that are kept.
    _entries: list[Entries] = field(default_factory=list)
    _log_ns: list[IntArray] = field(default_factory=list)
    _count: int = 0
    _malformed: int = 0
    _why: str = ""
    _names: frozenset[str] = frozenset()
    #: Names that stand several times in one message.
    twice: tuple[str, ...] = ()
    #: What was taken already: messages, numbers in them, and in order every name and field.
    _taken: int = 0
    _filled: int = 0
    _met: dict[str, None] = field(default_factory=dict)
    _fields: dict[str, None] = field(default_factory=dict)
    #: Oldest and newest stamp so far, ns; -1 before the first message.
    stamp_span_ns: tuple[int, int] = (-1, -1)
    #: Memory of what was added, bytes.
    held_bytes: int = 0

    @property
    def table_bytes(self) -> int:
        """Memory that `finish` takes besides."""
        # A number in every cell, stamps and what was read; twice where rows have to be left out.
        table = self._count * (8 * self._cells_per_row + 17)
        return 2 * table if self._malformed else table

    @property
    def _cells_per_row(self) -> int:
        return sum(self._widths(len(self._names_here())).values())

    @property
    def _parts(self) -> list[_Piece | Entries]:
        return [*self._pieces, *self._entries]

    def _names_here(self) -> tuple[str, ...]:
        """Names in what was added, those of kept layouts first, in order of appearance."""
        return tuple(dict.fromkeys(name for part in self._parts for name in part.names))

    def _widths(self, names: int) -> dict[str, int]:
        """Columns of each field that has some."""
        widths = {name: kind for name, kind in FIELDS[self.message_type] if kind != "names"}
        if self.message_type != JOINT_STATE:
            return {name: int(kind) for name, kind in widths.items()}
        filled = {name for part in self._parts for name in part.fields}
        return {name: names for name in widths if name in filled}

    def add(self, block: MessageBlock) -> None:
        """Decode a block of messages."""
        left = np.arange(len(block.offset))
        others = EntryMaker()
        for layout in self._layouts:
            left = self._take(layout, block, left)
        while len(left):
            first = int(left[0])
            begin = int(block.offset[first])
            message = block.data[begin : begin + int(block.length[first])]
            try:
                layout = self._new_layout(message)
            except CdrError as error:
                self._malformed += 1
                self._why = self._why or str(error)
                left = left[1:]
                continue
            if len(self._layouts) < _KEPT_LAYOUTS:
                self._layouts.append(layout)
                left = self._take(layout, block, left)
            else:
                others.add(first + self._count, message, layout)
                left = left[1:]
        if len(others):
            self._keep(others.entries())
        self._log_ns.append(block.log_ns)
        self.held_bytes += block.log_ns.nbytes
        self._count += len(block.offset)

    def _new_layout(self, message: bytes) -> Layout:
        layout = layout_of(message, self.message_type)
        names = self._names.union(layout.names)
        if len(names) > _MOST_NAMES:
            raise CdrError(f"expected at most {_MOST_NAMES} names on a topic")
        self._names = names
        self.twice = tuple(dict.fromkeys((*self.twice, *repeated(layout.names))))
        return layout

    def _take(self, layout: Layout, block: MessageBlock, left: IntArray) -> IntArray:
        """Decode those of the messages `left` that have this layout; returns the others."""
        here = block.length[left] >= layout.size
        if not here.any():
            return left
        taken = left if here.all() else left[here]
        pieces = rows_at(block.data, block.offset[taken], layout.size)
        rows = pieces.view(np.uint8).reshape(-1, layout.size)
        matches = layout.matches(rows)
        if not matches.all():
            rows, taken = rows[matches], taken[matches]
            here[here] = matches
        if len(taken):
            fields = {
                name: layout.field(rows, name) for name, at in layout.values.items() if at[1]
            }
            if self.twice and (doubled := repeated(layout.names)):
                # Which of the values is meant nobody knows.
                once = np.array([name not in doubled for name in layout.names])
                fields = {name: np.where(once, values, np.nan) for name, values in fields.items()}
            stamps = layout.stamp_ns(rows)
            piece = _Piece(taken + self._count, stamps, layout.names, fields)
            self._pieces.append(piece)
            self.held_bytes += sum(v.nbytes for v in (*fields.values(), stamps, piece.row))
            self._span(stamps)
        return left[:0] if len(taken) == len(left) else left[~here]

    def _keep(self, entries: Entries) -> None:
        self._entries.append(entries)
        self.held_bytes += entries.nbytes
        self._span(entries.stamp_ns)

    def _span(self, stamp_ns: IntArray) -> None:
        """Widen the span of the stamps so far."""
        first, last = self.stamp_span_ns
        oldest, newest = int(stamp_ns.min()), int(stamp_ns.max())
        first = oldest if first < 0 else min(first, oldest)
        self.stamp_span_ns = (first, max(last, newest))

    def take(self) -> Series:
        """The columns of what was added since the last time, of the names that are in it.

        Layouts and the limits on them go on, and what is malformed stays with the builder.

        Raises
        ------
        BagError
            As `check`, of these messages alone.
        """
        series = self.finish()
        self._taken += self._count
        self._filled += self._numbers
        self._met |= dict.fromkeys(series.names)
        self._fields |= dict.fromkeys(series.fields)
        self._pieces, self._entries, self._log_ns = [], [], []
        self._count, self.held_bytes = 0, 0
        return replace(series, malformed=0, malformed_why="")

    def check(self) -> None:
        """See that what was taken has room for its names in one table.

        Raises
        ------
        BagError
            Too few numbers for so many names.
        """
        width = len(self._met) * len(self._fields) if self._met else 0
        self._check_cells(self._taken * width, self._taken, self._filled)

    @property
    def waiting(self) -> int:
        """Messages added since the last time that some were taken."""
        return self._count

    @property
    def names(self) -> tuple[str, ...]:
        """Every name of what was taken, in order of appearance."""
        return tuple(self._met)

    @property
    def malformed(self) -> tuple[int, str]:
        """Messages that could not be decoded, and what was wrong with the first of them."""
        return self._malformed, self._why

    @property
    def _numbers(self) -> int:
        pieces = sum(v.size for piece in self._pieces for v in piece.fields.values())
        return pieces + sum(entries.numbers for entries in self._entries)

    def _check_cells(self, cells: int, count: int, filled: int) -> None:
        if too_empty(cells, filled):
            raise BagError(
                f"{self.topic}: expected messages of the same names, found {len(self._names)}"
                f" names in {count} messages that carry {filled} numbers"
            )

    def finish(self) -> Series:
        """The columns of everything added."""
        names = self._names_here()
        at = {name: column for column, name in enumerate(names)}
        widths = self._widths(len(names))
        self._check_cells(self._count * sum(widths.values()), self._count, self._numbers)
        stamp_ns = np.zeros(self._count, dtype=np.int64)
        read = np.zeros(self._count, dtype=np.bool_)
        fields = {n: np.full((self._count, k), np.nan) for n, k in widths.items()}
        for piece in self._pieces:
            row = _in_a_row(piece.row)
            stamp_ns[row] = piece.stamp_ns
            read[row] = True
            named = np.array([at[n] for n in piece.names], dtype=np.int64)
            for name, values in piece.fields.items():
                columns = _in_a_row(named if len(names) else np.arange(values.shape[1]))
                if isinstance(row, slice) or isinstance(columns, slice):
                    fields[name][row, columns] = values
                else:
                    fields[name][row[:, None], columns] = values
        for entries in self._entries:
            stamp_ns[entries.row] = entries.stamp_ns
            read[entries.row] = True
            entries.put(fields, at)
        log_ns = np.concatenate(self._log_ns) if self._log_ns else np.zeros(0, dtype=np.int64)
        if not read.all():
            stamp_ns, log_ns = stamp_ns[read], log_ns[read]
            fields = {name: values[read] for name, values in fields.items()}
        return Series(
            self.topic,
            self.message_type,
            stamp_ns,
            log_ns,
            names,
            fields,
            self._malformed,
            self._why,
        )


def _in_a_row(at: IntArray) -> IntArray | slice:
    """Places as a slice where they follow one another: numpy gets there several times as fast."""
    if len(at) and bool((np.diff(at) == 1).all()):
        return slice(int(at[0]), int(at[-1]) + 1)
    return at
