"""Logs of other people's tools as columns: CSV, MATLAB and Parquet files.

A reader gives every signal of a file as one column of numbers under the name that the file has for
it, and nothing more: what the columns mean is the mapping's (`hydro_ident.bag.log_map`).
"""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from hydro_ident.bag.cdr import FloatArray
from hydro_ident.errors import BagError

_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
_MAX_NAMES = 12
_TEXT = (".csv", ".txt", ".tsv")


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


@dataclass(frozen=True, slots=True)
class Log:
    """The signals of a log file.

    Attributes
    ----------
    path : Path
    columns : mapping of str to (N,) array
        By the file's own names; NaN where the file has no value.
    """

    path: Path
    columns: Mapping[str, FloatArray]

    def column(self, name: str, where: str) -> FloatArray:
        """A signal by name.

        Parameters
        ----------
        name : str
        where : str
            Who asks, for the message.

        Raises
        ------
        BagError
            The log has no such signal; the message names those it has.
        """
        if name not in self.columns:
            raise BagError(f"{where}: no signal '{name}' in {self.path} (it has: {self._names()})")
        return self.columns[name]

    def _names(self) -> str:
        names = list(self.columns)
        rest = len(names) - _MAX_NAMES
        return ", ".join(names[:_MAX_NAMES]) + (f" and {rest} more" if rest > 0 else "")


def read_log(path: str | Path, layout: CsvLayout | None = None) -> Log:
    """Read a log by its file type.

    Parameters
    ----------
    path : str or Path
        `.csv`, `.txt` or `.tsv`, also with `.gz` behind it; `.mat` (up to version 7.2);
        `.parquet`.
    layout : CsvLayout, optional

    Returns
    -------
    Log

    Raises
    ------
    BagError
        No file, a type that is not known, or content that is not what its type says.
    """
    path = Path(path)
    if not path.is_file():
        raise BagError(f"no log '{path}': expected a CSV, MAT or Parquet file")
    kind = path.suffix.lower()
    inner = Path(path.stem).suffix.lower() if kind == ".gz" else kind
    if inner in _TEXT:
        return Log(path, _read_csv(path, layout or CsvLayout()))
    reader = _READERS.get(kind)
    if reader is None:
        raise BagError(
            f"{path}: expected .csv, .txt, .tsv (or these with .gz), .mat or .parquet,"
            f" found '{kind}'"
        )
    columns = reader(path)
    if not columns:
        raise BagError(f"{path}: expected signals, found no column of numbers")
    return Log(path, columns)


def _read_csv(path: Path, layout: CsvLayout) -> dict[str, FloatArray]:
    try:
        with _opened(path) as stream:
            lines = [(number, line) for number, line in enumerate(stream, 1) if line.strip()]
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise BagError(f"{path}: cannot be read as text: {error}") from error
    if layout.comment:
        lines = [(n, line) for n, line in lines if not line.startswith(layout.comment)]
    if len(lines) < 2:
        raise BagError(f"{path}: expected a line of names and lines of numbers, found fewer")
    delimiter = layout.delimiter or max(",;\t", key=lines[0][1].count)
    rows = list(csv.reader((line for _, line in lines), delimiter=delimiter))
    names = [name.strip() for name in rows[0]]
    _check_names(names, path)
    for (number, _), row in zip(lines[1:], rows[1:], strict=True):
        if len(row) != len(names):
            raise BagError(
                f"{path}, line {number}: expected {len(names)} columns, found {len(row)}"
            )
    at = [number for number, _ in lines[1:]]
    return {
        name: _numbers([row[i] for row in rows[1:]], at, f"{path}, column '{name}'")
        for i, name in enumerate(names)
    }


def _opened(path: Path) -> TextIO:
    if path.suffix.lower() == ".gz":
        return gzip.open(path, "rt", encoding="utf-8-sig", newline="")
    return path.open(encoding="utf-8-sig", newline="")


def _check_names(names: Sequence[str], path: Path) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BagError(f"{path}: column '{twice[0]}' appears more than once")
    if all(_is_number(name) for name in names):
        raise BagError(f"{path}: expected a first line of names, found numbers")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(cells: Sequence[str], lines: Sequence[int], where: str) -> FloatArray:
    """A column of texts as numbers; NaN where a cell is empty or where nothing is a number."""
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:
        pass
    result = np.full(len(cells), np.nan)
    if not any(_is_number(cell) for cell in cells):
        return result  # A column of remarks: only an error if the mapping asks for it.
    for k, cell in enumerate(cells):
        if cell.strip().lower() in _MISSING:
            continue
        if not _is_number(cell):
            raise BagError(f"{where}, line {lines[k]}: expected a number, found '{cell.strip()}'")
        result[k] = float(cell)
    return result


def _read_mat(path: Path) -> dict[str, FloatArray]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=True)
    except NotImplementedError as error:
        raise BagError(
            f"{path}: MAT files of version 7.3 are HDF5: save it with '-v7' in MATLAB first"
        ) from error
    except (MatReadError, ValueError, TypeError, OSError, EOFError) as error:
        line = " ".join(str(error).split())
        raise BagError(f"{path}: not a readable MAT file: {line}") from error
    columns: dict[str, FloatArray] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _add_variable(columns, name, value)
    return columns


def _add_variable(columns: dict[str, FloatArray], name: str, value: Any) -> None:
    """A variable's columns: a vector by name, a matrix as `name[1]` ..., a struct as `name.x`."""
    array = np.asarray(value)
    if array.dtype.names and array.ndim == 0:
        for field in array.dtype.names:
            _add_variable(columns, f"{name}.{field}", array[field].item())
    elif array.dtype.kind in "biuf" and array.ndim <= 1:
        columns[name] = np.atleast_1d(array).astype(np.float64)
    elif array.dtype.kind in "biuf" and array.ndim == 2:
        upright = array if array.shape[0] >= array.shape[1] else array.T
        for i in range(upright.shape[1]):
            columns[f"{name}[{i + 1}]"] = upright[:, i].astype(np.float64)


def _read_parquet(path: Path) -> dict[str, FloatArray]:
    try:
        from pyarrow import (  # type: ignore[import-not-found, import-untyped, unused-ignore]
            ArrowException,
            parquet,
        )
    except ImportError as error:
        raise BagError(
            f"{path}: Parquet needs the optional package pyarrow: python -m pip install pyarrow"
        ) from error
    try:
        table = parquet.read_table(path)
        frame = {
            name: table.column(name).to_numpy()
            for name, kind in zip(table.column_names, table.schema.types, strict=True)
            if str(kind).startswith(("int", "uint", "float", "double", "halffloat", "bool"))
        }
    except (ArrowException, OSError, ValueError) as error:
        line = " ".join(str(error).split())
        raise BagError(f"{path}: not a readable Parquet file: {line}") from error
    return {name: np.asarray(values, dtype=np.float64) for name, values in frame.items()}


_READERS: dict[str, Callable[[Path], dict[str, FloatArray]]] = {
    ".mat": _read_mat,
    ".parquet": _read_parquet,
}
