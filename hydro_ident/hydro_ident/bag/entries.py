"""Messages of layouts that come and go, entry by entry: slower than a block, as small as they."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from hydro_model.arrays import FloatArray, IntArray
from hydro_msgs_docs.cdr import Layout


def repeated(names: Collection[str]) -> list[str]:
    """Names that stand several times among some."""
    return [name for name, count in Counter(names).items() if count > 1]


@dataclass(frozen=True, slots=True)
class Entries:
    """Some messages of a topic, as the numbers in them.

    Whatever layouts they have, that takes no more memory than their numbers do.

    Attributes
    ----------
    row, stamp_ns : (N,) int64 arrays
        Of each message: its place among those of the topic, and its stamp.
    names : tuple of str
        Every name in them, in order of appearance; none of a type without names.
    fields : mapping of str to (row, column, value)
        (K,) arrays of a field's numbers; `column` is the place in `names`, of a type without
        names that in the field.
    """

    row: IntArray
    stamp_ns: IntArray
    names: tuple[str, ...]
    fields: Mapping[str, tuple[IntArray, IntArray, FloatArray]]

    @property
    def numbers(self) -> int:
        """How many numbers are in them."""
        return sum(len(value) for _, _, value in self.fields.values())

    @property
    def nbytes(self) -> int:
        """Memory of the arrays."""
        columns = [array for three in self.fields.values() for array in three]
        return sum(array.nbytes for array in (self.row, self.stamp_ns, *columns))

    def put(self, fields: Mapping[str, FloatArray], at: Mapping[str, int]) -> None:
        """Put the numbers into the tables of the topic.

        Parameters
        ----------
        fields : mapping of str to (M, k) array
            They change.
        at : mapping of str to int
            Column of each name.
        """
        placed = np.array([at[name] for name in self.names], dtype=np.int64)
        for name, (row, column, value) in self.fields.items():
            fields[name][row, placed[column] if len(placed) else column] = value


@dataclass(slots=True)
class EntryMaker:
    """Collects messages one by one."""

    _row: list[int] = field(default_factory=list)
    _stamp_ns: list[int] = field(default_factory=list)
    _at: dict[str, int] = field(default_factory=dict)
    _fields: dict[str, tuple[list[int], list[int], list[float]]] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self._row)

    def add(self, row: int, message: bytes, layout: Layout) -> None:
        """Take a message in.

        Parameters
        ----------
        row : int
            Its place among those of the topic.
        message : bytes
        layout : Layout
            Of this message.
        """
        sec, nanosec = struct.unpack_from(f"{layout.order}iI", message, 4)
        self._row.append(row)
        self._stamp_ns.append(sec * 1_000_000_000 + nanosec)
        columns = [self._at.setdefault(name, len(self._at)) for name in layout.names]
        # Which of the values is meant nobody knows.
        twice = set(repeated(layout.names))
        for name, (offset, count) in layout.values.items():
            if not count:
                continue
            values = struct.unpack_from(f"{layout.order}{count}d", message, offset)
            if twice:
                named = zip(layout.names, values, strict=True)
                values = tuple(float("nan") if n in twice else value for n, value in named)
            rows, places, numbers = self._fields.setdefault(name, ([], [], []))
            rows += [row] * count
            places += columns or range(count)
            numbers += values

    def entries(self) -> Entries:
        """What was taken in."""
        fields = {
            name: (np.array(r, np.int64), np.array(c, np.int64), np.array(v, np.float64))
            for name, (r, c, v) in self._fields.items()
        }
        row, stamp_ns = (np.array(v, np.int64) for v in (self._row, self._stamp_ns))
        return Entries(row, stamp_ns, tuple(self._at), fields)
