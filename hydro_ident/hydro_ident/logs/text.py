"""Text logs: a table below any number of header lines, with or without units, in any locale.

Two tools' own layouts are told by their first words and read in `hydro_ident.logs.layouts`.
"""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hydro_ident.bag.memory import require
from hydro_ident.errors import BagError
from hydro_ident.logs.cells import NO_NAMES, Row, check_names, columns_of
from hydro_ident.logs.dates import is_moment
from hydro_ident.logs.dialect import dialect, split
from hydro_ident.logs.file import LARGEST_RATIO, CsvLayout, Log, most_unfolded
from hydro_ident.logs.memory import TextSize, read_text
from hydro_ident.logs.numbers import is_missing, is_number
from hydro_ident.logs.units import spelt
from hydro_ident.logs.waveforms import is_waveforms, waveform_table

#: Longest line; and bytes for each cell of what a packed log may unfold to.
_MOST_CHARACTERS = 1 << 22
#: Bytes that tell UTF-16, and the share of its high bytes that are empty in a log.
_PROBED, _EMPTY = 2000, 0.9
#: What may part a line's first cell from the rest.
_FIRST, _PARTED = re.compile(r"[;,|\s]"), re.compile(r"[;,|\t]")
#: A typographer's minus as the sign of a cell's number.
_MINUS = re.compile(r"(?<![^\s;,|\"])\u2212(?=[.,]?\d)")
_BYTES_PER_CELL = 32
#: In a line of units: of a quantity that has none.
_NO_UNIT = ("-", "1")


def read_text_log(path: Path, layout: CsvLayout) -> Log:
    """Read a text log.

    Parameters
    ----------
    path : Path
    layout : CsvLayout

    Returns
    -------
    Log

    Raises
    ------
    BagError
        Not text, no line of names, lines of different lengths, a cell that is no number, a packed
        file that unfolds to more than a log would, or more than fits into memory.
    """
    try:
        return _read_layout(path, layout)
    except (csv.Error, TypeError, ValueError, LookupError) as error:
        line = " ".join(str(error).split())
        raise BagError(f"{path}: cannot be read as CSV: {line[:400]}") from error


def _read_layout(path: Path, layout: CsvLayout) -> Log:
    from hydro_ident.logs.layouts import is_control_desk, read_control_desk, read_labview

    lines = list(enumerate(_text(path).splitlines(), 1))
    for number, line in lines:
        if len(line) > _MOST_CHARACTERS:
            raise BagError(
                f"{path}, line {number}: expected lines of at most {_MOST_CHARACTERS} characters,"
                f" found {len(line)}"
            )
    first = next((line for _, line in lines if line.strip()), "")
    if first.startswith("LabVIEW Measurement"):
        return read_labview(path, lines)
    remarks = [(n, line) for n, line in lines if _is_remark(line, layout)]
    lines = [(n, line) for n, line in lines if not _is_remark(line, layout)]
    if is_control_desk(lines):
        return read_control_desk(path, lines, layout)
    lines = [(n, line) for n, line in lines if line.strip()]
    if first.lower().startswith("waveform") and is_waveforms(lines):
        log = _read_table(path, waveform_table(path, lines), [], layout)
        return replace(log, notes=("LabVIEW export of waveforms", *log.notes))
    return _read_table(path, lines, remarks, layout)


def _is_remark(line: str, layout: CsvLayout) -> bool:
    """Whether a line is left out by how it begins.

    `#N/A` is a missing number, and `#` as one of several names that of a column.
    """
    if layout.comment:
        return line.startswith(layout.comment)
    if not line.startswith("#") or is_missing(_FIRST.split(line, maxsplit=1)[0]):
        return False
    first, *names = _PARTED.split(line)
    return first.strip() != "#" or not names or not all(name.strip() for name in names)


def _text(path: Path) -> str:
    try:
        raw = _unpacked(path) if path.suffix.lower() == ".gz" else read_text(path)
        text = _decoded(raw)
        return _MINUS.sub("-", text) if "\u2212" in text else text
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise BagError(f"{path}: cannot be read as text: {error}") from error


def _decoded(raw: bytes) -> str:
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return raw.decode("utf-16")
    for encoding, high in (("utf-16-le", 1), ("utf-16-be", 0)):
        # Without a mark at its beginning: in every second byte of its signs there is nothing.
        probe = raw[: _PROBED - _PROBED % 2]
        empty = probe[high::2].count(0)
        if empty > _EMPTY * len(probe) / 2 and 0 not in probe[1 - high :: 2]:
            return raw.decode(encoding)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Tools on Windows write `°` and `µ` of units so.
        return raw.decode("cp1252")


def _unpacked(path: Path) -> bytes:
    """Packed text, read until it is more than a log would unfold to."""
    most, size = most_unfolded(path), TextSize()
    raw = bytearray()
    with gzip.open(path) as stream:
        while piece := stream.read(1 << 20):
            raw += piece
            size.add(piece)
            require(path, size.needed)
            if len(raw) > most or size.cells * _BYTES_PER_CELL > most:
                raise BagError(
                    f"{path}: expected a packed log of at most {LARGEST_RATIO} times its size and"
                    f" of one cell for each {_BYTES_PER_CELL} bytes of that: found more"
                )
    return bytes(raw)


def _read_table(
    path: Path,
    lines: Sequence[tuple[int, str]],
    remarks: Sequence[tuple[int, str]],
    layout: CsvLayout,
) -> Log:
    if len(lines) < 2:
        raise BagError(f"{path}: expected a line of names and lines of numbers, found fewer")
    delimiter, decimal = dialect([line for _, line in lines], layout)
    rows = split(lines, delimiter)
    # A date alone above the names is no line of a table of several columns.
    usual = Counter(len(row) for _, row in rows).most_common(1)[0][0]
    if not layout.comment:
        # Of the table's width it may be the line of names.
        rows = [r for r in rows if len(r[1]) == usual or not "".join(r[1][:1]).startswith("%")]
    data = (k for k, (_, row) in enumerate(rows) if _is_data(row, decimal))
    data = (k for k in data if len(rows[k][1]) > 1 or usual == 1)
    begin = next((k for k in data if not _may_be_units(rows[k][1], rows[k + 1 :])), None)
    if begin is None:
        raise BagError(
            f"{path}: expected lines of numbers, found none with delimiter '{delimiter}' and"
            f" decimal '{decimal}': give csv: {{delimiter: , decimal: }} in the mapping"
        )
    above = rows[:begin] or _remark_of_names(remarks, rows[begin], delimiter)
    names, units, skipped = _header(path, above, rows[begin])
    cells = columns_of(path, names, rows[begin:], decimal)
    shown = {"\t": "tab", " ": "blanks"}.get(delimiter, delimiter)
    notes = [f"delimiter '{shown}', decimal '{decimal}'"]
    notes += [f"{skipped} lines above the names left out"] if skipped else []
    notes += [f"names from line {above[-1][0]}, a comment"] if not begin else []
    return Log(
        path,
        cells.columns,
        units={**units, **cells.units},
        start=cells.start,
        notes=(*notes, *cells.notes),
        lines=dict.fromkeys(names, cells.lines),
        unread=cells.unread,
        dated=cells.dated,
        exact=cells.exact,
    )


def _is_data(row: Sequence[str], decimal: str) -> bool:
    known = [is_number(cell, decimal) or is_moment(cell) for cell in row if cell.strip()]
    missing = sum(
        is_missing(cell) and not is_number(cell, decimal) for cell in row if cell.strip()
    )
    return sum(known) * 2 > len(known) - missing


def _may_be_units(row: Sequence[str], below: Sequence[Row]) -> bool:
    """Whether few numbers, each 1, and dashes are units of quantities that have none.

    Dashes alone tell nothing where they stand for missing numbers further down.
    """
    cells = [cell.strip() for cell in row if cell.strip()]
    named = [cell for cell in cells if cell not in _NO_UNIT]
    if cells.count("1") * 2 > len(cells) or any(spelt(cell) is None for cell in named):
        return False
    return bool(named) or not any(cell.strip() == "-" for _, r in below for cell in r)


def _remark_of_names(remarks: Sequence[tuple[int, str]], data: Row, delimiter: str) -> list[Row]:
    """The comment right above the numbers where it has a name for each: as NumPy writes them."""
    above = [(n, line.lstrip("#% ")) for n, line in remarks if n < data[0]]
    rows = split(above[-1:], delimiter) if above and above[-1][1] else []
    if not rows or not len(rows[0][1]) == len(data[1]) > 1:
        return []
    return rows if all(name.strip() for name in rows[0][1]) else []


def _header(path: Path, rows: Sequence[Row], data: Row) -> tuple[list[str], dict[str, str], int]:
    """Names, units, and how many lines above belong to neither."""
    if not rows:
        raise BagError(f"{path}: {NO_NAMES}")
    head = [row for _, row in rows]
    with_units = len(head) > 1 and _are_units(head[-1])
    named = len(head) - (2 if with_units else 1)
    names = [name.replace("\n", " ").strip() for name in head[named]]
    while names and not names[-1]:
        names.pop()
    check_names(names, path)
    if len([cell for cell in data[1] if cell.strip()]) > len(names):
        raise BagError(
            f"{path}, line {data[0]}: expected {len(names)} columns, found {len(data[1])}"
        )
    given = head[-1] if with_units else []
    units = {
        name: text.strip().strip("[]()") for name, text in zip(names, given, strict=False) if text
    }
    return names, units, named


def _are_units(row: Sequence[str]) -> bool:
    """Whether most cells are units, of those that name one."""
    given = [cell for cell in row if cell.strip()]
    cells = [cell for cell in given if cell.strip() not in _NO_UNIT]
    known = sum(spelt(cell) is not None for cell in cells)
    return known * 2 > len(cells) or (bool(given) and not cells)
