"""A mapping to start from: columns of a log to joints, chambers and valves, each with its reasons.

Nothing is guessed that a wrong guess would hide: where nothing tells a unit or a pressure's
reference, the mapping says FILL_IN, and `convert` refuses it until a person has.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hydro_ident.bag.log_file import Log
from hydro_ident.bag.log_fill import fill
from hydro_ident.bag.log_guess import LEVELS, Reading, read_columns, weakest
from hydro_ident.bag.log_names import Target
from hydro_ident.bag.log_signal import FILL_IN
from hydro_ident.bag.log_targets import Targets
from hydro_ident.bag.log_units import UNITS
from hydro_model.robot import Robot

_REFERENCE_WORDS = frozenset(
    ["ref", "reference", "soll", "sollwert", "des", "desired", "target", "setpoint"]
)
_MEASURED_WORDS = frozenset(
    ["ist", "act", "actual", "meas", "measured", "applied", "state", "fb", "feedback"]
)
#: Rates that logs of machines have, Hz, and the usual one.
_RATES, _USUAL_HZ = (2.0, 2e4), 500.0
_BELOW_PA = -5e3


@dataclass(frozen=True, slots=True)
class Guess:
    """A column and what the mapping makes of it.

    Attributes
    ----------
    column : str
    section : str
        Key of the mapping; empty: left out.
    name : str
        On the topic.
    entry : mapping of str to object
        The entry's keys.
    level : str
        One of `LEVELS`; `open` where something is to be filled in.
    why : tuple of str
    """

    column: str
    section: str
    name: str
    entry: Mapping[str, object]
    level: str
    why: tuple[str, ...]


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
    """

    log: Log
    robot: str
    guesses: tuple[Guess, ...]
    missing: tuple[str, ...] = field(default=())

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
    readings = read_columns(log)
    targets = Targets(robot)
    clock = _clock(log, readings)
    kinds = {r.column: _section(r, targets) for r in readings if clock is None or r != clock}
    named = targets.assign({r.column: (kinds[r.column], r) for r in readings if r.column in kinds})
    references = _references(log, [r for r in readings if kinds.get(r.column) == "pressures"])
    guesses = []
    for reading in readings:
        if clock is not None and reading.column == clock.column:
            guesses.append(_time_guess(log, reading))
        elif reading.column in log.clocks.values():
            guesses.append(Guess(reading.column, "", "", {}, "sure", ("clock of a raster",)))
        elif reading.column in named:
            target = named[reading.column]
            guesses.append(_entry(log, reading, target, targets, references))
        else:
            spare = (f"{kinds[reading.column]}: no name is left for it",)
            why = _unasked(reading) if kinds[reading.column] == "left out" else spare
            guesses.append(Guess(reading.column, "", "", {}, reading.level, why))
    if clock is None:
        guesses.insert(0, Guess("", "time", "", {"rate_hz": FILL_IN}, "open", ("no time found",)))
    return Suggestion(log, robot_name, tuple(guesses), targets.missing(named.values()))


def _unasked(reading: Reading) -> tuple[str, ...]:
    if reading.quantity in ("velocity", "acceleration"):
        return (*reading.why, "not taken: the analysis differentiates positions itself")
    return reading.why


def _clock(log: Log, readings: Sequence[Reading]) -> Reading | None:
    """The column that is the log's time: of several clocks the finest."""
    paired = set(log.clocks.values())
    found = [r for r in readings if r.column in paired] or [
        r for r in readings if r.quantity == "time" and any("increases" in w for w in r.why)
    ]
    if paired:
        return min(found, key=lambda r: _step(log, r.column), default=None)
    return min(found, key=lambda r: LEVELS.index(r.level), default=None)


def _step(log: Log, column: str) -> float:
    values = log.columns[column]
    return float(np.median(np.diff(values[np.isfinite(values)])))


def _time_guess(log: Log, reading: Reading) -> Guess:
    entry: dict[str, object] = {"signal": reading.column}
    step = _step(log, reading.column)
    if reading.unit is not None and reading.unit.quantity == "time":
        entry["unit"] = reading.unit.unit
        return Guess(reading.column, "time", "", entry, reading.level, reading.why)
    fitting = {
        unit: 1.0 / (step * factor)
        for unit, factor in UNITS["time"].items()
        if unit != "min" and _RATES[0] <= 1.0 / (step * factor) <= _RATES[1]
    }
    if not fitting:
        entry["unit"] = FILL_IN
        return Guess(reading.column, "time", "", entry, "open", (*reading.why, f"steps {step:g}"))
    unit = min(fitting, key=lambda u: abs(np.log(fitting[u] / _USUAL_HZ)))
    entry["unit"] = unit
    level = "likely" if len(fitting) == 1 else "guess"
    why = (*reading.why, f"steps of {step:.6g} {unit} are {fitting[unit]:.6g} Hz")
    return Guess(reading.column, "time", "", entry, weakest(reading.level, level), why)


def _section(reading: Reading, targets: Targets) -> str:
    """Section of the mapping that takes a quantity; empty where none does."""
    words = set(reading.words)
    if reading.quantity in ("angle", "length") and words & _REFERENCE_WORDS:
        return "references"
    if reading.quantity == "length":
        return "strokes" if targets.has_strokes else "joints"
    if reading.quantity == "voltage":
        return "valves" if words & _MEASURED_WORDS else "valve_commands"
    if reading.quantity == "current":
        # A loop's current is a transducer's, a coil's a valve's.
        return "pressures" if {"p", "druck", "pressure", "press"} & words else "valve_commands"
    return {
        "angle": "joints",
        "pressure": "pressures",
        "ratio": "spools",
        "temperature": "oil_temperature",
        "effort": "efforts",
    }.get(reading.quantity, "left out")


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
