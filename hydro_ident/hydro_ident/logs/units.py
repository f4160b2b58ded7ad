"""Units as other people's tools spell them.

A spelling gives the mapping's own unit, the quantity, and for pressures what the spelling says of
the reference: `barg`, `bar(a)`, `psia`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from hydro_ident.everyday_units import LENGTHS_M, PRESSURES_PA
from hydro_ident.logs.elsewhere import COMMANDED_WORDS, REFERENCE_WORDS
from hydro_ident.logs.words import (
    CHAMBER_A,
    CHAMBER_B,
    COMMON,
    MEASURED,
    MOTIONS,
    OF_PRESSURES,
    SUPPLY,
    TANK,
    word_set,
    words_in,
)

_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0, "mrad": 1e-3, "gon": math.pi / 200.0}
_TORQUES = {"N m": 1.0, "kN m": 1e3}
_FORCES = {"N": 1.0, "kN": 1e3}
#: Units of the mapping by quantity: factor to SI; the first is the default. Of a joint of which
#: nobody knows whether it turns, `position` and `effort`.
UNITS: dict[str, dict[str, float]] = {
    "position": {**_ANGLES, **LENGTHS_M},
    "angle": _ANGLES,
    "length": LENGTHS_M,
    "effort": {**_TORQUES, **_FORCES},
    "torque": _TORQUES,
    "force": _FORCES,
    "pressure": PRESSURES_PA,
    "voltage": {"V": 1.0, "mV": 1e-3},
    "ratio": {"1": 1.0, "%": 1e-2},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "temperature": {"degC": 1.0, "K": 1.0, "degF": 5.0 / 9.0},
}
#: What a reading of zero is in the mapping's first unit, where it is not zero.
ZEROS = {"K": -273.15, "degF": -160.0 / 9.0}

#: Quantity -> unit of the mapping (or of what is not mapped) -> spellings, lower case.
_SPELLINGS: dict[str, dict[str, str]] = {
    "angle": {
        "rad": "rad radian radians",
        "deg": "deg ° degree degrees grad",
        "mrad": "mrad",
        "gon": "gon gons gradian gradians",
    },
    "length": {"m": "m meter metre", "mm": "mm", "cm": "cm"},
    "pressure": {
        "Pa": "pa n/m2 n/m² n/m^2",
        "kPa": "kpa kn/m2 kn/m² kn/m^2",
        "MPa": "mpa n/mm2 n/mm² n/mm^2",
        "bar": "bar",
        "mbar": "mbar hpa",
        "psi": "psi",
        "atm": "atm",
        "kgf/cm2": "at kgf/cm2 kgf/cm² kgf/cm^2 kg/cm2 kg/cm² kg/cm^2 kp/cm2 kp/cm² kp/cm^2",
    },
    "voltage": {"V": "v volt volts", "mV": "mv"},
    "current": {"mA": "ma milliampere", "A": "a ampere amps"},
    "time": {
        "s": "s sec secs second seconds sek",
        "ms": "ms msec",
        "us": "us µs μs usec",
        "ns": "ns",
        "min": "min",
    },
    "ratio": {"%": "% percent pct"},
    "temperature": {
        "degC": "degc °c ºc c celsius",
        "K": "k kelvin",
        "degF": "degf °f ºf fahrenheit",
    },
    "effort": {"N m": "nm n*m n·m", "kN m": "knm kn*m", "N": "n newton newtons", "kN": "kn"},
    "velocity": {
        "rad/s": "rad/s rad/sec radps",
        "deg/s": "deg/s °/s deg/sec degps",
        "m/s": "m/s",
        "mm/s": "mm/s",
        "rpm": "rpm 1/min u/min r/min min^-1 min-1",
    },
    "acceleration": {"rad/s^2": "rad/s^2 rad/s2", "deg/s^2": "deg/s^2 °/s^2", "m/s^2": "m/s^2"},
    "flow": {"l/min": "l/min lpm", "m^3/s": "m3/s m³/s m^3/s", "gpm": "gpm"},
    "frequency": {"Hz": "hz"},
    "mass": {"kg": "kg"},
    "power": {"kW": "kw"},
}
_KNOWN = {
    spelling: (quantity, unit)
    for quantity, units in _SPELLINGS.items()
    for unit, spellings in units.items()
    for spelling in spellings.split()
}
_OF_CURRENTS = word_set("current strom courant corriente corrente")
_REFERENCES = {"g": "gauge", "gauge": "gauge", "rel": "gauge", "a": "absolute", "abs": "absolute"}
_OF_PRESSURE = re.compile(
    r"([kmh]?pa|m?bar|psi|atm?|k(?:gf?|p)/cm\^?[2²])[\s_.]*\(?(gauge|g|rel|absolute|abs|a)\)?"
)
#: Of the patterns of `unit_in` those behind brackets, a slash and `in`.
_LOOSE = 3
#: Endings of a name that say what is measured: `p_atm`.
_NO_SUFFIX = word_set("at atm")
#: How units are written, known or not.
_LIKE_UNIT = re.compile(
    r"[°º]?[a-zµμω%]{1,9}(\^?-?[23²³])?(\s*[/*·.]\s*[a-zµμ]{1,6}(\^?-?[23²³])?)*", re.IGNORECASE
)
_PLACES = CHAMBER_A | CHAMBER_B | SUPPLY | TANK | COMMON | MOTIONS | OF_PRESSURES
_SAID = MEASURED | REFERENCE_WORDS | COMMANDED_WORDS
_NO_UNIT = word_set(
    "none na nan unitless dimensionless raw roh filtered filt gefiltert smoothed left right links"
    " rechts front rear gauge rel relativ abs absolute absolut"
)


@dataclass(frozen=True, slots=True)
class SpeltUnit:
    """What a unit's spelling says.

    Attributes
    ----------
    quantity : str
        `angle`, `length`, `pressure`, `voltage`, `current`, `time`, `ratio`, `temperature`,
        `effort`, or one that no mapping takes: `velocity`, `acceleration`, `flow` ...
    unit : str
        As the mapping spells it.
    reference : str
        `gauge`, `absolute`, or empty where the spelling does not say.
    """

    quantity: str
    unit: str
    reference: str = ""


def spelt(text: str) -> SpeltUnit | None:
    """What a unit is, however it is spelt.

    Parameters
    ----------
    text : str
        As `bar`, `[bar]`, `bar(g)`, `psia`, `°`, `MPa abs`.

    Returns
    -------
    SpeltUnit or None
        None where it is no unit that is known.
    """
    bare = text.strip().strip("[](){}<>").strip().lower()
    if bare in _KNOWN:
        return SpeltUnit(*_KNOWN[bare])
    match = _OF_PRESSURE.fullmatch(bare)
    if match is None:
        return None
    reference = _REFERENCES.get(match[2], "absolute")
    return SpeltUnit(*_KNOWN[match[1]], reference)


def unit_in(name: str) -> str:
    """The unit that a signal's name carries, as the file writes it.

    Parameters
    ----------
    name : str
        As `p1 [bar]`, `Druck (bar)`, `angle / deg`, `Winkel in °`, `pA_bar`.

    Returns
    -------
    str
        Empty where there is none, as in `Lift pressure (A)`: a chamber.
    """
    patterns = (r"[\[({<]\s*([^\[\](){}<>]+(?:\([ag]\))?)\s*[\])}>]\s*$", r"\s/\s*(\S+)\s*$",
                r"\sin\s+(\S+)\s*$",
                r",\s*(\S+)\s*$", r"[_ ]([^\W_]+(?:/\w+)?)$")  # fmt: skip
    for k, pattern in enumerate(patterns):
        match = re.search(pattern, name)
        if match is not None and spelt(match[1]) is not None:
            # `q_a`, `p_s` and the like end in a letter, not in a unit; `u1_V` and `t_s` do.
            seconds = match[1] == "s" and name.lower().startswith("t")
            if pattern is patterns[-1] and len(match[1]) == 1 and match[1] != "V" and not seconds:
                continue
            if k >= _LOOSE and match[1].lower() in _NO_SUFFIX:
                continue
            if not _is_place(match[1].strip(), name[: match.start()]):
                return match[1].strip()
    return ""


def is_share(name: str, given: str) -> bool:
    """Whether a file says of a signal that it has no unit: `[-]`.

    Parameters
    ----------
    name, given : str
        As of `unknown_unit`.
    """
    return given.strip("[]() ") == "-" or re.search(r"[\[(]\s*-\s*[\])]\s*$", name) is not None


def unknown_unit(name: str, given: str) -> str:
    """What a file states for a unit, and nobody here knows.

    Parameters
    ----------
    name : str
        Of the signal: `angle [grd]`.
    given : str
        What else the file states: a line of units, or a unit that `unit_in` found.

    Returns
    -------
    str
        Empty where there is none, or it is known. What stands in brackets is none where it is a
        word for a place or a motion.

    Examples
    --------
    >>> unknown_unit("q1", "grd"), unknown_unit("Druck (Stange)", ""), unknown_unit("Druck", "bar")
    ('grd', '', '')
    """
    if given:
        text, known = given.strip().strip("[](){}<>").strip(), spelt(given) is not None
        letters = any(c.isalpha() for c in text) and text.lower() not in _NO_UNIT
        return text if letters and not known else ""
    match = re.search(r"[\[({<]\s*([^\[\](){}<>]+?)\s*[\])}>]\s*$", name)
    text = match[1] if match is not None else ""
    words = {w for w in words_in(text) if not w.isdigit()}
    if _LIKE_UNIT.fullmatch(text) is None or words & (_PLACES | _SAID | _NO_UNIT):
        return ""
    return text


def _is_place(text: str, before: str) -> bool:
    """Whether a lone letter says where a pressure is: `(A)` its chamber, and no ampere."""
    words = {*words_in(before)}
    lone = len(text) == 1 and text.isalpha() and text.lower() != "v"
    return lone and bool(words & OF_PRESSURES) and not words & _OF_CURRENTS
