"""Dates and times of day in text logs: ISO, day.month.year, and slashes where they tell.

With slashes 03/04/2026 is March or April: a column is read where one of its dates has a number
above 12, and else left unread with the reason.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, timedelta

import numpy as np

from hydro_model.arrays import FloatArray

_CLOCK = (
    r"(\d\d?):(\d\d):(\d\d(?:[.,]\d+)?)"
    r"(?: ?([AaPp])\.? ?[Mm]\.?)?(Z| ?[+-]\d\d(?::?\d\d)?)?"
)
_TIME_OF_DAY = re.compile(_CLOCK)
_DATED = re.compile(r"(\d{1,4})([-/.])(\d\d?)\2(\d{1,4})(?:T|,? +)" + _CLOCK)
_DATE = re.compile(r"(\d{1,4})([-/.])\d\d?\2(\d{1,4})")
#: Names of columns in which `1.12.20` is a date and no version.
_DATE_NAME = re.compile(r"\b(?:date|datum)\b", re.IGNORECASE)
#: What a person would take for a date with a time, whether it is read or not.
_BEGINS_SO = r"\d{1,4}[-/.]\d\d?[-/.]\d{1,4}[T ,]+\d\d?:\d\d"
_LOOKS_SO = re.compile(f"{_BEGINS_SO}.*")
#: The same without what may be a further cell: only decimals and words, of a zone, go on.
_ALONE = re.compile(_BEGINS_SO + r"[^\s;,|]*(?:,\d+)?(?: [A-Za-z(\[][^\s;,|]*)*")
_TRY = "write them as 2026-03-12T09:30:00.002 or 12.03.2026 09:30:00.002, or as seconds"
_YEAR_FIRST, _DAY_FIRST, _MONTH_FIRST = "year-month-day", "day.month.year", "month/day/year"
#: A number of this or more is no month, and no hour of a clock of twelve.
_NO_MONTH = _NO_HOUR = 13
_DAY_S = 86400.0


@dataclass(frozen=True, slots=True)
class Dated:
    """A column of dates or times of day.

    Attributes
    ----------
    seconds : (N,) array
        Since the first; NaN where a cell is neither.
    start : str
        The first one, ISO 8601; empty where it has no date.
    note : str
        How the dates were read, where there is more than one way; else empty.
    day : int
        Of the first one, counted; 0 where it has no date.
    of_day : float
        Seconds of that day.
    ahead_s : float
        How far the clock of the first one is ahead of UTC; 0 where nothing says.
    """

    seconds: FloatArray
    start: str
    note: str
    day: int
    of_day: float
    ahead_s: float = 0.0

    def behind(self, other: Dated) -> float:
        """How much later than another column's its first one is, s.

        Of a time of day without a date, the nearest that it may be.

        Parameters
        ----------
        other : Dated
        """
        later_s = self.of_day - other.of_day
        if self.day and other.day:
            return _DAY_S * (self.day - other.day) + later_s - self.ahead_s + other.ahead_s
        return (later_s + 0.5 * _DAY_S) % _DAY_S - 0.5 * _DAY_S


@dataclass(frozen=True, slots=True)
class _Moment:
    """Numbers of a date (none: a time of day), what parts them, seconds of the day, its zone."""

    numbers: tuple[str, str, str] | None
    sign: str
    of_day: float
    zone: str

    @property
    def ahead_s(self) -> float:
        """How far its clock is ahead of UTC; 0 without a zone."""
        if len(self.zone) < len("+hh"):
            return 0.0
        minutes = 60 * int(self.zone[1:3]) + int(self.zone[4:] or 0)
        return -60.0 * minutes if self.zone[0] == "-" else 60.0 * minutes


def is_moment(cell: str) -> bool:
    """Whether a cell is a date with a time, read or not, or a time of day, and nothing more.

    Parameters
    ----------
    cell : str
    """
    return _moment(cell) is not None or _ALONE.fullmatch(cell.strip()) is not None


def is_date(name: str, cell: str) -> bool:
    """Whether a cell is a date without a time.

    Parameters
    ----------
    name : str
        Of its column: years of two digits are told by it alone.
    cell : str
    """
    match = _DATE.fullmatch(cell.strip())
    if match is None:
        return False
    return 4 in (len(match[1]), len(match[3])) or _DATE_NAME.search(name) is not None


def dated(cells: Sequence[str]) -> Dated | None:
    """Dates and times of day as seconds since the first.

    Parameters
    ----------
    cells : sequence of str

    Returns
    -------
    Dated or None
        None where they are neither, or dates that may be read in two ways.

    Raises
    ------
    ValueError
        A day that no month has.
    """
    if not cells or (first := _moment(cells[0])) is None:
        return None
    moments = [_moment(cell) for cell in cells]
    order = _order([m for m in moments if m is not None])
    if order is None:
        return None
    days: dict[tuple[str, str, str] | None, float] = {}
    seconds = np.full(len(cells), np.nan)
    for k, moment in enumerate(moments):
        if moment is not None:
            if moment.numbers not in days:
                days[moment.numbers] = _DAY_S * _day(moment, order).toordinal()
            seconds[k] = days[moment.numbers] - next(iter(days.values())) + moment.of_day
            seconds[k] -= moment.ahead_s - first.ahead_s  # clocks are put forward and back
    if None in days:
        seconds = over_midnight(seconds)
    day = 0 if first.numbers is None else _day(first, order).toordinal()
    start, note = _start(first, order), _note(cells[0], first, order)
    return Dated(seconds - seconds[0], start, note, day, first.of_day, first.ahead_s)


def over_midnight(of_day: FloatArray) -> FloatArray:
    """Times of day without a date, which begin anew at midnight, as times that go on.

    Parameters
    ----------
    of_day : (N,) array
        Seconds of the day; NaN where there is none.

    Returns
    -------
    (N,) array
    """
    known = np.isfinite(of_day)
    times = of_day[known]
    result = of_day.copy()
    result[known] += _DAY_S * np.cumsum(np.diff(times, prepend=times[:1]) < -0.5 * _DAY_S)
    return result


def together(
    columns: Mapping[str, FloatArray], moments: Mapping[str, Dated]
) -> tuple[dict[str, FloatArray], str]:
    """Columns of moments on one line of time, which begins with the first of them that is dated.

    Parameters
    ----------
    columns : mapping of str to (N,) array
        All of a log; those of moments are put on that line.
    moments : mapping of str to Dated

    Returns
    -------
    dict of str to (N,) array, str
        The same columns, and the line's beginning, ISO 8601; empty: nothing is dated.
    """
    if not moments:
        return dict(columns), ""
    begin = next((m for m in moments.values() if m.start), next(iter(moments.values())))
    placed = {name: m.seconds + m.behind(begin) for name, m in moments.items()}
    return {**columns, **placed}, begin.start


def why_unread(cells: Sequence[str]) -> str:
    """Why a column that looks like dates is not read as such, and what to try.

    Parameters
    ----------
    cells : sequence of str

    Returns
    -------
    str
        Empty where it does not look like dates.
    """
    first = next((cell.strip() for cell in cells if cell.strip()), "")
    if not _LOOKS_SO.fullmatch(first):
        return ""
    if _moment(first) is None:
        return f"'{first}' looks like a date that is not known here: {_TRY}"
    return f"'{first}' may be day/month or month/day, and no date there tells: {_TRY}"


def _moment(cell: str) -> _Moment | None:
    text = cell.strip()
    numbers, sign = None, ""
    match = _TIME_OF_DAY.fullmatch(text)
    if match is not None:
        *clock, half, zone = match.groups()
    elif (match := _DATED.fullmatch(text)) is not None:
        first, sign, second, third, *clock, half, zone = match.groups()
        year_first = len(first) == 4 and len(third) <= 2
        year_last = len(first) <= 2 and (len(third) == 4 or (len(third) == 2 and sign == "."))
        if not (year_first or year_last):
            return None
        numbers = (first, second, third)
    else:
        return None
    of_day = _of_day(clock, (half or "").lower())
    return None if of_day is None else _Moment(numbers, sign, of_day, _zone(zone or ""))


def _zone(text: str) -> str:
    """`Z`, or `+hh:mm` whether with a colon and minutes or without; empty: none is given."""
    text = text.strip().replace(":", "")
    return f"{text[:3]}:{text[3:] or '00'}" if len(text) > 1 else text


def _of_day(clock: Sequence[str], half: str) -> float | None:
    """Seconds of the day; None where the hour is none of a half day's."""
    hours, minutes, seconds = clock
    hour = int(hours)
    if half:
        if not 0 < hour < _NO_HOUR:
            return None
        hour = hour % 12 + (12 if half == "p" else 0)
    return hour * 3600.0 + int(minutes) * 60.0 + float(seconds.replace(",", "."))


def _order(moments: Sequence[_Moment]) -> str | None:
    """In which order dates are written; None where that cannot be told."""
    given = [m.numbers for m in moments if m.numbers is not None]
    if not given or len(given[0][0]) == 4:
        return _YEAR_FIRST
    if next(m.sign for m in moments if m.numbers is not None) == ".":
        return _DAY_FIRST
    if any(int(first) >= _NO_MONTH for first, _, _ in given):
        return _DAY_FIRST
    return _MONTH_FIRST if any(int(second) >= _NO_MONTH for _, second, _ in given) else None


def _day(moment: _Moment, order: str) -> date:
    if moment.numbers is None:
        return date(1, 1, 1)
    a, b, c = (int(number) for number in moment.numbers)
    if order == _YEAR_FIRST:
        return date(a, b, c)
    year = c + 2000 if len(moment.numbers[2]) == 2 else c
    return date(year, b, a) if order == _DAY_FIRST else date(year, a, b)


def _start(first: _Moment, order: str) -> str:
    if first.numbers is None:
        return ""
    midnight = datetime.combine(_day(first, order), datetime.min.time())
    moment = midnight + timedelta(microseconds=round(first.of_day * 1e6))
    spec = "microseconds" if moment.microsecond % 1000 else "milliseconds"
    return moment.isoformat(timespec=spec) + first.zone


def _note(cell: str, first: _Moment, order: str) -> str:
    if first.numbers is None or order == _YEAR_FIRST:
        return ""
    return f"'{cell.strip()}' read as {order}: {_day(first, order).isoformat()}"
