"""The time of a suggested mapping, further clocks, and which signals go by which.

A signal goes by another clock where it has values in just that clock's lines; where that does not
tell, its `time` says FILL_IN.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.logs.file import Log
from hydro_ident.logs.guess import LEVELS, Guess, Reading, weakest
from hydro_ident.logs.joining import SAME, SHARED, joining_s, nearest
from hydro_ident.logs.signal import FILL_IN
from hydro_ident.logs.times import (
    EPOCH,
    Beside,
    beside,
    counts_from,
    stop_of,
    times_among,
    unit_beside,
    unnamed_times,
)
from hydro_ident.logs.units import UNITS
from hydro_model.arrays import FloatArray

#: Rates that logs of machines have, Hz, and the usual one.
_RATES, _USUAL_HZ = (2.0, 2e4), 500.0
#: Values in fewer of a clock's lines than this share may be another clock's.
_MOST_LINES = 0.5


@dataclass(frozen=True, slots=True)
class _Further:
    """A time beside the log's own."""

    reading: Reading
    unit: str
    seconds: FloatArray
    beside: Beside | None  # of another length: none

    @property
    def name(self) -> str:
        return self.reading.column


@dataclass(frozen=True, slots=True)
class OwnTime:
    """What a signal's entry says of its time.

    Attributes
    ----------
    time : str
        Name of a clock, FILL_IN, or empty: the log's own.
    level : str
    why : str
    """

    time: str = ""
    level: str = "sure"
    why: str = ""


@dataclass(frozen=True, slots=True)
class Times:
    """What a log's columns say of time.

    Attributes
    ----------
    guesses : mapping of str to Guess
        By column; that of the log's time under its own, under an empty one where it has none.
    own : mapping of str to OwnTime
        Of the other columns.
    start : str
        Stamp of time 0, ISO 8601; empty: nothing tells.
    start_why : str
    """

    guesses: Mapping[str, Guess]
    own: Mapping[str, OwnTime]
    start: str
    start_why: str


def times_of(log: Log, readings: Sequence[Reading]) -> Times:
    """Guess which columns are times.

    Parameters
    ----------
    log : Log
    readings : sequence of Reading
        Of its columns.

    Returns
    -------
    Times
    """
    start = (log.start, "as the file says; without a zone it counts as UTC")
    if log.clocks:
        return Times(_paired(log, readings), {}, *start)
    found = times_among(readings, log)
    if not found:
        guess = Guess("", "time", "", {"rate_hz": FILL_IN}, "open", _no_time(log, readings))
        return Times({"": guess}, {}, *start)
    main = min(found, key=lambda r: _rank(log, r))
    guess = _time_guess(log, main)
    unit = str(guess.entry["unit"])
    seconds = log.columns[main.column] * UNITS["time"].get(unit, 1.0)
    found += unnamed_times(readings, log, seconds, unit)
    further = [_further(log, r, seconds, unit) for r in found if r is not main]
    times = {r.column for r in found}
    own = {
        r.column: _own_time(log, r.column, guess, seconds, further)
        for r in readings
        if r.column not in times
    }
    zero = _zero_of(log.columns[main.column], unit)
    guesses = {
        f.name: _clock_guess(f, guess, own.values(), log.columns[f.name], zero) for f in further
    }
    guesses[main.column] = _with_clocks(guess, seconds, further, guesses)
    if zero:
        start = (zero, f"'{main.column}' counts from {zero[:4]}")
    return Times(guesses, own, *start)


def _zero_of(values: FloatArray, unit: str) -> str:
    """Where a time in this unit counts from, as a mapping's `start`; empty: its own beginning."""
    counted, zero = counts_from(values)
    return zero if counted == unit else ""


def _rank(log: Log, reading: Reading) -> tuple[bool, int, int]:
    """A log's own time increases, has most samples, and is the surest: the least of these."""
    count = int(np.isfinite(log.columns[reading.column]).sum())
    return bool(stop_of(log, reading.column)), -count, LEVELS.index(reading.level)


def _paired(log: Log, readings: Sequence[Reading]) -> dict[str, Guess]:
    """Of the clocks that the file pairs with signals the finest is the log's."""
    clocks = [r for r in readings if r.column in set(log.clocks.values())]
    main = min(clocks, key=lambda r: _step(log.columns[r.column]))
    late = {"late_s": 0}
    guesses = {
        r.column: Guess(r.column, "clocks", r.column, late, "sure", ("clock of a raster",))
        for r in clocks
    }
    guess = _time_guess(log, main)
    common = {"keep": "common"} if len(clocks) > 1 else {}
    guesses[main.column] = replace(guess, entry={**guess.entry, **common})
    return guesses


def _step(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(np.diff(known))) if len(known) > 1 else np.inf


def _no_time(log: Log, readings: Sequence[Reading]) -> tuple[str, ...]:
    """Why no column is the time."""
    named = [r for r in readings if r.quantity == "time"]
    stops = [
        f"'{r.column}' does not increase: {stop_of(log, r.column) or 'it has one value'}"
        for r in named
    ]
    unread = [f"'{name}': {why}" for name, why in log.unread.items()]
    return ("no time found", *stops, *unread)


def _time_guess(log: Log, reading: Reading) -> Guess:
    values = log.columns[reading.column]
    declared = _declared(reading)
    unit, level = declared, "sure"
    why: tuple[str, ...] = ()
    counted, zero = counts_from(values)
    if counted and (zero == EPOCH or declared in ("", counted)):
        unit, why = counted, (f"counts {counted} from {zero[:4]}",)
        if declared and declared != counted:
            level, why = "guess", (f"counts from 1970, so in {counted} and not in {declared}",)
    elif reading.unknown:
        unit, why = FILL_IN, ("rate_hz in the place of signal gives its rate",)
    elif not declared:
        unit, level, why = _unit_by_rate(_step(values))
    level = "open" if unit == FILL_IN else weakest(reading.level, level)
    if stop := stop_of(log, reading.column, UNITS["time"].get(unit, 1.0)):
        level = weakest("guess", level)
        why = (*why, f"does not increase throughout, which convert refuses: {stop}")
    entry = {"signal": reading.column, "unit": unit}
    return Guess(reading.column, "time", "", entry, level, (*reading.why, *why))


def _declared(reading: Reading) -> str:
    given = reading.unit is not None and reading.unit.quantity == "time"
    return reading.unit.unit if given and reading.unit is not None else ""


def _unit_by_rate(step: float) -> tuple[str, str, tuple[str, ...]]:
    """The unit that makes the rate a usual one, how sure, and why."""
    fitting = {
        unit: 1.0 / (step * factor)
        for unit, factor in UNITS["time"].items()
        if unit != "min"
        and step * factor > 0.0
        and _RATES[0] <= 1.0 / (step * factor) <= _RATES[1]
    }
    if not fitting:
        return FILL_IN, "open", (f"steps {step:g}",)
    unit = min(fitting, key=lambda u: abs(np.log(fitting[u] / _USUAL_HZ)))
    why = f"steps of {step:.6g} {unit} are {fitting[unit]:.6g} Hz"
    return unit, "likely" if len(fitting) == 1 else "guess", (why,)


def _further(log: Log, reading: Reading, main_s: FloatArray, main_unit: str) -> _Further:
    values = log.columns[reading.column]
    known = main_unit if main_unit in UNITS["time"] else "s"
    told = reading.unknown and not counts_from(values)[0]
    unit = "" if told else unit_beside(values, _declared(reading), main_s, known)
    seconds = values * UNITS["time"].get(unit, 1.0)
    same = len(values) == len(main_s)
    return _Further(reading, unit, seconds, beside(seconds, main_s) if same else None)


def _own_time(
    log: Log, column: str, guess: Guess, main_s: FloatArray, further: Sequence[_Further]
) -> OwnTime:
    values = log.columns[column]
    if len(values) != len(main_s):
        return _by_length(len(values), guess.column, len(main_s), further)
    has = np.isfinite(values)
    others = [f for f in further if f.beside is not None and not f.beside.near]
    around = {
        f.name: f.beside
        for f in others
        if f.beside is not None and f.beside.fewer and not (has & ~np.isfinite(f.seconds)).any()
    }
    if around and has.any():
        return _by_lines(int(has.sum()), guess.column, around)
    alike = [f.name for f in others if f.beside is not None and not f.beside.fewer]
    return _by_place(log, column, guess.column, alike)


def _by_length(count: int, main: str, expected: int, further: Sequence[_Further]) -> OwnTime:
    alike = [f for f in further if len(f.seconds) == count]
    if len(alike) == 1:
        level = weakest("likely", alike[0].reading.level)
        return OwnTime(alike[0].name, level, f"time: '{alike[0].name}' has as many samples")
    rest = f"of {' or '.join(f.name for f in alike)}" if alike else "and no other time has as many"
    why = f"time: {count} samples, '{main}' has {expected}: {rest}"
    return OwnTime(FILL_IN, "open", why)


def _by_lines(count: int, main: str, around: Mapping[str, Beside]) -> OwnTime:
    """Of a signal that has values only in lines of a clock that is not in every line."""
    least = min(b.lines for b in around.values())
    name, *more = [n for n, b in around.items() if b.lines == least]
    place = f"in lines of '{name}', which {around[name].words()}"
    if more or count < _MOST_LINES * least or not around[name].apart:
        names = " or ".join(f"'{n}'" for n in (main, *around))
        return OwnTime(FILL_IN, "open", f"time: values only {place}: {names}")
    return OwnTime(name, "likely" if count == least else "guess", f"time: values only {place}")


def _by_place(log: Log, column: str, main: str, alike: Sequence[str]) -> OwnTime:
    """Of a signal beside clocks with values in every line: a block's time stands left of it."""
    if not alike:
        return OwnTime()
    names = list(log.columns)
    clocks = [name for name in names if name in (main, *alike)]

    def left_of(name: str) -> str:
        before = [c for c in clocks if names.index(c) < names.index(name)]
        return before[-1] if before else main

    blocks = {left_of(name) for name in names if name not in clocks}
    block = left_of(column)
    if len(blocks) < 2 or block == main:
        return OwnTime()
    return OwnTime(FILL_IN, "open", f"time: stands behind '{block}': that or '{main}'")


def _clock_guess(
    further: _Further, guess: Guess, own: Collection[OwnTime], values: FloatArray, zero: str
) -> Guess:
    """A further time: a clock where a signal goes by it or may, else left out."""
    reading, name = further.reading, further.name
    words = f"has {len(values)} samples" if further.beside is None else further.beside.words()
    if not any(o.time == name or (o.time == FILL_IN and f"'{name}'" in o.why) for o in own):
        why = f"a second time, not taken: beside '{guess.column}' it {words}"
        return Guess(name, "", "", {}, reading.level, (*reading.why, why))
    alike = _zero_of(values, further.unit) == zero
    entry: dict[str, object] = {"unit": further.unit or FILL_IN, "late_s": 0 if alike else FILL_IN}
    level = "open" if FILL_IN in entry.values() else weakest(reading.level, "likely")
    return Guess(name, "clocks", name, entry, level, (*reading.why, words))


def _with_clocks(
    guess: Guess, main_s: FloatArray, further: Sequence[_Further], guesses: Mapping[str, Guess]
) -> Guess:
    """The log's time with what several clocks ask for."""
    alike = [f for f in further if f.beside is not None and not (f.beside.fewer or f.beside.near)]
    why = [f"'{f.name}' {f.beside.words()}, in the same lines" for f in alike if f.beside]
    level = weakest(guess.level, "guess") if alike else guess.level
    clocks = [f for f in further if guesses[f.name].section]
    entry = dict(guess.entry)
    if clocks:
        entry["keep"] = "common"
        if within := _within_s([main_s, *(f.seconds for f in clocks)]):
            entry["within_s"] = within
            level = weakest(level, "guess")
            why.append("instants of the clocks do not meet: within_s moves them to the nearest")
    return replace(guess, entry=entry, level=level, why=(*guess.why, *why))


def _within_s(times: Sequence[FloatArray]) -> float:
    """What joins clocks where the others' instants are not the finest clock's own; else 0."""
    known = sorted((t[np.isfinite(t)] for t in times), key=_step)
    finest, period = known[0], _step(known[0])
    for other in known[1:]:
        inside = other[(other >= finest[0]) & (other <= finest[-1])]
        away = np.abs(finest[nearest(finest, inside)] - inside)
        if len(away) and float(np.mean(away <= SAME * period)) < SHARED:
            return joining_s(period)
    return 0.0
