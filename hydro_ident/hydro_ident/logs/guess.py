"""What a column of a log may be: from its unit, the words of its name and its numbers.

Every reason is kept, so that a person can see why, and its weight says how much to trust it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro_ident.logs.file import Log
from hydro_ident.logs.units import SpeltUnit, is_share, spelt, unit_in, unknown_unit
from hydro_ident.logs.words import word_set, words_in
from hydro_model.arrays import FloatArray

#: How sure a guess is, most sure first.
LEVELS = ("sure", "likely", "guess", "open")
#: Weights of a unit, of a word in the name, of the numbers, and what makes a level.
_UNIT, _WORD, _RANGE = 3, 2, 1
_SURE, _LIKELY, _GUESS = 4, 3, 1

#: Words of names by quantity, without accents, and the usual letters. Not among them is what
#: means something else in another language: `tension` is a voltage, or a pull.
_WORDS: dict[str, str] = {
    "time": "t time zeit timestamp zeitstempel clock uhrzeit sec x_value temps tiempo",
    "pressure": "p press pressure druck ps pt pp pression presion pressione",
    "angle": "q angle ang winkel theta phi alpha joint gelenk encoder enc pitch inclination"
    " neigung z angulo angolo position pos posicion posizione",
    "length": "stroke hub weg len length laenge länge extension s x course carrera corsa",
    "voltage": "u valve ventil cmd command stell joystick sig voltage spannung servo uv"
    " vanne valvula valvola tensione",
    "current": "current strom courant corriente corrente",
    "ratio": "spool schieber lvdt",
    "temperature": "temp temperature temperatur temperatura oil öl oel huile aceite olio",
    "effort": "torque moment tau force kraft fuerza forza coppia effort",
    "velocity": "dq qd dz vel velocity speed geschwindigkeit omega qdot vitesse velocidad"
    " velocita",
    "flow": "flow durchfluss volumenstrom debit caudal portata",
}
#: Words for where something is measured: they say what only where no other word does.
_OF_PLACES = word_set(
    "hub valve ventil cmd command stell joystick servo joint gelenk oil öl oel"
    " vanne valvula valvola huile aceite olio position pos posicion posizione effort"
)
#: Words of what slides: a position of theirs is a length.
_SLIDING = word_set(
    "piston kolben cylinder cyl zylinder rod stange verin cilindro pistone vastago"
)
#: A message's field of forces, which is also where pressures go.
_PRESSED = word_set("pressure pressures")
#: Pressures in Pa go beyond this, which hardly anything else in a log does, and read hardly less
#: than nothing.
_HIGH_PRESSURE, _NO_PRESSURE = 1e4, -2.0
#: Commands of valves are of 10 V at most, and may read a little more.
_VOLTS = 10.5
#: Angles go round once: in degrees, and so in any other unit of theirs but mrad and gon.
_DEGREES = 360.0
#: Oil in degrees Celsius, from that of a cold hall to more than its seals stand for long, and how
#: much it warms up in one log.
_COLD, _HOT, _WARMS = 5.0, 110.0, 30.0
_PORT = re.compile(r"(?:Out|In)\d*\s*[\[({]?\s*")
_OF_WORD = {word: quantity for quantity, words in _WORDS.items() for word in words.split()}


@dataclass(frozen=True, slots=True)
class Reading:
    """What a column may be.

    Attributes
    ----------
    column : str
    quantity : str
        As in `SpeltUnit`; empty: nothing points anywhere.
    unit : SpeltUnit or None
        As the file gives it.
    words : tuple of str
        Of the name, lower case, numbers apart.
    level : str
    why : tuple of str
    low, high : float
        Of the recorded numbers.
    unknown : str
        What the file states for a unit, where nobody here knows it.
    """

    column: str
    quantity: str
    unit: SpeltUnit | None
    words: tuple[str, ...]
    level: str
    why: tuple[str, ...]
    low: float
    high: float
    unknown: str = ""


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


def weakest(*levels: str) -> str:
    """The least sure of some levels.

    Parameters
    ----------
    *levels : str
    """
    return max(levels, key=LEVELS.index)


def words_of(name: str) -> tuple[str, ...]:
    """Words and numbers of a name, lower case, without the unit.

    Parameters
    ----------
    name : str
        Of a path the last two parts count.

    Returns
    -------
    tuple of str
        `pA_lift [bar]` gives p, a, lift; `q12` gives q, 12; `Tankdruck` gives tank, druck;
        accents are left out, umlauts are not.
    """
    unit = unit_in(name)
    if not unit and any(c in "/*·^23²³" for c in unknown_unit(name, "")):
        unit = unknown_unit(name, "")
    bare = name[: name.rfind(unit)] if unit else name
    path = [part for part in bare.split("/") if part.strip()]
    # A block's port says nothing, and its number is no joint's.
    path = [part for part in path if not _PORT.fullmatch(part.strip())] or path
    bare = "/".join(path[-2:])
    return words_in(bare)


def read_columns(log: Log) -> list[Reading]:
    """What each column of a log may be.

    Parameters
    ----------
    log : Log

    Returns
    -------
    list of Reading
    """
    readings = [
        reading_of(name, values, log.units.get(name, "")) for name, values in log.columns.items()
    ]
    unread = log.unread
    return [
        replace(r, why=(*r.why, unread[r.column])) if r.column in unread else r for r in readings
    ]


def reading_of(name: str, values: FloatArray, unit: str) -> Reading:
    """What one column may be.

    Parameters
    ----------
    name : str
    values : (N,) array
    unit : str
        As the file gives it, or empty.

    Returns
    -------
    Reading
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return Reading(name, "", None, words_of(name), "open", ("holds no number",), 0.0, 0.0)
    words, declared, unknown = words_of(name), spelt(unit), unknown_unit(name, unit)
    unread = (f"unit '{unknown}' is not known here",) if unknown else ()
    weights: dict[str, int] = {}
    reasons: dict[str, list[str]] = {}
    _weigh(weights, reasons, declared.quantity if declared else "", _UNIT, f"unit '{unit}'")
    seen = {q: w for w in words if (q := _quantity_of(w, words, name))}
    seen = {q: w for q, w in seen.items() if w not in _OF_PLACES} or seen
    for quantity, word in seen.items():
        _weigh(weights, reasons, quantity, _WORD, f"'{word}' in the name")
    for quantity, text in _by_numbers(known).items():
        if quantity in weights:
            _weigh(weights, reasons, quantity, _RANGE, text)
    if not weights:
        return Reading(name, "", declared, words, "open",
                       ("neither its name nor a unit says", *unread),
                       float(known.min()), float(known.max()), unknown)  # fmt: skip
    best = max(weights, key=lambda q: weights[q])
    if best == "voltage" and is_share(name, unit) and max(abs(known.min()), abs(known.max())) <= 1:
        best = "ratio"
        weights["ratio"], reasons["ratio"] = _WORD, ["'-' for a unit, within -1 to 1"]
    rivals = [q for q in weights if q != best and weights[q] >= weights[best] - 1]
    level = _level(weights[best] - len(rivals))
    why = reasons[best] + [f"could be {q}: {', '.join(reasons[q])}" for q in rivals]
    return Reading(name, best, declared, words, level, (*why, *unread),
                   float(known.min()), float(known.max()), unknown)  # fmt: skip


def _quantity_of(word: str, words: Sequence[str], name: str) -> str:
    """What a word of a name says is measured, or nothing."""
    quantity = _OF_WORD.get(word, "")
    if word == "effort" and _PRESSED.intersection(words_in(name)):
        return "pressure"
    slides = quantity == "angle" and word in _OF_PLACES and _SLIDING.intersection(words)
    return "length" if slides else quantity


def _weigh(
    weights: dict[str, int], reasons: dict[str, list[str]], quantity: str, weight: int, text: str
) -> None:
    if quantity:
        weights[quantity] = weights.get(quantity, 0) + weight
        reasons.setdefault(quantity, []).append(text)


def _level(weight: int) -> str:
    if weight >= _SURE:
        return "sure"
    return "likely" if weight >= _LIKELY else "guess" if weight >= _GUESS else "open"


def _by_numbers(known: FloatArray) -> Mapping[str, str]:
    """What the numbers speak for."""
    steps = np.diff(known)
    low, high = float(known.min()), float(known.max())
    found = {}
    if len(steps) and bool((steps > 0.0).all()):
        found["time"] = "increases from line to line"
    if low > _NO_PRESSURE and high > _HIGH_PRESSURE:
        found["pressure"] = f"reaches {high:.3g}"
    if max(abs(low), abs(high)) <= _VOLTS and high - low > 0.0:
        found["voltage"] = f"within {low:.3g} to {high:.3g}"
    if max(abs(low), abs(high)) <= _DEGREES:
        found["angle"] = f"within {low:.3g} to {high:.3g}"
    if low > _COLD and high < _HOT and high - low < _WARMS:
        found["temperature"] = f"within {low:.3g} to {high:.3g}"
    return found
