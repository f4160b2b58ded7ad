"""Units that people at a machine use, for texts beside SI; files and numbers stay SI."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

#: Pressure drop over one edge at which a valve's flow is told, Pa: half of the 70 bar over both
#: edges at which datasheets of servo valves state it.
EDGE_DROP_PA = 35e5
#: Pa and m in one of the units in which numbers are given.
PRESSURES_PA = {
    "Pa": 1.0,
    "kPa": 1e3,
    "MPa": 1e6,
    "bar": 1e5,
    "psi": 6894.757293168361,
    "mbar": 1e2,
    "atm": 101325.0,
    "kgf/cm2": 98066.5,
}
LENGTHS_M = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}
#: l/min in one m^3/s.
L_MIN = 6e4
EDGE_UNIT = "m^3/(s sqrt(Pa))"

#: What each unit is told in, and how many of it one is.
_TOLD = {
    "Pa": ("bar", 1e-5),
    "Pa gauge": ("bar gauge", 1e-5),
    "rad": ("deg", 180.0 / math.pi),
    "rad/s": ("deg/s", 180.0 / math.pi),
    "m^3/s": ("l/min", L_MIN),
    EDGE_UNIT: ("l/min at 35 bar per edge", math.sqrt(EDGE_DROP_PA) * L_MIN),
}
#: Numbers from here on are told without decimals, up to where an exponent is easier to read.
_WHOLE, _LONG = 100.0, 1e6
_NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
#: A number in a text, or the two of a range, with a unit that goes on no further.
_IN_TEXT = re.compile(
    rf"(?<![\w.])({_NUMBER})(?: to ({_NUMBER}))? (Pa|rad/s|rad|m\^3/s)(?: rms)?"
    r"(?![\w/^(]| (?:s|m|N|kg|Pa)\b)"
)


def everyday(unit: str) -> tuple[str, float] | None:
    """The unit that people use, and how many of it one is; None where SI is what they use.

    Parameters
    ----------
    unit : str
        As the packages write it.
    """
    return _TOLD.get(unit)


def beside(values: Sequence[float], unit: str, between: str = " to ") -> str:
    """Numbers as people tell them, e.g. `80.5 to 175 bar`; empty where SI is what they use.

    Parameters
    ----------
    values : sequence of float
        In SI.
    unit : str
        Theirs.
    between : str
        What stands between two of them.
    """
    told = everyday(unit)
    if told is None or not all(math.isfinite(value) for value in values):
        return ""
    return f"{between.join(rounded(told[1] * value) for value in values)} {told[0]}"


def bracketed(values: Sequence[float], unit: str, between: str = " to ") -> str:
    """As `beside`, in brackets behind a blank; empty where that is.

    Parameters
    ----------
    values : sequence of float
        In SI.
    unit : str
        Theirs.
    between : str
        What stands between two of them.
    """
    text = beside(values, unit, between)
    return f" ({text})" if text else ""


def rounded(value: float) -> str:
    """Three digits of a number, whole ones of a large one.

    Parameters
    ----------
    value : float
    """
    return f"{value:.0f}" if _WHOLE <= abs(value) < _LONG else f"{value:.3g}"


def told(text: str) -> str:
    """A text with everyday units behind numbers of SI.

    Parameters
    ----------
    text : str
        E.g. `at a pressure of 3e+06 to 8e+06 Pa`, which goes on with ` = 30 to 80 bar`.
    """

    def both(found: re.Match[str]) -> str:
        values = [float(value) for value in found.group(1, 2) if value]
        return f"{found[0]} = {beside(values, found[3])}"

    return _IN_TEXT.sub(both, text)
