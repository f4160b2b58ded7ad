"""Cells of text logs as numbers: decimal points or commas, thousands, empty cells, cut lines."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hydro_ident.errors import BagError
from hydro_ident.logs.dates import Dated, dated, together, why_unread
from hydro_ident.logs.dates_apart import dates_apart
from hydro_ident.logs.file import EXACT, SHOWN
from hydro_msgs_docs.cdr import FloatArray, IntArray

MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
_COMMA_NUMBER = re.compile(r"\s*[+-]?\d*,\d+(?:[eE][+-]?\d+)?\s*")
#: A number with a decimal point or comma, or one with thousands.
_POINTS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:\.\d{3})+\s*")
_COMMAS = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:,\d{3})+\s*")
#: What a line that was cut leaves of a number with thousands.
_CUT = re.compile(r"\s*[+-]?[1-9]\d{0,2}(?:\.\d{3})*\.\d{0,2}\s*")
#: By decimal sign: numbers whose thousands are parted by the other sign, beyond doubt.
_GROUPED = {
    ".": re.compile(r"\s*[+-]?\d{1,3}(?:,\d{3})+\.\d*\s*"),
    ",": re.compile(r"\s*[+-]?\d{1,3}(?:\.\d{3})+,\d*\s*"),
}

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
    exact : mapping of str to (N,) int64 array
        Whole numbers that a double does not hold.
    """

    columns: Mapping[str, FloatArray]
    lines: IntArray
    start: str = ""
    notes: tuple[str, ...] = ()
    unread: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    dated: frozenset[str] = frozenset()
    exact: Mapping[str, IntArray] = field(default_factory=dict)


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
        raise BagError(f"{path}: column '{twice[0][:SHOWN]}' appears more than once")


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
        raise BagError(f"{path}: expected a first line of names, found numbers")


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
    rows, notes = _whole(path, names, rows, at_end=at_end)
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
        if why := why_unread(cells) or _why_no_numbers(columns[name], cells, decimal):
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
    exact = _exact(names, rows, columns)
    return Cells(columns, lines, start, tuple(notes), unread, units, frozenset(moments), exact)


def _exact(
    names: Sequence[str], rows: Sequence[Row], columns: Mapping[str, FloatArray]
) -> dict[str, IntArray]:
    """Whole numbers that doubles do not hold; 0 where a cell is empty."""
    found = {}
    for i, name in enumerate(names):
        if (np.abs(columns[name]) > EXACT).any():
            known = np.isfinite(columns[name])
            try:
                whole = [int(row[i]) if k else 0 for (_, row), k in zip(rows, known, strict=True)]
                found[name] = np.array(whole, dtype=np.int64)
            except (ValueError, OverflowError):  # 1.7e18
                continue
    return found


def _whole(
    path: Path, names: Sequence[str], rows: Sequence[Row], *, at_end: bool
) -> tuple[Sequence[Row], list[str]]:
    """Rows that have a cell for every name, and what was left out."""
    for k, (number, row) in enumerate(rows):
        extra = [cell for cell in row[len(names) :] if cell.strip()]
        if len(row) >= len(names) and not extra:
            continue
        found = f"expected {len(names)} columns, found {len(row)}"
        if at_end and not extra and 0 < k == len(rows) - 1:
            return rows[:-1], [f"line {number}, the last one, is cut and left out: {found}"]
        tried = (
            "text that holds the delimiter has to stand in quotes"
            if extra
            else "leave a line that was cut out of a copy of the file"
        )
        raise BagError(f"{path}, line {number}: {found}; {tried}")
    return rows, []


def is_number(text: str, decimal: str) -> bool:
    """Whether a cell is a number.

    Parameters
    ----------
    text, decimal : str
    """
    if decimal == "," and "." in text and not _GROUPED[","].fullmatch(text):
        return False
    try:
        float(_plain(text, decimal))
    except ValueError:
        return False
    return "_" not in text


def _plain(text: str, decimal: str) -> str:
    """A cell as Python writes numbers."""
    other = "," if decimal == "." else "."
    if other in text and _GROUPED[decimal].fullmatch(text):
        text = text.replace(other, "")
    return text.replace(",", ".", 1) if decimal == "," else text


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
    if decimal != "," or not _may_be_thousands(cells):
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
            raise BagError(
                f"{where}, line {lines[k]}: expected a number,"
                f" found '{cell.strip()[:SHOWN]}'{_hint(cell, last=k == len(cells) - 1)}"
            )
        result[k] = float(_plain(cell, decimal))
    return result


def commas_are_decimal(cells: Sequence[str]) -> bool:
    """Whether some commas are decimal signs beyond doubt and no point is one.

    Parameters
    ----------
    cells : sequence of str
        Of a table that no commas part.
    """
    pointed = [cell for cell in cells if "." in cell and is_number(cell, ".")]
    return all(_POINTS.fullmatch(cell) for cell in pointed) and any(
        _COMMA_NUMBER.fullmatch(cell) and not _COMMAS.fullmatch(cell) for cell in cells
    )


def _may_be_thousands(cells: Sequence[str]) -> bool:
    """Whether the points of a column in a log of decimal commas may part thousands."""
    if not any("." in cell for cell in cells):
        return False
    if any("," in cell for cell in cells):
        return True  # No column has two decimal signs.
    sure = [k for k, cell in enumerate(cells) if "." in cell and not _POINTS.fullmatch(cell)]
    return not sure or (sure == [len(cells) - 1] and bool(_CUT.fullmatch(cells[-1])))


def _why_no_numbers(column: FloatArray, cells: Sequence[str], decimal: str) -> str:
    """Why a column that begins with what may be thousands is not read, where it is not."""
    if not np.isnan(column).all():
        return ""
    first = next((cell.strip() for cell in cells if cell.strip().lower() not in MISSING), "")
    if not (_COMMAS if decimal == "." else _POINTS).fullmatch(first):
        return ""
    return f"expected numbers, found '{first[:SHOWN]}'{_hint(first, last=False)}"


def _hint(cell: str, *, last: bool) -> str:
    """What may be behind a cell that is no number."""
    if _COMMA_NUMBER.fullmatch(cell):
        return "; is the decimal sign a comma, or does it part thousands? then write it without"
    if _POINTS.fullmatch(cell) or ("." in cell and is_number(cell, ".")):
        return "; does the point part thousands, or is it the decimal sign? then write it without"
    return "; the last line: leave it out of a copy of the file if it was cut" if last else ""
