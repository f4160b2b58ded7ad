"""LabVIEW's text export of waveforms as a plain table.

Rows `waveform` (names), `t0` and `delta t` stand above the row `time`, and below it samples.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from hydro_ident.errors import BagError

Lines = Sequence[tuple[int, str]]
_NAMES, _ALIKE, _TIME = "waveform", ("t0", "delta t"), "time"
#: Lines in which they stand.
_HEAD = 8


def is_waveforms(lines: Lines) -> bool:
    """Whether a text is an export of waveforms.

    Parameters
    ----------
    lines : sequence of (int, str)
        Without empty ones.
    """
    tags = [_row(lines, k)[0].strip().lower() for k in range(min(_HEAD, len(lines)))]
    return tags[:1] == [_NAMES] and all(tag in tags for tag in _ALIKE)


def waveform_table(path: Path, lines: Lines) -> Lines:
    """Names and samples of the waveforms.

    Parameters
    ----------
    path : Path
        For messages.
    lines : sequence of (int, str)
        Without empty ones.

    Returns
    -------
    sequence of (int, str)
        A line of names, `time` first, and the samples.

    Raises
    ------
    BagError
        Not one column of time for all, or waveforms that begin or step otherwise than others.
    """
    rows = [_row(lines, k) for k in range(min(_HEAD, len(lines)))]
    tags = [row[0].strip().lower() for row in rows]
    times = rows[tags.index(_TIME)] if _TIME in tags else []
    if sum(cell.strip().lower().startswith(_TIME) for cell in times) != 1:
        raise BagError(
            f"{path}: a LabVIEW export of waveforms, expected one row '{_TIME}' and one column of"
            " time for all: export it with a single time column, or as a measurement file (.lvm)"
        )
    for tag in _ALIKE:
        found = {cell.strip() for cell in rows[tags.index(tag)][1:] if cell.strip()}
        if len(found) > 1:
            raise BagError(
                f"{path}: a LabVIEW export of waveforms, expected the same '{tag}' of all, found"
                f" {' and '.join(sorted(found)[:2])}: export those of each on their own"
            )
    number, names = lines[0]
    return [(number, _TIME + names[len(_NAMES) :]), *lines[tags.index(_TIME) + 1 :]]


def _row(lines: Lines, k: int) -> list[str]:
    """Cells of a line, by the sign behind the first word."""
    word = lines[0][1][: len(_NAMES)]
    delimiter = lines[0][1][len(word) :][:1]
    return next(csv.reader([lines[k][1]], delimiter=delimiter or "\t"), [""]) or [""]
