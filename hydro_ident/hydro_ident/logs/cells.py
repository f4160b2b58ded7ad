"""Cells of text logs as columns: names that repeat, lines that were cut, dates, numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hydro_ident.errors import BagError
from hydro_ident.logs.dates import Dated, dated, together, why_unread
from hydro_ident.logs.dates_apart import dates_apart
from hydro_ident.logs.file import SHOWN, Exact
from hydro_ident.logs.numbers import exact_of, is_number, numbers, why_no_numbers
from hydro_model.arrays import FloatArray, IntArray

NO_NAMES = (
    "expected a first line of names, found numbers: write one above them in a copy of the file, a"
    " name for each column"
)

#: Beside numbers from here on a double has no place for the ninth digit behind the point.
_FAR = 1e6
#: Line number and cells.
Row = tuple[int, list[str]]


@dataclass(frozen=True, slots=True)
class Cells:
    """Cells of a table as columns.

    Attributes
    ----------
    columns : mapping of str to (N,) array
    lines : (N,) int array
        Line of the file that each sample stands in.
    start : str
        Moment at which the first column of dates begins, ISO 8601, else empty.
    notes : tuple of str
        What was assumed and what was left out.
    unread : mapping of str to str
        Why a column holds no number, where that can be told.
    units : mapping of str to str
        `s` of columns of dates and times of day.
    dated : frozenset of str
        These: seconds since the first moment of the first of them.
    exact : mapping of str to Exact
        Numbers of times that a double does not hold.
    """

    columns: Mapping[str, FloatArray]
    lines: IntArray
    start: str = ""
    notes: tuple[str, ...] = ()
    unread: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    dated: frozenset[str] = frozenset()
    exact: Mapping[str, Exact] = field(default_factory=dict)


def check_once(names: Sequence[str], path: Path) -> None:
    """No name may stand for two columns: one would be lost.

    Parameters
    ----------
    names : sequence of str
    path : Path
        For the message.

    Raises
    ------
    BagError
        One appears more than once.
    """
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise BagError(
            f"{path}: column '{twice[0][:SHOWN]}' appears more than once: give each a name of its"
            " own in a copy of the file"
        )


def check_names(names: Sequence[str], path: Path) -> None:
    """Names have to be names and each only once.

    Parameters
    ----------
    names : sequence of str
    path : Path
        For the message.

    Raises
    ------
    BagError
        They are numbers, or one appears more than once.
    """
    check_once(names, path)
    if all(is_number(name, ".") for name in names):
        raise BagError(f"{path}: {NO_NAMES}")


def columns_of(
    path: Path, names: Sequence[str], rows: Sequence[Row], decimal: str, *, at_end: bool = True
) -> Cells:
    """Cells as columns of numbers.

    Parameters
    ----------
    path : Path
        For messages.
    names : sequence of str
    rows : sequence of (int, list of str)
    decimal : str
    at_end : bool
        The last row is the file's: where it is too short, whoever wrote it was stopped in it, and
        it is left out.

    Returns
    -------
    Cells

    Raises
    ------
    BagError
        Lines of different lengths, or a cell that is no number.
    """
    rows, notes = _whole(path, names, rows, decimal, at_end=at_end)
    at = [number for number, _ in rows]
    columns: dict[str, FloatArray] = {}
    unread: dict[str, str] = {}
    moments: dict[str, Dated] = {}
    for i, name in enumerate(names):
        cells = [row[i] for _, row in rows]
        if (dates := dated(cells)) is not None:
            moments[name], columns[name] = dates, dates.seconds  # put on one line of time below
            continue
        columns[name] = numbers(cells, at, f"{path}, column '{name[:SHOWN]}'", decimal)
        if why := why_unread(cells) or why_no_numbers(columns[name], cells, decimal):
            unread[name] = why
    apart = dates_apart(names, rows, [n for n, m in moments.items() if not m.start])
    if apart is not None:
        unread[apart.date] = apart.why
        notes.append(apart.note)
        if apart.both is not None:
            moments[apart.time] = apart.both
    notes += [f"column '{name[:SHOWN]}': {m.note}" for name, m in moments.items() if m.note]
    lines, units = np.array(at, dtype=np.int64), dict.fromkeys(moments, "s")
    columns, start = together(columns, moments)
    exact = _exact(names, rows, columns, decimal)
    return Cells(columns, lines, start, tuple(notes), unread, units, frozenset(moments), exact)


def _exact(
    names: Sequence[str], rows: Sequence[Row], columns: Mapping[str, FloatArray], decimal: str
) -> dict[str, Exact]:
    """Of columns that only increase and are far from zero, as stamps: what their texts say."""
    found = {}
    for i, name in enumerate(names):
        known = columns[name][np.isfinite(columns[name])]
        if len(known) > 1 and known[0] >= _FAR and bool((np.diff(known) >= 0.0).all()):
            exact = exact_of([row[i] for _, row in rows], decimal)
            if exact is not None:
                found[name] = exact
    return found


def _whole(
    path: Path, names: Sequence[str], rows: Sequence[Row], decimal: str, *, at_end: bool
) -> tuple[Sequence[Row], list[str]]:
    """Rows that have a cell for every name, and what was left out."""
    for k, (number, row) in enumerate(rows):
        extra = [cell for cell in row[len(names) :] if cell.strip()]
        if len(row) >= len(names) and not extra:
            continue
        found = f"expected {len(names)} columns, found {len(row)}"
        if at_end and not extra and 0 < k == len(rows) - 1:
            return rows[:-1], [f"line {number}, the last one, is cut and left out: {found}"]
        raise BagError(f"{path}, line {number}: {found}; {_to_try(row, decimal, bool(extra))}")
    return rows, []


def _to_try(row: Sequence[str], decimal: str, more: bool) -> str:
    """What may help with a line of another length than the table's."""
    if not any(is_number(cell, decimal) for cell in row):
        return (
            "leave a remark among the numbers out of a copy of the file, or say in the mapping"
            " what such lines begin with: csv: {comment: }"
        )
    if more:
        return "text that holds the delimiter has to stand in quotes"
    return "leave a line that was cut out of a copy of the file"
