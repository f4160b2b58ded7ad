"""Joining topics by stamp, each stamp once.

A cycle may come in several messages of one stamp, as of drivers that publish joint by joint: their
entries are put together. Of an entry that comes twice the first message's value holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro_ident.bag.series import Series
from hydro_model.arrays import FloatArray, IntArray

#: What is larger is no reading, but what a driver says instead of one (DBL_MAX, FLT_MAX, 1e20): no
#: sum or square of readings survives it. Readings in a unit that is taken for the contract's are
#: smaller, so that what tells wrong units still sees them: positions and points are some metres or
#: turns, which are 1e7 um, urad or counts of an encoder; efforts are pressures, voltages, forces
#: and torques, at most 1e8 Pa or N; temperatures are some hundred degrees, 1e6 thousandths.
_LARGEST = {"position": 1e9, "velocity": 1e9, "effort": 1e10, "point": 1e9, "temperature": 1e6}


@dataclass(frozen=True, slots=True)
class Repeats:
    """Messages of a topic with stamps that had been there before, or out of order.

    Attributes
    ----------
    messages : int
        Of all.
    duplicates : int
        Those whose stamp had been there before and that told nothing more.
    contradicted : int
        Those of another value for an entry that had been told at that stamp.
    disordered : int
        Those with a stamp older than that of a message before.
    """

    messages: int = 0
    duplicates: int = 0
    contradicted: int = 0
    disordered: int = 0

    def __add__(self, more: Repeats) -> Repeats:
        return Repeats(
            self.messages + more.messages,
            self.duplicates + more.duplicates,
            self.contradicted + more.contradicted,
            self.disordered + more.disordered,
        )


@dataclass(frozen=True, slots=True)
class Topic:
    """A series in order of its stamps, each stamp once.

    Attributes
    ----------
    series : Series
    stamp_ns : (U,) int64 array
        Strictly increasing.
    row : (U,) int array
        Row of `series` per stamp: the first message that carried it, with what others of that
        stamp told besides.
    repeats : Repeats
    """

    series: Series
    stamp_ns: IntArray
    row: IntArray
    repeats: Repeats = Repeats()

    @staticmethod
    def of(series: Series) -> Topic:
        """Sort a series and put together what has one stamp."""
        stamp_ns, row, which = np.unique(series.stamp_ns, return_index=True, return_inverse=True)
        first = np.sort(row)
        ordered = series.stamp_ns[first]
        disordered = int(np.sum(ordered < np.maximum.accumulate(ordered)))
        duplicates = contradicted = 0
        if len(row) < len(series):
            series, duplicates, contradicted = _put_together(series, row, which.reshape(-1))
        repeats = Repeats(len(series), duplicates, contradicted, disordered)
        return Topic(series, stamp_ns, row.astype(np.int64), repeats)

    def values(self, field: str) -> FloatArray:
        """A field in order of the stamps, (U, k); NaN where a number is too large or infinite."""
        return readings(self.series.fields[field][self.row], field)


def _put_together(series: Series, row: IntArray, which: IntArray) -> tuple[Series, int, int]:
    """Complete the first messages of stamps by what later ones of the same stamp tell.

    Parameters
    ----------
    series : Series
    row : (U,) int array
        The first message of each stamp.
    which : (N,) int array
        The stamp of each message, by its number.

    Returns
    -------
    series : Series
    duplicates, contradicted : int
        As of `Repeats`.
    """
    several = np.flatnonzero((np.bincount(which) > 1)[which])
    order = several[np.argsort(which[several], kind="stable")]
    adds, contradicts = np.zeros((2, len(order)), dtype=np.bool_)
    fields = {}
    for name, values in series.fields.items():
        fields[name] = values.copy()
        for column in range(values.shape[1]):
            told = np.flatnonzero(np.isfinite(values[order, column]))
            stamp, value = which[order[told]], values[order[told], column]
            first = np.ones(len(told), dtype=np.bool_)
            first[1:] = stamp[1:] != stamp[:-1]
            fields[name][row[stamp[first]], column] = value[first]
            adds[told[first]] = True
            contradicts[told] |= value != value[first][np.cumsum(first) - 1]
    later = order != row[which[order]]
    duplicates, contradicted = int(np.sum(later & ~adds)), int(np.sum(contradicts))
    return replace(series, fields=fields), duplicates, contradicted


def readings(values: FloatArray, field: str) -> FloatArray:
    """What of a field of messages may be readings; NaN elsewhere.

    Parameters
    ----------
    values : array
    field : str
        As in the message: position, velocity, effort, point, temperature.

    Returns
    -------
    array
    """
    return np.where(np.abs(values) > _LARGEST[field], np.nan, values)


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
        NaN where an entry or a stamp is missing, or a number is too large to be a reading; None
        where there is no value at all.
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
    joined[np.ix_(there, wanted)] = readings(values[np.ix_(rows, columns)], field)
    return None if bool(np.isnan(joined).all()) else joined


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of every run of True in a mask."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
