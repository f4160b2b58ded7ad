"""Logs of other people's tools as columns: CSV, MATLAB and Parquet files.

A reader gives every signal of a file as one column of numbers under the name that the file has for
it, and nothing more: what the columns mean is the mapping's (`hydro_ident.bag.log_map`).
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from hydro_ident.bag.cdr import FloatArray
from hydro_ident.bag.log_csv import CsvLayout, read_csv
from hydro_ident.errors import BagError

_MAX_NAMES = 12
_TEXT = (".csv", ".txt", ".tsv")
#: What a MAT file may unfold to: so much, and so many times its size.
_FREE_BYTES, _LARGEST_RATIO = 1 << 27, 100
_MAT_HEADER_BYTES, _MAT_COMPRESSED = 128, 15

__all__ = ["CsvLayout", "Log", "read_log"]


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
        return Log(path, read_csv(path, layout or CsvLayout()))
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


def _read_mat(path: Path) -> dict[str, FloatArray]:
    from scipy.io import loadmat, whosmat

    allowed = _FREE_BYTES + _LARGEST_RATIO * path.stat().st_size
    try:
        _check_packed(path, allowed)
        if sum(math.prod(shape) for _, shape, _ in whosmat(path)) > allowed:
            raise ValueError(f"variables of more than {allowed} numbers")
        content = loadmat(path, squeeze_me=True, struct_as_record=True)
    except NotImplementedError as error:
        raise BagError(
            f"{path}: MAT files of version 7.3 are HDF5: save it with '-v7' in MATLAB first"
        ) from error
    except Exception as error:  # scipy raises what its parts raise: IndexError, MemoryError ...
        line = " ".join(str(error).split()) or type(error).__name__
        raise BagError(f"{path}: not a readable MAT file: {line[:400]}") from error
    columns: dict[str, FloatArray] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _add_variable(columns, name, value)
    return columns


def _check_packed(path: Path, allowed: int) -> None:
    """Unfold the packed elements of a MAT file (versions 6 and 7) to nowhere and add them up."""
    with open(path, "rb") as stream:
        head = stream.read(_MAT_HEADER_BYTES)
        order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
        while order and len(tag := stream.read(8)) == 8:
            kind, count = struct.unpack(f"{order}II", tag)
            if kind == _MAT_COMPRESSED:
                allowed -= _unfolded(stream, count, allowed)
            else:
                stream.seek(count, 1)


def _unfolded(stream: IO[bytes], count: int, allowed: int) -> int:
    unpacker, total = zlib.decompressobj(), 0
    while count > 0 and (piece := stream.read(min(count, 1 << 16))):
        count -= len(piece)
        while piece:
            total += len(unpacker.decompress(piece, 1 << 20))
            if total > allowed:
                raise ValueError(f"it unfolds to more than {allowed} bytes")
            piece = unpacker.unconsumed_tail
    return total


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
