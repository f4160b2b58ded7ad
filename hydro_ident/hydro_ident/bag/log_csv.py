"""CSV files as columns of numbers, read in flat memory however large they claim to be."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

import numpy as np

from hydro_ident.bag.cdr import FloatArray
from hydro_ident.errors import BagError

_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
_BLOCK_ROWS = 4096
#: Longest line; and text that a packed file may unfold to: so much, and so many times its size.
_MOST_CHARACTERS = 1 << 22
_FREE_CHARACTERS, _LARGEST_RATIO = 1 << 26, 100


@dataclass(frozen=True, slots=True)
class CsvLayout:
    """How a CSV file is laid out.

    Attributes
    ----------
    delimiter : str
        Empty: comma, semicolon or tab, whichever the header line has most of.
    comment : str
        Lines that begin with it are left out; empty: none are.
    """

    delimiter: str = ""
    comment: str = "#"


def read_csv(path: Path, layout: CsvLayout) -> dict[str, FloatArray]:
    """The columns of a CSV file by the names in its first line.

    Parameters
    ----------
    path : Path
        With `.gz` at its end: packed.
    layout : CsvLayout

    Returns
    -------
    dict of str to (N,) array
        NaN where a cell is empty, and in a column without any number.

    Raises
    ------
    BagError
        No text, no line of names, a line of another number of cells, a cell that is no number
        in a column of numbers, or a packed file that unfolds to more than a log would.
    """
    try:
        with _opened(path) as stream:
            return _columns(path, _Lines(path, stream, layout.comment), layout.delimiter)
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise BagError(f"{path}: cannot be read as text: {error}") from error
    except (csv.Error, TypeError, ValueError) as error:
        raise BagError(f"{path}: cannot be read as CSV: {error}") from error


def _opened(path: Path) -> TextIO:
    if path.suffix.lower() == ".gz":
        return gzip.open(path, "rt", encoding="utf-8-sig", newline="")
    return path.open(encoding="utf-8-sig", newline="")


@dataclass(slots=True)
class _Lines:
    """The lines of a file that hold cells, with the number of the present one.

    `characters` counts those given out; whoever uses them up sets it back.
    """

    path: Path
    stream: TextIO
    comment: str
    number: int = 0
    characters: int = 0

    def __iter__(self) -> Iterator[str]:
        packed = self.path.suffix.lower() == ".gz"
        left = _FREE_CHARACTERS + _LARGEST_RATIO * self.path.stat().st_size
        while line := self.stream.readline(_MOST_CHARACTERS):
            self.number += 1
            left -= len(line)
            if len(line) == _MOST_CHARACTERS or (packed and left < 0):
                raise BagError(
                    f"{self.path}, line {self.number}: expected lines of at most"
                    f" {_MOST_CHARACTERS} characters, and a packed log of at most"
                    f" {_LARGEST_RATIO} times its size: found more"
                )
            if line.strip() and not (self.comment and line.startswith(self.comment)):
                self.characters += len(line)
                yield line


@dataclass(slots=True)
class _Column:
    """A column that grows block by block."""

    name: str
    parts: list[FloatArray] = field(default_factory=list)
    has_numbers: bool = False
    #: Line and text of the first cell that is neither number nor empty.
    remark: tuple[int, str] | None = None

    def add(self, cells: Sequence[str], lines: Sequence[int]) -> None:
        try:
            self.parts.append(np.array(cells, dtype=np.float64))
        except ValueError:
            self.parts.append(self._one_by_one(cells, lines))
        else:
            self.has_numbers = True

    def _one_by_one(self, cells: Sequence[str], lines: Sequence[int]) -> FloatArray:
        values = np.full(len(cells), np.nan)
        for k, cell in enumerate(cells):
            if cell.strip().lower() in _MISSING:
                continue
            if is_number(cell):
                values[k] = float(cell)
                self.has_numbers = True
            elif self.remark is None:
                self.remark = lines[k], cell.strip()
        return values

    def values(self, path: Path) -> FloatArray:
        """All of it; a column of remarks is only an error if the mapping asks for it."""
        if self.has_numbers and self.remark is not None:
            line, cell = self.remark
            raise BagError(
                f"{path}, column '{self.name}', line {line}: expected a number,"
                f" found '{cell[:60]}'"
            )
        return np.concatenate(self.parts)


def _columns(path: Path, lines: _Lines, delimiter: str) -> dict[str, FloatArray]:
    each = iter(lines)
    first = next(each, "")
    delimiter = delimiter or max(",;\t", key=first.count)
    names = [name.strip() for name in next(csv.reader([first], delimiter=delimiter), [])]
    _check_names(names, path)
    columns = [_Column(name) for name in names]
    rows: list[list[str]] = []
    at: list[int] = []
    for row in csv.reader(each, delimiter=delimiter):
        if len(row) != len(names):
            raise BagError(
                f"{path}, line {lines.number}: expected {len(names)} columns, found {len(row)}"
            )
        rows.append(row)
        at.append(lines.number)
        if len(rows) == _BLOCK_ROWS or lines.characters > _MOST_CHARACTERS:
            _add(columns, rows, at)
            lines.characters = 0
    _add(columns, rows, at)
    if not columns or not columns[0].parts:
        raise BagError(f"{path}: expected a line of names and lines of numbers, found fewer")
    return {column.name: column.values(path) for column in columns}


def _add(columns: Sequence[_Column], rows: list[list[str]], at: list[int]) -> None:
    if rows:
        for column, cells in zip(columns, zip(*rows, strict=True), strict=True):
            column.add(cells, at)
    rows.clear()
    at.clear()


def _check_names(names: Sequence[str], path: Path) -> None:
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise BagError(f"{path}: column '{twice[0]}' appears more than once")
    if names and all(is_number(name) for name in names):
        raise BagError(f"{path}: expected a first line of names, found numbers")


def is_number(text: str) -> bool:
    """Whether a cell is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
