"""A mapping to start from: columns of a log to joints, chambers and valves, each with its reasons.

Nothing is guessed that a wrong guess would hide: where nothing tells a unit or a pressure's
reference, the mapping says FILL_IN, and `convert` refuses it until a person has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.logs.file import Log
from hydro_ident.logs.fill import fill, unit_of_others
from hydro_ident.logs.guess import Guess, Reading, read_columns, weakest
from hydro_ident.logs.names import Target
from hydro_ident.logs.sections import missing_of, section_of, why_left_out
from hydro_ident.logs.signal import FILL_IN
from hydro_ident.logs.suggest_times import OwnTime, times_of
from hydro_ident.logs.targets import Targets
from hydro_ident.logs.units import UNITS
from hydro_ident.logs.words import words_in
from hydro_model.robot import Robot

_BELOW_PA = -5e3


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A mapping to start from.

    Attributes
    ----------
    log : Log
    robot : str
        As it goes into the mapping; empty: none was given.
    guesses : tuple of Guess
        In the order of the columns.
    missing : tuple of str
        What the robot has and the log seems not to hold.
    start : str
        Stamp of time 0, ISO 8601; empty: nothing tells.
    start_why : str
    """

    log: Log
    robot: str
    guesses: tuple[Guess, ...]
    missing: tuple[str, ...] = ()
    start: str = ""
    start_why: str = ""

    @property
    def to_fill_in(self) -> tuple[str, ...]:
        """What a person has to say before `convert` takes the mapping."""
        return tuple(
            f"{g.section}{', ' if g.name else ''}{g.name}: {key}"
            for g in self.guesses
            for key, value in g.entry.items()
            if value == FILL_IN
        )

    def as_dict(self) -> dict[str, object]:
        """For `--json`."""
        return {
            "log": str(self.log.path),
            "robot": self.robot or None,
            "guesses": [
                {
                    "column": g.column,
                    "section": g.section or None,
                    "name": g.name or None,
                    "entry": dict(g.entry),
                    "sure": g.level,
                    "why": list(g.why),
                }
                for g in self.guesses
            ],
            "to_fill_in": list(self.to_fill_in),
            "missing": list(self.missing),
            "start": self.start or None,
            "notes": list(self.log.notes),
        }


def suggest(log: Log, robot: Robot | None = None, robot_name: str = "") -> Suggestion:
    """Guess a mapping.

    Parameters
    ----------
    log : Log
    robot : Robot, optional
        Its names and limits make guesses surer.
    robot_name : str
        As it is to stand in the mapping.

    Returns
    -------
    Suggestion
    """
    targets = Targets(robot)
    readings = [_own_words(r, targets) for r in read_columns(log)]
    times = times_of(log, readings)
    kinds = {r.column: section_of(r, targets) for r in readings if r.column not in times.guesses}
    named = targets.assign({r.column: (kinds[r.column], r) for r in readings if r.column in kinds})
    references = _references(log, [r for r in readings if kinds.get(r.column) == "pressures"])
    guesses = [times.guesses[""]] if "" in times.guesses else []
    for reading in readings:
        if reading.column in times.guesses:
            guesses.append(times.guesses[reading.column])
        elif reading.column in named:
            guess = _entry(log, reading, named[reading.column], targets, references)
            guesses.append(_with_time(guess, times.own.get(reading.column, OwnTime())))
        else:
            kind = kinds[reading.column]
            spare = (*reading.why, targets.why_unnamed(kind, reading))
            why = why_left_out(reading, targets) if kind == "left out" else spare
            guesses.append(Guess(reading.column, "", "", {}, reading.level, why))
    guesses = _units_of_others(guesses, readings, named, targets)
    guesses += [
        Guess(name, "", "", {}, "open", (why,))
        for name, why in log.unread.items()
        if name not in log.columns
    ]
    missing = missing_of(named.values(), targets)
    start = times.start, times.start_why
    return Suggestion(log, robot_name, tuple(guesses), missing, *start)


def _own_words(reading: Reading, targets: Targets) -> Reading:
    """Of `pressure (crane)` the brackets hold no unit where the robot has such a name."""
    if not set(words_in(reading.unknown)) & targets.words():
        return reading
    text = f"'{reading.unknown}'"
    return replace(reading, unknown="", why=tuple(w for w in reading.why if text not in w))


def _with_time(guess: Guess, own: OwnTime) -> Guess:
    if not own.time:
        return guess
    entry = {**guess.entry, "time": own.time}
    return replace(
        guess, entry=entry, level=weakest(guess.level, own.level), why=(*guess.why, own.why)
    )


def _entry(
    log: Log,
    reading: Reading,
    target: Target,
    targets: Targets,
    references: Mapping[str, tuple[str, str, str]],
) -> Guess:
    entry: dict[str, object] = {"signal": reading.column}
    level, why = fill(entry, log.columns[reading.column], reading, target, targets)
    if target.section == "pressures":
        reference, known, reason = references[reading.column]
        entry["reference"] = reference
        level = weakest(level, known)
        why.append(reason)
    level = weakest(level, reading.level, target.level)
    if FILL_IN in entry.values():
        level = "open"
    all_why = (*reading.why, *target.why, *why)
    return Guess(reading.column, target.section, target.name, entry, level, all_why)


def _units_of_others(
    guesses: Sequence[Guess],
    readings: Sequence[Reading],
    named: Mapping[str, Target],
    targets: Targets,
) -> list[Guess]:
    """Pressures whose unit nothing told take that of the log's others, where it fits."""
    by_column = {r.column: r for r in readings}
    # Of a transducer's loop signal the unit is that of its label.
    plain = [g for g in guesses if g.section == "pressures" and "raw" not in g.entry]
    others = [str(g.entry["unit"]) for g in plain if g.entry["unit"] != FILL_IN]
    found = []
    for guess in guesses:
        column = guess.column
        if guess in plain and guess.entry["unit"] == FILL_IN and not by_column[column].unknown:
            unit, why = unit_of_others(by_column[column], named[column], targets, others)
            if unit:
                entry = {**guess.entry, "unit": unit}
                level = "open" if FILL_IN in entry.values() else "guess"
                guess = replace(guess, entry=entry, level=level, why=(*guess.why, why))
        found.append(guess)
    return found


def _references(log: Log, readings: Sequence[Reading]) -> dict[str, tuple[str, str, str]]:
    """Gauge or absolute, how sure, and why, of every pressure."""
    below = []
    for reading in readings:
        factor = UNITS["pressure"].get(reading.unit.unit, 0.0) if reading.unit else 0.0
        values = log.columns[reading.column]
        if factor and float(np.nanpercentile(values, 1.0)) * factor < _BELOW_PA:
            below.append(reading.column)
    found = {}
    for reading in readings:
        said = reading.unit.reference if reading.unit else ""
        said = said or ("gauge" if "gauge" in reading.words or "rel" in reading.words else "")
        said = said or ("absolute" if {"abs", "absolute"} & set(reading.words) else "")
        if said:
            found[reading.column] = (said, "sure", f"{said}: the file says so")
        elif reading.column in below:
            found[reading.column] = ("gauge", "sure", "gauge: goes below zero")
        elif below:
            found[reading.column] = ("gauge", "likely", f"gauge: '{below[0]}' goes below zero")
        else:
            found[reading.column] = (FILL_IN, "open", "gauge or absolute: nothing here tells")
    return found
