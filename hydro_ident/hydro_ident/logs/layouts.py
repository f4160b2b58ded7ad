"""Two tools' own text layouts: dSPACE ControlDesk's CSV and LabVIEW's measurement file.

ControlDesk: sections apart by empty lines, one for each raster; rows of description, their kind in
the first cell (`trace_names`, `path`, a row of units), and from the row that begins with
`trace_values` on the samples, time first. As its recordings are read in
https://github.com/mechatronics-RWTH/lexci-2 (`controldesk_controller.py`).

LabVIEW: https://www.ni.com/tutorial/4139/en (Specification for the LabVIEW Measurement File).
"""

from __future__ import annotations

import csv
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from itertools import count
from pathlib import Path

import numpy as np

from hydro_ident.errors import BagError
from hydro_ident.logs.cells import Row, check_once, columns_of
from hydro_ident.logs.dialect import dialect, split
from hydro_ident.logs.file import CsvLayout, Log
from hydro_ident.logs.numbers import is_number, numbers
from hydro_model.arrays import FloatArray, IntArray

Lines = Sequence[tuple[int, str]]
_VALUES = "trace_values"
_END = "***End_of_Header***"


def is_control_desk(lines: Lines) -> bool:
    """Whether a text is one of ControlDesk's.

    Parameters
    ----------
    lines : sequence of (int, str)
    """
    return any(line.lstrip('"').lower().startswith(_VALUES) for _, line in lines)


def read_control_desk(path: Path, lines: Lines, layout: CsvLayout) -> Log:
    """Read ControlDesk's CSV.

    Parameters
    ----------
    path : Path
    lines : sequence of (int, str)
        Line number and text, empty lines too.
    layout : CsvLayout

    Returns
    -------
    Log
        The time of section k as `time[k]`, of a single one as `time`.

    Raises
    ------
    BagError
        A section without names or of uneven lines.
    """
    sections = [s for s in _sections(lines) if is_control_desk(s)]
    columns: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    lines_at: dict[str, IntArray] = {}
    rasters = f", {len(sections)} rasters" if len(sections) > 1 else ""
    notes = [f"ControlDesk CSV{rasters}"]
    for index, section in enumerate(sections, 1):
        time = f"time[{index}]" if len(sections) > 1 else "time"
        delimiter, decimal = dialect([line for _, line in section], layout)
        rows = split(section, delimiter)
        begin = next(k for k, (_, r) in enumerate(rows) if r[0].strip().lower() == _VALUES)
        described = {r[0].strip().lower(): [c.strip() for c in r[1:]] for _, r in rows[:begin]}
        data = [(n, r[1:]) for n, r in rows[begin:] if any(c.strip() for c in r[1:])]
        names = _signal_names(path, described, section[0][0], len(data[0][1]) if data else 0)
        taken = {*columns, time}
        names = [time, *(_free(name, taken) for name in names[1:])]
        check_once([*columns, *names], path)
        cells = columns_of(path, names, data, decimal, at_end=index == len(sections))
        columns |= cells.columns
        notes += cells.notes
        lines_at |= dict.fromkeys(names, cells.lines)
        clocks |= dict.fromkeys(names[1:], time)
        given = next((row for tag, row in described.items() if "unit" in tag), [])
        units |= {n: u.strip("[]") for n, u in zip(names, given, strict=False) if u}
    return Log(path, columns, units=units, clocks=clocks, notes=tuple(notes), lines=lines_at)


def _sections(lines: Lines) -> list[list[tuple[int, str]]]:
    found: list[list[tuple[int, str]]] = [[]]
    for number, line in lines:
        if line.strip(' ,;\t"'):
            found[-1].append((number, line))
        elif found[-1]:
            found.append([])
    return [section for section in found if section]


def _signal_names(
    path: Path, described: Mapping[str, Sequence[str]], line: int, width: int
) -> list[str]:
    """Names of a section's columns: the traces' own, behind their paths where they repeat."""
    own, paths = described.get("trace_names"), described.get("path")
    names = own or paths
    if names is None or width < 2:
        raise BagError(
            f"{path}, line {line}: expected rows 'trace_names' or 'path' and samples below"
            f" '{_VALUES}', found {', '.join(described) or 'none'}"
        )
    names = [*names, *[""] * (width - len(names))][:width]
    if own and paths:
        full = [*paths, *[""] * (width - len(paths))]
        names = [f"{full[i]}/{n}" if n and names.count(n) > 1 else n for i, n in enumerate(names)]
    if not all(names[1:]):
        raise BagError(f"{path}, line {line}: a column has no name")
    return list(names)


def _free(name: str, taken: Collection[str]) -> str:
    """The name, or with a number behind it where an earlier section or a clock has it too."""
    if name not in taken:
        return name
    return next(f"{name}[{k}]" for k in count(2) if f"{name}[{k}]" not in taken)


def read_labview(path: Path, lines: Lines) -> Log:
    """Read a LabVIEW measurement file.

    Parameters
    ----------
    path : Path
    lines : sequence of (int, str)

    Returns
    -------
    Log
        Time from the X column or from X0 and Delta_X; several segments one behind the other, by
        their own times of day.

    Raises
    ------
    BagError
        No header, or segments that differ in their channels.
    """
    ends = [k for k, (_, line) in enumerate(lines) if line.startswith(_END)]
    if not ends:
        raise BagError(f"{path}: a LabVIEW measurement file without '{_END}'")
    separator = "," if any(line.startswith("Separator,Comma") for _, line in lines[:20]) else "\t"
    top = _tags(lines[: ends[0]], separator)
    decimal = (top.get("Decimal_Separator") or ["."])[0] or "."
    first = _tags(lines[ends[0] + 1 : ends[1]], separator) if len(ends) > 1 else {}
    begun = _moment({**top, **first})
    parts = [
        _segment(path, _segment_lines(lines, ends, k), separator, decimal, begun)
        for k in range(max(len(ends) - 1, 1))
    ]
    columns = {
        name: np.concatenate([_of(path, part, name) for part in parts]) for name in parts[0]
    }
    times = [name for name in columns if name.startswith("X_Value")]
    clocks = _clocks(list(columns), times)
    labels = first.get("Y_Unit_Label", [])
    labelled = [n for n in columns if n not in times]
    if len(times) > 1 and len(labels) >= len(columns) - 1 and not any(labels[1::2]):
        # A cell of the header above each column, those of X empty.
        labelled = list(columns)[1:]
    units = {n: u for n, u in zip(labelled, labels, strict=False) if u}
    units |= dict.fromkeys(times, "s")
    notes = ("LabVIEW measurement file" + (f", {len(parts)} segments" if len(parts) > 1 else ""),)
    start = begun.isoformat() if begun is not None else ""
    return Log(path, columns, units=units, clocks=clocks, start=start, notes=notes)


def _segment_lines(lines: Lines, ends: Sequence[int], k: int) -> tuple[Lines, Lines]:
    """Header and table of a segment."""
    if len(ends) == 1:
        return [], lines[ends[0] + 1 :]
    stop = len(lines)
    if k + 2 < len(ends):
        # A segment's header begins behind the last empty line before its end mark.
        stop = max(i for i in range(ends[k + 1], ends[k + 2]) if not lines[i][1].strip())
    return lines[ends[k] + 1 : ends[k + 1]], lines[ends[k + 1] + 1 : stop]


def _tags(lines: Lines, separator: str) -> dict[str, list[str]]:
    rows = csv.reader((line for _, line in lines if line.strip()), delimiter=separator)
    return {row[0].strip(): [cell.strip() for cell in row[1:]] for row in rows if row}


def _of(path: Path, part: Mapping[str, FloatArray], name: str) -> FloatArray:
    if name not in part:
        raise BagError(f"{path}: the segments differ: one has no '{name}'")
    return part[name]


def _segment(
    path: Path,
    lines: tuple[Lines, Lines],
    separator: str,
    decimal: str,
    begun: datetime | None,
) -> dict[str, FloatArray]:
    tags = _tags(lines[0], separator)
    rows = split([(n, line) for n, line in lines[1] if line.strip()], separator)
    if len(rows) < 2:
        raise BagError(f"{path}: a segment without samples")
    heads = [cell.strip() for cell in rows[0][1]]
    check_once([head for head in heads if head not in ("", "Comment", "X_Value")], path)
    body: list[Row] = [(n, [*r, *[""] * (len(heads) - len(r))]) for n, r in rows[1:]]
    own = _moment(tags)
    late_s = (own - begun).total_seconds() if own is not None and begun is not None else 0.0
    result: dict[str, FloatArray] = {}
    repeated = heads.count("X_Value") > 1
    for i, head in enumerate(heads):
        if not head or head == "Comment":
            continue
        column = numbers(
            [r[i] for _, r in body], [n for n, _ in body], f"{path}, '{head}'", decimal
        )
        name = f"X_Value[{heads[:i].count(head) + 1}]" if head == "X_Value" and repeated else head
        if head == "X_Value":
            if not any(is_number(r[i], decimal) for _, r in body):
                column = _equidistant(path, tags, len(body))
            column = column + late_s
        result[name] = column
    return result


def _equidistant(path: Path, tags: Mapping[str, Sequence[str]], count_: int) -> FloatArray:
    """Time from X0 and Delta_X, where the file has no X column."""
    steps = {float(c.replace(",", ".")) for c in tags.get("Delta_X", []) if c}
    origins = {float(c.replace(",", ".")) for c in tags.get("X0", []) if c}
    if len(steps) != 1 or len(origins) > 1:
        raise BagError(
            f"{path}: expected one Delta_X and one X0 for all channels where there is no X column,"
            f" found {len(steps)} and {len(origins)}: save it with an X column for each channel"
        )
    return np.asarray(next(iter(origins), 0.0) + next(iter(steps)) * np.arange(count_))


def _moment(tags: Mapping[str, Sequence[str]]) -> datetime | None:
    """Date and Time of a header."""
    day, clock = (next(iter(tags.get(key, [])), "") for key in ("Date", "Time"))
    clock = clock.replace(",", ".")
    clock = f"{clock:0<15}"[:15] if "." in clock else clock
    try:
        return datetime.fromisoformat(f"{day.replace('/', '-')}T{clock}")
    except ValueError:
        return None


def _clocks(names: Sequence[str], times: Sequence[str]) -> dict[str, str]:
    """The X column to the left of each signal."""
    clocks, current = {}, ""
    for name in names:
        if name in times:
            current = name
        elif current:
            clocks[name] = current
    return clocks
