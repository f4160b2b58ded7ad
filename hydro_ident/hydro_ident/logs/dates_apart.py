"""Dates in one column of a text log and times of day in another, as spreadsheets have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hydro_ident.logs.dates import Dated, dated, is_date, why_unread
from hydro_ident.logs.file import SHOWN


@dataclass(frozen=True, slots=True)
class DatesApart:
    """A column of dates beside one of times of day.

    Attributes
    ----------
    date, time : str
        The columns' names.
    both : Dated or None
        The times with their dates; None where they cannot be joined.
    why : str
        Why the column of dates has no numbers of its own.
    note : str
        What was done, for a person.
    """

    date: str
    time: str
    both: Dated | None
    why: str
    note: str


def dates_apart(
    names: Sequence[str], rows: Sequence[tuple[int, Sequence[str]]], of_day: Sequence[str]
) -> DatesApart | None:
    """Join the dates of a table with its times of day.

    Parameters
    ----------
    names : sequence of str
        Of the columns.
    rows : sequence of (int, sequence of str)
        Line number and cells, one for each name.
    of_day : sequence of str
        Columns of times of day.

    Returns
    -------
    DatesApart or None
        None where there are no dates apart, or no times of day.
    """
    dates = [name for name, cell in zip(names, rows[0][1], strict=False) if is_date(name, cell)]
    if not dates or not of_day:
        return None
    date, time = dates[0], of_day[0]
    if len(dates) == len(of_day) == 1:
        both, why = _joined(rows, names.index(date), names.index(time), date)
    else:
        both, why = (
            None,
            (
                "expected one column of dates and one of times of day, found"
                f" {len(dates)} and {len(of_day)}"
            ),
        )
    if both is None:
        note = f"column '{date[:SHOWN]}' left out, times of day begin at 0 without it: {why}"
        return DatesApart(date, time, None, why, note)
    why = f"its dates are those of '{time[:SHOWN]}'"
    note = f"dates of '{date[:SHOWN]}' joined with the times of '{time[:SHOWN]}'"
    return DatesApart(date, time, both, why, note)


def _joined(
    rows: Sequence[tuple[int, Sequence[str]]], date: int, time: int, name: str
) -> tuple[Dated | None, str]:
    """Two columns as one, or why they cannot be."""
    for line, row in rows:
        if row[time].strip() and not is_date(name, row[date]):
            return None, f"a time without a date in line {line}"
    cells = [f"{row[date].strip()} {row[time].strip()}" for _, row in rows]
    try:
        both = dated(cells)
    except ValueError as error:  # a day that no month has
        return None, str(error)
    return both, "" if both is not None else why_unread(cells)
