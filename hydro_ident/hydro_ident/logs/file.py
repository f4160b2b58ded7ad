"""Logs of other people's tools as columns: CSV, LabVIEW, MATLAB and Parquet files.

A reader gives every signal of a file as one column of numbers under the name that the file has for
it, with the unit and the clock where the file says so, and nothing more: what the columns mean is
the mapping's (`hydro_ident.logs.map`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from hydro_ident.bag.log_kinds import TEXT, instead_of_log, is_text
from hydro_ident.errors import BagError
from hydro_ident.logs.units import unit_in
from hydro_model.arrays import FloatArray, IntArray

_MAX_NAMES = 12
#: Characters of a name or a cell in a message.
SHOWN = 60
#: What a packed log may unfold to: so much, and so many times its size.
_FREE_BYTES, LARGEST_RATIO = 1 << 26, 100
#: Of a matrix' column: `q_deg[2]`.
_INDEX = re.compile(r"\[\d+\]$")


@dataclass(frozen=True, slots=True)
class CsvLayout:
    """How a text file is laid out.

    Attributes
    ----------
    delimiter : str
        Empty: comma, semicolon, tab, `|` or blanks, whichever makes numbers of the lines.
    comment : str
        Lines that begin with it are left out; empty: those that begin with `#`, and those with
        `%` that have fewer or more cells than the table.
    decimal : str
        `.` or `,`; empty: whichever the numbers are written with.
    """

    delimiter: str = ""
    comment: str = ""
    decimal: str = ""


@dataclass(frozen=True, slots=True)
class Exact:
    """Numbers of a signal as the file has them: ``whole / 10**digits``.

    Attributes
    ----------
    whole : (N,) int64 array
        0 where the file has no value.
    digits : int
        Behind the decimal sign.
    """

    whole: IntArray
    digits: int = 0


@dataclass(frozen=True, slots=True)
class Log:
    """The signals of a log file.

    Attributes
    ----------
    path : Path
    columns : mapping of str to (N,) array
        By the file's own names; NaN where the file has no value. Signals of different rates may
        differ in length.
    units : mapping of str to str
        Of the signals for which the file gives one, as it writes it; of the others `read_log`
        takes what their names carry.
    clocks : mapping of str to str
        Signal to the signal that holds its time, where the file pairs them.
    start : str
        When the log began, ISO 8601, where the file says so; empty: it does not.
    notes : tuple of str
        What the reader found: kind of file, delimiter, lines left out.
    lines : mapping of str to (N,) int array
        Of a text's signals: the line in which each sample stands.
    unread : mapping of str to str
        Why a signal holds no number, where the reader can tell; of some there is no column.
    dated : frozenset of str
        Signals that the file writes as dates or times of day: seconds since the first moment of
        the first of them.
    exact : mapping of str to Exact
        Numbers of signals that a double does not hold: their `columns` are rounded.
    """

    path: Path
    columns: Mapping[str, FloatArray]
    units: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[str, str] = field(default_factory=dict)
    start: str = ""
    notes: tuple[str, ...] = ()
    lines: Mapping[str, IntArray] = field(default_factory=dict)
    unread: Mapping[str, str] = field(default_factory=dict)
    dated: frozenset[str] = frozenset()
    exact: Mapping[str, Exact] = field(default_factory=dict)

    def place(self, name: str, index: int) -> str:
        """Where a sample of a signal is, for messages.

        Parameters
        ----------
        name : str
        index : int
            From 0.

        Returns
        -------
        str
            As `line 12`, or `sample 11` where the file has no lines.
        """
        lines = self.lines.get(name)
        return f"sample {index + 1}" if lines is None else f"line {int(lines[index])}"

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
        if name not in self.columns and name in self.unread:
            raise BagError(f"{where}: '{name}' in {self.path} is left out{self.why_unread(name)}")
        if name not in self.columns:
            raise BagError(f"{where}: no signal '{name}' in {self.path} (it has: {self._names()})")
        return self.columns[name]

    def why_unread(self, *names: str) -> str:
        """Why signals hold no number, to go behind a message.

        Parameters
        ----------
        *names : str

        Returns
        -------
        str
            Empty where the reader cannot tell.
        """
        return "".join(f": {self.unread[name]}" for name in names if name in self.unread)

    def _names(self) -> str:
        names = list(self.columns)
        rest = len(names) - _MAX_NAMES
        shown = [name[:SHOWN] for name in names[:_MAX_NAMES]]
        return ", ".join(shown) + (f" and {rest} more" if rest > 0 else "")


def most_unfolded(path: Path) -> int:
    """What a packed log may unfold to, bytes.

    Parameters
    ----------
    path : Path
    """
    return _FREE_BYTES + LARGEST_RATIO * path.stat().st_size


def read_log(path: str | Path, layout: CsvLayout | None = None) -> Log:
    """Read a log by its file type.

    Parameters
    ----------
    path : str or Path
        `.csv`, `.txt`, `.tsv`, `.lvm` or `.asc`, also with `.gz` behind it; `.mat`;
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
    if not path.exists():
        raise BagError(f"no log '{path}': expected a CSV, LVM, MAT or Parquet file")
    kind = path.suffix.lower() if path.is_file() else ""
    if is_text(path) and path.is_file():
        from hydro_ident.logs.text import read_text_log

        return _with_units(read_text_log(path, layout or CsvLayout()))
    reader = _READERS.get(kind)
    if reader is None:
        found = "a folder" if path.is_dir() else f"'{kind}'"
        raise BagError(
            f"{path}: expected {', '.join(TEXT)} (or these with .gz), .mat or .parquet,"
            f" found {found}; {instead_of_log(path)}"
        )
    log = reader(path)
    if not log.columns:
        left_out = "".join(f"; '{name}' is {why}" for name, why in log.unread.items())
        raise BagError(f"{path}: expected signals, found no column of numbers{left_out[:400]}")
    return _with_units(log)


def _with_units(log: Log) -> Log:
    """A log with the units that names carry, in whatever format, where the file gives none."""
    units = {name: log.units.get(name) or unit_in(_INDEX.sub("", name)) for name in log.columns}
    units |= dict.fromkeys(log.dated, "s")  # a date in `time_ms` is no number of milliseconds
    return replace(log, units={name: unit for name, unit in units.items() if unit})


def _read_mat(path: Path) -> Log:
    from hydro_ident.logs.mat import read_mat_log

    return read_mat_log(path)


def _read_parquet(path: Path) -> Log:
    from hydro_ident.logs.parquet import read_parquet_log

    return read_parquet_log(path)


_READERS: dict[str, Callable[[Path], Log]] = {".mat": _read_mat, ".parquet": _read_parquet}
