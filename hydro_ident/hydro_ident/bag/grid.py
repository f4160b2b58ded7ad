"""Joining topics by stamp, each stamp once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.series import Series
from hydro_msgs_docs.cdr import FloatArray, IntArray

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Topic:
    """A series in order of its stamps, each stamp once.

    Attributes
    ----------
    series : Series
    stamp_ns : (U,) int64 array
        Strictly increasing.
    row : (U,) int array
        Row of `series` per stamp: the first message that carried it.
    duplicates : int
        Messages whose stamp had been there before.
    disordered : int
        Messages with a stamp older than that of a message before.
    """

    series: Series
    stamp_ns: IntArray
    row: IntArray
    duplicates: int
    disordered: int

    @staticmethod
    def of(series: Series) -> Topic:
        """Sort and thin out a series."""
        stamp_ns, row = np.unique(series.stamp_ns, return_index=True)
        first = np.sort(row)
        ordered = series.stamp_ns[first]
        disordered = int(np.sum(ordered < np.maximum.accumulate(ordered)))
        duplicates = len(series) - len(stamp_ns)
        return Topic(series, stamp_ns, row.astype(np.int64), duplicates, disordered)

    def values(self, field: str) -> FloatArray:
        """A field in order of the stamps, (U, k)."""
        return self.series.fields[field][self.row]


def join(
    grid: IntArray, topic: Topic | None, names: Sequence[str] | None, field: str
) -> FloatArray | None:
    """One field of a topic on the grid.

    Parameters
    ----------
    grid : (N,) int64 array
    topic : Topic or None
    names : sequence of str, or None
        Entries wanted, in order; None for types without names: every column.
    field : str

    Returns
    -------
    (N, k) array or None
        NaN where an entry or a stamp is missing; None where there is no value at all.
    """
    if topic is None or field not in topic.series.fields:
        return None
    values = topic.series.fields[field]
    at = np.minimum(np.searchsorted(topic.stamp_ns, grid), len(topic.stamp_ns) - 1)
    there = topic.stamp_ns[at] == grid
    rows = topic.row[at[there]]
    if names is None:
        columns, wanted = list(range(values.shape[1])), list(range(values.shape[1]))
    else:
        known = topic.series.names
        wanted = [i for i, name in enumerate(names) if name in known]
        columns = [known.index(names[i]) for i in wanted]
    joined = np.full((len(grid), len(names) if names is not None else len(columns)), np.nan)
    joined[np.ix_(there, wanted)] = values[np.ix_(rows, columns)]
    return None if bool(np.isnan(joined).all()) else joined


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of every run of True in a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
