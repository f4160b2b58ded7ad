"""Times of a log that no signal of a mapping goes by, while signals look as if they should."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from hydro_ident.errors import BagError
from hydro_ident.logs.clocks import clock_of
from hydro_ident.logs.file import Log
from hydro_ident.logs.guess import Reading, reading_of
from hydro_ident.logs.map import LogMap
from hydro_ident.logs.times import beside, times_among, unit_beside
from hydro_ident.logs.units import UNITS
from hydro_model.arrays import FloatArray

_SHOWN = 3


def check_times(log: Log, mapping: LogMap, used: Collection[str]) -> list[str]:
    """Refuse signals that stand in just the lines of another time than the one they go by.

    Parameters
    ----------
    log : Log
    mapping : LogMap
    used : collection of str
        Signals that the mapping takes, clocks among them.

    Returns
    -------
    list of str
        What looks odd and may be right.

    Raises
    ------
    BagError
        Lines do not pair these signals with the log's time: their values would be written at
        instants at which they were not taken.
    """
    readings = [
        reading_of(name, values, log.units.get(name, ""))
        for name, values in log.columns.items()
        if name not in used
    ]
    remarks = []
    for reading in times_among(readings, log):
        values = log.columns[reading.column]
        main_s = _main_s(log, mapping, len(values))
        if main_s is None or reading.column in log.clocks.values():
            continue
        found = beside(_seconds(reading, values, main_s, mapping), main_s)
        if found.near:
            continue
        name = reading.column
        text = f"'{name}' looks like a time and nothing goes by it: it {found.words()}"
        there = np.isfinite(values)
        alike = list(_on_lines(log, mapping, there)) if found.fewer else []
        if alike and found.apart and name not in mapping.clocks:
            raise BagError(
                f"{log.path}: the values of {_list(alike)} stand in just the {found.lines} lines"
                f" of '{name}', which {found.words()}: give them 'time: {name}' and, under clocks,"
                f" its unit; or name it under clocks alone to leave them as they are"
            )
        remarks.append(text)
    return remarks


def _main_s(log: Log, mapping: LogMap, count: int) -> FloatArray | None:
    """The log's time, s; None where it has another length."""
    if mapping.time is None:
        return np.arange(count) / mapping.rate_hz
    recorded = log.columns[mapping.time.signal]
    return mapping.time.seconds(recorded) if len(recorded) == count else None


def _seconds(
    reading: Reading, values: FloatArray, main_s: FloatArray, mapping: LogMap
) -> FloatArray:
    units = UNITS["time"]
    given = reading.unit.unit if reading.unit is not None else ""
    factor = 1.0 if mapping.time is None else mapping.time.factor
    main_unit = next((u for u, f in units.items() if f == factor), "s")
    unit = unit_beside(values, given if given in units else "", main_s, main_unit)
    return np.asarray(values * units.get(unit, factor))


def _on_lines(log: Log, mapping: LogMap, there: np.ndarray) -> Iterator[str]:
    """Signals that go by the log's time and have values on just these lines."""
    for section in mapping.sections.values():
        for signal in section.values():
            if not signal.signal or clock_of(log, mapping, signal):
                continue
            values = log.columns[signal.signal]
            if len(values) == len(there) and bool((np.isfinite(values) == there).all()):
                yield signal.signal


def _list(names: list[str]) -> str:
    names = list(dict.fromkeys(names))
    rest = len(names) - _SHOWN
    shown = ", ".join(f"'{name}'" for name in names[:_SHOWN])
    return shown + (f" and {rest} more" if rest > 0 else "")
