"""What parts the columns of a text log, and which sign is the decimal one."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from itertools import chain

from hydro_ident.logs.cells import Row
from hydro_ident.logs.dates import is_moment
from hydro_ident.logs.file import CsvLayout
from hydro_ident.logs.numbers import commas_are_decimal, is_missing, is_number

#: Lines from the middle of a file that tell delimiter and decimal sign.
_SAMPLED = 200
#: Signs that part columns, those tried first first; and those that part nothing else.
_SIGNS, _PARTING = ";\t,|", ";\t|"
#: Share of numbers from which blanks plainly part columns.
_PLAINLY = 0.9
#: Between blanks: a cell, with what is quoted in it; and gaps that no name has.
_CELL, _GAP = re.compile(r'(?:"[^"]*"|\S)+'), re.compile(r"\s{2,}|\t")


def dialect(lines: Sequence[str], layout: CsvLayout) -> tuple[str, str]:
    """Delimiter and decimal sign of lines.

    Parameters
    ----------
    lines : sequence of str
    layout : CsvLayout
        What is given is kept.

    Returns
    -------
    tuple of str
        Delimiter, decimal sign: those that make numbers of most cells, all lines equally long;
        points that may part thousands do not outnumber decimal commas. Blanks part columns only
        where that makes numbers of nearly all of them and nothing else could.
    """
    half = lines[len(lines) // 2 :][:_SAMPLED]
    found: list[tuple[float, str, str]] = []
    for delimiter in [layout.delimiter] if layout.delimiter else _delimiters(half):
        rows = [row for _, row in split(list(enumerate(half)), delimiter)]
        width, alike = Counter(len(row) for row in rows).most_common(1)[0]
        for decimal in [layout.decimal] if layout.decimal else [".", ","]:
            cells = [cell for row in rows for cell in row if not is_missing(cell)]
            asked = layout.delimiter and layout.decimal
            if decimal == delimiter and not (asked or commas_are_decimal(cells)):
                continue  # Commas that part columns and stand in quoted cells may part thousands.
            # A column of moments alone is no log.
            good = _share(cells, decimal, delimiter, moments=width > 1) * alike / len(rows)
            if delimiter == " " and not (layout.delimiter or (width > 1 and good >= _PLAINLY)):
                continue
            # A comma between digits parts columns or decimals; where semicolons or tabs part
            # columns, it is decimals. More columns decide between readings that are equally good.
            found.append((good + 1e-6 * min(width, 1000), delimiter, decimal))
    _, delimiter, decimal = max(found, key=lambda entry: entry[0])
    if delimiter != "," and decimal != layout.decimal:
        cells = [cell for _, row in split(list(enumerate(half)), delimiter) for cell in row]
        decimal = "," if commas_are_decimal(cells) else decimal
    return delimiter, decimal


def _delimiters(lines: Sequence[str]) -> str:
    """Delimiters that may be a text's; blanks only where no other sign is theirs alone."""
    return _SIGNS if any(sign in line for sign in _PARTING for line in lines) else f"{_SIGNS} "


def _share(cells: Sequence[str], decimal: str, delimiter: str, *, moments: bool) -> float:
    """Share of cells that are numbers, or moments where those count as such."""
    # What ends in a comma before a blank was parted by the comma, and is no number of its own.
    whole = [cell for cell in cells if not (delimiter == " " and cell.endswith(","))]
    good = sum(is_number(cell, decimal) or (moments and is_moment(cell)) for cell in whole)
    return good / max(len(cells), 1)


def split(lines: Sequence[tuple[int, str]], delimiter: str) -> list[Row]:
    """Lines as cells.

    Parameters
    ----------
    lines : sequence of (int, str)
        Line number and text.
    delimiter : str

    Returns
    -------
    list of (int, list of str)
    """
    if delimiter == " ":
        return _aligned(lines)
    # With its end of line, a quote that is left open makes no number of two lines.
    rows = csv.reader((f"{line}\n" for _, line in lines), delimiter=delimiter)
    return [(lines[rows.line_num - 1][0], row) for row in rows]


def _aligned(lines: Sequence[tuple[int, str]]) -> list[Row]:
    """Columns that any number of blanks part; where all gaps are wide, single ones part words."""
    narrow = [[cell.strip('"') for cell in _CELL.findall(line)] for _, line in lines]
    wide = [[cell.strip('"') for cell in _GAP.split(line.strip())] for _, line in lines]
    width, alike = Counter(map(len, narrow)).most_common(1)[0]
    columns, regular = Counter(map(len, wide)).most_common(1)[0]
    if columns > 1 and regular >= alike and not any(map(_several, chain(*wide))):
        return [(number, row) for (number, _), row in zip(lines, wide, strict=True)]
    # Names of several words stand above columns that single blanks part.
    rows = [b if len(a) != width == len(b) else a for a, b in zip(narrow, wide, strict=True)]
    return [(number, row) for (number, _), row in zip(lines, rows, strict=True)]


def _several(cell: str) -> bool:
    """Whether a single blank parts numbers, as in front of a minus."""
    parts = cell.split()
    return len(parts) > 1 and all(is_number(part.replace(",", "."), ".") for part in parts)
