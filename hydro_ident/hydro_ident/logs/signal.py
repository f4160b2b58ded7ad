"""One entry of a log's mapping: a signal of the log as a quantity, SI.

``value = sign * scale * (signal - minus, in its unit) + offset``; `wrap` is taken out first, and
`raw` and `span` make 4 to 20 mA or 0 to 10 V the transducer's own range.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from hydro_ident.errors import BagError
from hydro_ident.logs.units import UNITS, ZEROS
from hydro_model.arrays import FloatArray
from hydro_model.description.fields import Fields
from hydro_model.errors import RobotError

#: What a suggested mapping has where a person has to say.
FILL_IN = "FILL_IN"
_REFERENCES = "gauge or absolute, as the transducer's datasheet says"
_OF_CONSTANTS = "gauge or absolute, as the number is meant: {constant: , unit: , reference: gauge}"
_KEYS = frozenset(
    {"signal", "minus", "unit", "scale", "offset", "sign", "wrap", "raw", "span", "time"}
)


@dataclass(frozen=True, slots=True)
class Clock:
    """A signal of the log that holds time.

    Attributes
    ----------
    signal : str
    factor : float
        To seconds.
    late_s : float
        Added: how much later than the log's zero this clock's zero is.
    """

    signal: str
    factor: float
    late_s: float = 0.0

    def seconds(self, recorded: FloatArray) -> FloatArray:
        """The log's time, s, from the recorded numbers.

        Parameters
        ----------
        recorded : (N,) array

        Returns
        -------
        (N,) array
        """
        return np.asarray(self.factor * recorded + self.late_s)


@dataclass(frozen=True, slots=True)
class LogSignal:
    """A signal of the log as a quantity, SI.

    Attributes
    ----------
    signal : str
        Name in the log; empty: a constant, `offset`.
    factor, offset : float
        ``value = factor * (recorded - minus) + offset``; of a pressure: absolute.
    minus : str
        Name in the log of the signal that is taken off first; empty: none is.
    wrap : float
        Period in the recorded numbers that is taken out; 0: none is.
    time : str
        Name in the log of this signal's own clock; empty: the log's.
    """

    signal: str
    factor: float
    offset: float
    minus: str = ""
    wrap: float = 0.0
    time: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Signals of the log that it takes."""
        return tuple(name for name in (self.signal, self.minus) if name)

    def values(self, recorded: FloatArray) -> FloatArray:
        """The quantity from the recorded numbers.

        Parameters
        ----------
        recorded : (N,) array

        Returns
        -------
        (N,) array
        """
        plain = unwrapped(recorded, self.wrap) if self.wrap else recorded
        return np.asarray(self.factor * plain + self.offset)


def unwrapped(recorded: FloatArray, period: float) -> FloatArray:
    """Numbers without the jumps by a period; NaN stays where it is.

    Parameters
    ----------
    recorded : (N,) array
    period : float

    Returns
    -------
    (N,) array
    """
    result = recorded.copy()
    known = np.isfinite(recorded)
    result[known] = np.unwrap(recorded[known], period=period)
    return result


def turns(recorded: FloatArray, period: float) -> int:
    """How often numbers jump by a period.

    Parameters
    ----------
    recorded : (N,) array
    period : float

    Returns
    -------
    int
    """
    known = recorded[np.isfinite(recorded)]
    return int(np.count_nonzero(np.abs(np.diff(known)) > 0.5 * period))


def signal_of(fields: Fields, quantity: str, atmosphere_pa: float) -> LogSignal:
    """Read an entry of the mapping.

    Parameters
    ----------
    fields : Fields
    quantity : str
        Key of `UNITS`.
    atmosphere_pa : float
        Added to gauge pressures.

    Returns
    -------
    LogSignal

    Raises
    ------
    BagError
        Unknown keys or units, or something that is still to be filled in.
    """
    reference = {"reference"} if quantity == "pressure" else set()
    if "constant" in fields:
        no_other_keys(fields, {"constant", "unit"} | reference)
        held = fields.number("constant") * unit_of(fields, quantity)
        held += _reference_pa(fields, quantity, atmosphere_pa)
        return LogSignal("", 0.0, held + _zero(fields, quantity))
    no_other_keys(fields, _KEYS | reference)
    sign = fields.number("sign", 1.0)
    if sign not in (1.0, -1.0):
        raise BagError(f"{fields.where}: 'sign' should be 1 or -1, found {sign:g}")
    offset = fields.number("offset", 0.0) + _reference_pa(fields, quantity, atmosphere_pa)
    scale = sign * fields.number("scale", 1.0)
    if scale == 0.0:
        raise BagError(
            f"{fields.where}: 'scale' should not be 0, which leaves nothing of the signal; what"
            f" was held is {{constant: , unit: {', reference: ' if reference else ''}}}"
        )
    offset += scale * _zero(fields, quantity)
    factor = scale * unit_of(fields, quantity)
    gain, zero = _span(fields)
    return LogSignal(
        signal=filled(fields, "signal"),
        factor=factor * gain,
        offset=offset + factor * zero,
        minus=filled(fields, "minus") if "minus" in fields else "",
        wrap=fields.positive("wrap") if "wrap" in fields else 0.0,
        time=filled(fields, "time") if "time" in fields else "",
    )


def _zero(fields: Fields, quantity: str) -> float:
    """What a reading of zero is in SI, of a temperature; the difference of two has none."""
    if quantity != "temperature" or "minus" in fields:
        return 0.0
    return ZEROS.get(fields.text("unit", next(iter(UNITS[quantity]))), 0.0)


def _reference_pa(fields: Fields, quantity: str, atmosphere_pa: float) -> float:
    if quantity != "pressure":
        return 0.0
    expected = _OF_CONSTANTS if "constant" in fields else _REFERENCES
    if "reference" not in fields:
        raise BagError(f"{fields.where}: key 'reference' is missing, expected {expected}")
    reference = filled(fields, "reference", expected)
    if reference not in ("gauge", "absolute"):
        raise BagError(
            f"{fields.where}: 'reference' should be gauge or absolute, found '{reference}'"
        )
    return atmosphere_pa if reference == "gauge" else 0.0


def _span(fields: Fields) -> tuple[float, float]:
    """Gain and zero of `raw` (what was recorded) to `span` (what it stands for)."""
    if "raw" not in fields and "span" not in fields:
        return 1.0, 0.0
    if "minus" in fields:
        raise BagError(f"{fields.where}: 'raw' and 'span' do not go with 'minus'")
    raw, span = fields.vector("raw", 2), fields.vector("span", 2)
    for key, pair in (("raw", raw), ("span", span)):
        if pair[0] == pair[1]:
            raise BagError(f"{fields.where}: '{key}' should be two different numbers")
    gain = float((span[1] - span[0]) / (raw[1] - raw[0]))
    return gain, float(span[0] - gain * raw[0])


def filled(fields: Fields, key: str, expected: str = "a signal of the log") -> str:
    """A text that a person has filled in.

    Parameters
    ----------
    fields : Fields
    key, expected : str

    Returns
    -------
    str

    Raises
    ------
    BagError
        It still says FILL_IN.
    """
    text = fields.text(key)
    if text == FILL_IN:
        raise BagError(f"{fields.where}: '{key}' is still to be filled in: {expected}")
    return text


#: What a unit is refused of, where its robot says how a joint moves, and where it may belong.
_OF_JOINTS = {
    "angle": (" of a joint that turns", ": the way of its cylinder goes under strokes"),
    "torque": (" of a joint that turns", ": the force of its cylinder is no torque of the joint"),
    "force": (" of a joint that slides", ""),
}


def unit_of(fields: Fields, quantity: str) -> float:
    """Factor of an entry's unit to SI.

    Parameters
    ----------
    fields : Fields
    quantity : str

    Returns
    -------
    float

    Raises
    ------
    BagError
        No unit of that quantity.
    """
    units = UNITS[quantity]
    name = fields.text("unit", next(iter(units)))
    if name == FILL_IN:
        raise BagError(
            f"{fields.where}: 'unit' is still to be filled in: one of {', '.join(units)}"
        )
    if name not in units:
        whose, hint = _OF_JOINTS.get(quantity, ("", ""))
        raise BagError(
            f"{fields.where}: 'unit'{whose} should be one of {', '.join(units)}, found"
            f" '{name}'{hint}"
        )
    return units[name]


#: What is expected where a number is still to be filled in.
_TO_FILL_IN = {
    "rate_hz": "samples per second, or in its place signal: the log's time",
    "late_s": "how much later than the zero of `time` this clock's zero is, s",
    "raw": "two numbers as recorded",
    "span": "the two quantities that raw stands for, as on the transducer's label",
}


def no_other_keys(fields: Fields, allowed: Collection[str]) -> None:
    """Only these keys, and their numbers filled in.

    Parameters
    ----------
    fields : Fields
    allowed : collection of str

    Raises
    ------
    BagError
        There is another, and the message names it and those that are known; or a number still
        says FILL_IN.
    """
    strange = set(fields.keys()) - set(allowed)
    if strange:
        expected, found = ", ".join(sorted(allowed)), min(strange)
        raise BagError(f"{fields.where}: unknown key '{found}' (known: {expected})")
    for key, expected in _TO_FILL_IN.items():
        if key in fields and _open(fields, key):
            raise BagError(f"{fields.where}: '{key}' is still to be filled in: {expected}")


def _open(fields: Fields, key: str) -> bool:
    try:
        return fields.text(key) == FILL_IN
    except RobotError:  # a number
        return False
