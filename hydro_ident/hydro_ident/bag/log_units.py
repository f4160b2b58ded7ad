"""Units as other people's tools spell them.

A spelling gives the mapping's own unit, the quantity, and for pressures what the spelling says of
the reference: `barg`, `bar(a)`, `psia`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from hydro_ident.bag.log_words import OF_PRESSURES, word_set, words_in

_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0, "mrad": 1e-3}
_LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}
_TORQUES = {"N m": 1.0, "kN m": 1e3}
_FORCES = {"N": 1.0, "kN": 1e3}
#: Units of the mapping by quantity: factor to SI; the first is the default. Of a joint of which
#: nobody knows whether it turns, `position` and `effort`.
UNITS: dict[str, dict[str, float]] = {
    "position": {**_ANGLES, **_LENGTHS},
    "angle": _ANGLES,
    "length": _LENGTHS,
    "effort": {**_TORQUES, **_FORCES},
    "torque": _TORQUES,
    "force": _FORCES,
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": 6894.757293168361},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "ratio": {"1": 1.0, "%": 1e-2},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "temperature": {"degC": 1.0},
}

#: Quantity -> unit of the mapping (or of what is not mapped) -> spellings, lower case.
_SPELLINGS: dict[str, dict[str, str]] = {
    "angle": {"rad": "rad radian radians", "deg": "deg ° degree degrees grad", "mrad": "mrad"},
    "length": {"m": "m meter metre", "mm": "mm", "cm": "cm"},
    "pressure": {"Pa": "pa", "kPa": "kpa", "MPa": "mpa", "bar": "bar", "psi": "psi"},
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
    "temperature": {"degC": "degc °c ºc c celsius"},
    "effort": {"N m": "nm n*m n·m", "kN m": "knm kn*m", "N": "n newton newtons", "kN": "kn"},
    "velocity": {
        "rad/s": "rad/s rad/sec radps",
        "deg/s": "deg/s °/s deg/sec degps",
        "m/s": "m/s",
        "mm/s": "mm/s",
    },
    "acceleration": {"rad/s^2": "rad/s^2 rad/s2", "deg/s^2": "deg/s^2 °/s^2", "m/s^2": "m/s^2"},
    "flow": {"l/min": "l/min lpm"},
}
_KNOWN = {
    spelling: (quantity, unit)
    for quantity, units in _SPELLINGS.items()
    for unit, spellings in units.items()
    for spelling in spellings.split()
}
_OF_CURRENTS = word_set("current strom courant corriente corrente")
_REFERENCES = {"g": "gauge", "gauge": "gauge", "rel": "gauge", "a": "absolute", "abs": "absolute"}


@dataclass(frozen=True, slots=True)
class SpeltUnit:
    """What a unit's spelling says.

    Attributes
    ----------
    quantity : str
        `angle`, `length`, `pressure`, `voltage`, `current`, `time`, `ratio`, `temperature`,
        `effort`, or one that no mapping takes: `velocity`, `acceleration`, `flow`.
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
    match = re.fullmatch(r"(pa|kpa|mpa|bar|psi)[\s_.]*\(?(gauge|g|rel|absolute|abs|a)\)?", bare)
    if match is None:
        return None
    reference = _REFERENCES.get(match[2], "absolute")
    return SpeltUnit(*_KNOWN[match[1]], reference)


def unit_in(name: str) -> str:
    """The unit that a signal's name carries, as the file writes it.

    Parameters
    ----------
    name : str
        As `p1 [bar]`, `Druck (bar)`, `angle / deg`, `pA_bar`.

    Returns
    -------
    str
        Empty where there is none, as in `Lift pressure (A)`: a chamber.
    """
    patterns = (r"[\[({<]\s*([^\[\](){}<>]+(?:\([ag]\))?)\s*[\])}>]\s*$", r"\s/\s*(\S+)\s*$",
                r",\s*(\S+)\s*$", r"[_ ]([^\W_]+(?:/\w+)?)$")  # fmt: skip
    for pattern in patterns:
        match = re.search(pattern, name)
        if match is not None and spelt(match[1]) is not None:
            # `q_a`, `p_s` and the like end in a letter, not in a unit; `u1_V` and `t_s` do.
            seconds = match[1] == "s" and name.lower().startswith("t")
            if pattern is patterns[-1] and len(match[1]) == 1 and match[1] != "V" and not seconds:
                continue
            if not _is_place(match[1].strip(), name[: match.start()]):
                return match[1].strip()
    return ""


def _is_place(text: str, before: str) -> bool:
    """Whether a lone letter says where a pressure is: `(A)` its chamber, and no ampere."""
    words = {*words_in(before)}
    lone = len(text) == 1 and text.isalpha() and text.lower() != "v"
    return lone and bool(words & OF_PRESSURES) and not words & _OF_CURRENTS
