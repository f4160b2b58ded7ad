"""Parquet files as logs; needs the optional package pyarrow."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hydro_ident.bag.memory import require
from hydro_ident.errors import BagError
from hydro_ident.logs.file import Log

_NUMBERS = ("int", "uint", "float", "double", "halffloat", "bool")
#: Memory that a cell takes at most: as Arrow reads it, as numpy takes it over, and as a number.
_BYTES_PER_CELL = 24


def read_parquet_log(path: Path) -> Log:
    """Read a Parquet file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Log
        Columns of time stamps are in seconds since the first one of the first; that is `start`.

    Raises
    ------
    BagError
        pyarrow is not there, the file is no Parquet file, or it does not fit into memory.
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
    columns, dated, begin = {}, set[str](), None
    try:
        with parquet.ParquetFile(path) as file:
            kinds = {f.name: str(f.type) for f in file.schema_arrow}
            wanted = [name for name, kind in kinds.items() if _is_read(kind)]
            # Told by the file's end, whatever its pages unfold to: a few bytes may be many rows.
            require(path, _BYTES_PER_CELL * file.metadata.num_rows * max(len(wanted), 1))
            table = file.read(columns=wanted)
        for name, kind in zip(table.column_names, table.schema.types, strict=True):
            if str(kind).startswith(_NUMBERS):
                columns[name] = np.asarray(table.column(name).to_numpy(), dtype=np.float64)
            elif str(kind).startswith("timestamp") and table.num_rows:
                own = np.asarray(table.column(name).to_numpy()).astype("datetime64[ns]")
                begin = own[0] if begin is None else begin
                dated.add(name)
                columns[name] = (own - begin) / np.timedelta64(1, "s")
        units = {
            f.name: f.metadata[b"unit"].decode()
            for f in table.schema
            if f.metadata and b"unit" in f.metadata
        }
    except (ArrowException, OSError, ValueError) as error:
        line = " ".join(str(error).split())
        raise BagError(f"{path}: not a readable Parquet file: {line[:400]}") from error
    start = str(begin.astype("datetime64[us]")) if begin is not None else ""
    return Log(path, columns, units=units, start=start, dated=frozenset(dated))


def _is_read(kind: str) -> bool:
    return kind.startswith((*_NUMBERS, "timestamp"))
