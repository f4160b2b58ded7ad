"""Parquet files as logs; needs the optional package pyarrow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hydro_ident.bag.memory import require
from hydro_ident.errors import BagError
from hydro_ident.logs.cells import check_once
from hydro_ident.logs.dates import Dated, over_midnight, together
from hydro_ident.logs.file import Exact, Log
from hydro_model.arrays import FloatArray

_NUMBERS = ("int", "uint", "float", "double", "halffloat", "bool")
_DECIMALS = "decimal"
#: Moments, ways of time, and times of day: all are read as seconds.
_STAMPS, _DURATIONS, _OF_DAY = "timestamp", "duration", ("time32", "time64")
_READ = (*_NUMBERS, _DECIMALS, _STAMPS, _DURATIONS, *_OF_DAY)
#: Memory that a cell takes at most: as Arrow reads it, as numpy takes it over, and as a number.
_BYTES_PER_CELL, _BYTES_PER_DECIMAL = 24, 48
_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
_EPOCH_DAY = 719_163  # 1970-01-01, counted as Python's dates do
#: Whole numbers between these a double does not hold, and 64 bits do.
_EXACT, _LARGEST = 2**53, 2**63 - 1
_SECOND = np.timedelta64(1, "s")


def read_parquet_log(path: Path) -> Log:
    """Read a Parquet file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Log
        Columns of time stamps and of times of day are in seconds since the first moment of the
        first one, durations in seconds; what is neither these nor a number is in `unread`.

    Raises
    ------
    BagError
        pyarrow is not there, the file is no Parquet file, two of its columns have one name, or it
        does not fit into memory.
    """
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
        with parquet.ParquetFile(path) as file:
            kinds = {f.name: str(f.type) for f in file.schema_arrow}
            wanted = {name: kind for name, kind in kinds.items() if kind.startswith(_READ)}
            check_once([f.name for f in file.schema_arrow if f.name in wanted], path)
            # Told by the file's end, whatever its pages unfold to: a few bytes may be many rows.
            require(path, max(sum(map(_bytes_of, wanted.values())), 1) * file.metadata.num_rows)
            table = file.read(columns=list(wanted))
            # Asked for `axis.q`, Arrow also reads that part of a struct `axis`.
            table = table.select([k for k, n in enumerate(table.column_names) if n in wanted])
        columns, moments = _columns(table)
        exact = _exact(table)
        units = {
            f.name: f.metadata[b"unit"].decode()
            for f in table.schema
            if f.metadata and b"unit" in f.metadata
        }
    except (ArrowException, OSError, ValueError) as error:
        line = " ".join(str(error).split())
        raise BagError(f"{path}: not a readable Parquet file: {line[:400]}") from error
    columns |= {name: moment.seconds for name, moment in moments.items()}
    ordered, start = together({name: columns[name] for name in table.column_names}, moments)
    units |= {name: "s" for name, kind in wanted.items() if kind.startswith(_DURATIONS)}
    unread = {
        name: f"of type {kind}, which is read neither as numbers nor as times"
        for name, kind in kinds.items()
        if name not in wanted
    }
    return Log(
        path,
        ordered,
        units=units,
        start=start,
        unread=unread,
        dated=frozenset(moments),
        exact=exact,
    )


def _bytes_of(kind: str) -> int:
    return _BYTES_PER_DECIMAL if kind.startswith(_DECIMALS) else _BYTES_PER_CELL


def _columns(table: Any) -> tuple[dict[str, FloatArray], dict[str, Dated]]:
    """Columns as numbers, and those of moments."""
    columns: dict[str, FloatArray] = {}
    moments: dict[str, Dated] = {}
    for name, of_type in zip(table.column_names, table.schema.types, strict=True):
        kind, column = str(of_type), table.column(name)
        if kind.startswith(_DECIMALS):
            column = column.cast("float64")
        elif kind.startswith(_OF_DAY):
            # Without a detour over 64 bits Arrow makes no numbers of them.
            column = column.cast("int32" if kind.startswith("time32") else "int64")
        values = column.to_numpy()
        if kind.startswith(_DURATIONS):
            columns[name] = np.asarray(values / _SECOND)
        elif kind.startswith(_STAMPS):
            columns[name] = np.full(len(values), np.nan)
            if (~np.isnat(values)).any():
                moments[name] = _stamped(values)
        else:
            columns[name] = np.asarray(values, dtype=np.float64)
        if kind.startswith(_OF_DAY) and np.isfinite(columns[name]).any():
            moments[name] = _of_day(columns[name] / _PER_SECOND[of_type.unit])
    return columns, moments


def _exact(table: Any) -> dict[str, Exact]:
    """Whole numbers that doubles do not hold; 0 where a cell is empty."""
    found = {}
    for name, of_type in zip(table.column_names, table.schema.types, strict=True):
        if str(of_type) in ("int64", "uint64") and table.num_rows:
            whole = table.column(name).fill_null(0).to_numpy()
            if _EXACT < max(int(whole.max()), -int(whole.min())) <= _LARGEST:
                found[name] = Exact(whole.astype(np.int64))
    return found


def _stamped(values: np.ndarray) -> Dated:
    """Time stamps, some of them known."""
    own = values.astype("datetime64[ns]")
    first = own[~np.isnat(own)][0]
    day = first.astype("datetime64[D]")
    return Dated(
        np.asarray((own - first) / _SECOND),
        str(first.astype("datetime64[us]")),
        "",
        int(day.astype(np.int64)) + _EPOCH_DAY,
        float((first - day) / _SECOND),
    )


def _of_day(seconds: FloatArray) -> Dated:
    """Times of day, some of them known."""
    first = float(seconds[np.isfinite(seconds)][0])
    return Dated(over_midnight(seconds) - first, "", "", 0, first)
