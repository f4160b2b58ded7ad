"""Cells of text logs as numbers: decimal points or commas, empty cells, dates and times of day."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np

from hydro_ident.bag.cdr import FloatArray
from hydro_ident.bag.log_file import SHOWN
from hydro_ident.errors import BagError

MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
_COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
_CLOCK = re.compile(
    r"(?:(\d{4}-\d\d-\d\d|\d{4}/\d\d/\d\d)[T ])?(\d\d):(\d\d):(\d\d(?:[.,]\d+)?)Z?"
)

#: Line number and cells.
Row = tuple[int, list[str]]


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
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise BagError(f"{path}: column '{twice[0][:SHOWN]}' appears more than once")
    if all(is_number(name, ".") for name in names):
        raise BagError(f"{path}: expected a first line of names, found numbers")


def columns_of(
    path: Path, names: Sequence[str], rows: Sequence[Row], decimal: str
) -> tuple[dict[str, FloatArray], str]:
    """Cells as columns of numbers.

    Parameters
    ----------
    path : Path
        For messages.
    names : sequence of str
    rows : sequence of (int, list of str)
    decimal : str

    Returns
    -------
    dict of str to array, str
        Columns, and the moment at which the first column of dates begins, ISO 8601, else empty.

    Raises
    ------
    BagError
        Lines of different lengths, or a cell that is no number.
    """
    for number, row in rows:
        extra = [cell for cell in row[len(names) :] if cell.strip()]
        if len(row) < len(names) or extra:
            raise BagError(
                f"{path}, line {number}: expected {len(names)} columns, found {len(row)}"
            )
    at = [number for number, _ in rows]
    columns: dict[str, FloatArray] = {}
    start = ""
    for i, name in enumerate(names):
        cells = [row[i] for _, row in rows]
        dated = _seconds(cells)
        if dated is None:
            columns[name] = numbers(cells, at, f"{path}, column '{name[:SHOWN]}'", decimal)
        else:
            columns[name], moment = dated
            start = start or moment
    return columns, start


def is_number(text: str, decimal: str) -> bool:
    """Whether a cell is a number.

    Parameters
    ----------
    text, decimal : str
    """
    if decimal == ",":
        if "." in text:
            return False
        text = text.replace(",", ".", 1)
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def numbers(cells: Sequence[str], lines: Sequence[int], where: str, decimal: str) -> FloatArray:
    """A column of texts as numbers.

    Parameters
    ----------
    cells : sequence of str
    lines : sequence of int
        Line number of each, for messages.
    where : str
        For messages.
    decimal : str

    Returns
    -------
    (N,) array
        NaN where a cell is empty, and everywhere where no cell is a number.

    Raises
    ------
    BagError
        Some cells are numbers and one is something else.
    """
    given = [cell.replace(",", ".", 1) for cell in cells] if decimal == "," else cells
    try:
        return np.array(given, dtype=np.float64)
    except ValueError:
        pass
    result = np.full(len(cells), np.nan)
    if not any(is_number(cell, decimal) for cell in cells):
        return result  # A column of remarks: only an error if the mapping asks for it.
    for k, cell in enumerate(cells):
        if cell.strip().lower() in MISSING:
            continue
        if not is_number(cell, decimal):
            hint = "; is the decimal sign a comma?" if _COMMA_NUMBER.fullmatch(cell) else ""
            raise BagError(
                f"{where}, line {lines[k]}: expected a number,"
                f" found '{cell.strip()[:SHOWN]}'{hint}"
            )
        result[k] = float(given[k])
    return result


def is_moment(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day.

    Parameters
    ----------
    cell : str
    """
    return _moment(cell) is not None


def _moment(cell: str) -> tuple[str, float] | None:
    """Day (or nothing) and seconds of it."""
    match = _CLOCK.fullmatch(cell.strip())
    if match is None:
        return None
    day, hours, minutes, seconds = match.groups()
    of_day = int(hours) * 3600.0 + int(minutes) * 60.0 + float(seconds.replace(",", "."))
    return (day or "").replace("/", "-"), of_day


def _seconds(cells: Sequence[str]) -> tuple[FloatArray, str] | None:
    """Dates and times of day as seconds since the first; None where they are none."""
    if not cells or _moment(cells[0]) is None:
        return None
    moments = [_moment(cell) for cell in cells]
    days: dict[str, float] = {}
    seconds = np.full(len(cells), np.nan)
    for k, moment in enumerate(moments):
        if moment is not None:
            day, of_day = moment
            if day not in days:
                days[day] = 86400.0 * datetime.fromisoformat(day).toordinal() if day else 0.0
            seconds[k] = days[day] - next(iter(days.values())) + of_day
    # Over midnight a time of day without a date begins anew.
    if "" in days:
        seconds += 86400.0 * np.cumsum(np.diff(seconds, prepend=seconds[0]) < -43200.0)
    start = cells[0].strip().replace("/", "-").replace(" ", "T") if next(iter(days)) else ""
    return seconds - seconds[0], start
