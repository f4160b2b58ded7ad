"""What a bag says of how its readings came about, and whether bags of one result agree on it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hydro_model.description.safe_yaml import UnusableYamlError, parse
from hydro_model.errors import printable

#: Files between a sensor and its readings: with another one they are others.
_OF_READINGS = ("calibration", "mapping", "dbc")
#: What makes no reading another one: the name of a file, how it was measured, a log's own clock.
_NO_MATTER = ("name", "notes", "time", "start")
#: Longest text that is told as it is, longest value in a difference, and differences told.
_SHORT, _VALUE, _TOLD = 200, 40, 3


@dataclass(frozen=True, slots=True)
class RecordedWith:
    """A text that a bag keeps beside its messages.

    Attributes
    ----------
    key : str
        `calibration`, `mapping`, `note` ...
    name : str
        The text where it is short, else the name that it gives itself; may be empty.
    sha256 : str
        Of the text; empty where `name` is all of it.
    """

    key: str
    name: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Apart:
    """A bag that was recorded with something else than the first one.

    Attributes
    ----------
    bag, key, text : str
        Which, with what, and how that differs.
    """

    bag: str
    key: str
    text: str


def recorded_with(metadata: Mapping[str, str]) -> tuple[RecordedWith, ...]:
    """What a bag keeps beside its messages, but for the robot's name.

    Parameters
    ----------
    metadata : mapping of str to str
        The project's own.
    """
    kept = {key: text for key, text in metadata.items() if key != "robot" and text}
    return tuple(_told(key, text) for key, text in kept.items())


def _told(key: str, text: str) -> RecordedWith:
    if len(text) <= _SHORT and "\n" not in text:
        return RecordedWith(printable(key), printable(text), "")
    top = _parsed(text)
    name = (top.get("name") if isinstance(top, dict) else None) or ""
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
    return RecordedWith(printable(key), _shown(name), digest)


def recorded_apart(bags: Sequence[tuple[str, Mapping[str, str]]]) -> tuple[Apart, ...]:
    """Bags whose readings came about in another way than those of the first that says how.

    Parameters
    ----------
    bags : sequence of pair of str and mapping
        Name and metadata.

    Returns
    -------
    tuple of Apart
        A bag that does not say with which calibration it was recorded is told, too, where another
        one does: nobody else knows whether it had one.
    """
    found = []
    for key in _OF_READINGS:
        says = [(name, metadata[key]) for name, metadata in bags if metadata.get(key)]
        for name, metadata in bags if says else ():
            first, text = says[0]
            if metadata.get(key):
                different = _difference(metadata[key], text)
                told = different and f"another one than {first} was recorded with: {different}"
            else:
                told = f"not said which; {first} says it" if key == "calibration" else ""
            found += [Apart(name, key, told)] if told else []
    return tuple(found)


def _difference(text: str, first: str) -> str:
    """In words, what one file says and another one does not; empty where that is nothing."""
    if text == first:
        return ""
    tops = [_parsed(one) for one in (text, first)]
    if not all(isinstance(top, dict) for top in tops):
        return "another text"
    own, other = (dict(_leaves(top)) for top in tops)
    places = [at for at in {**other, **own} if own.get(at) != other.get(at)]
    places = [at for at in places if at.split(".")[0] not in _NO_MATTER]
    told = [
        f"{printable(at)} {_shown(own.get(at))} instead of {_shown(other.get(at))}"
        for at in places[:_TOLD]
    ]
    more = len(places) - len(told)
    return ", ".join(told) + (f" and {more} more" if more else "")


def _parsed(text: str) -> Any:
    """A YAML text as plain values; None where it is none."""
    try:
        return parse(text)
    except UnusableYamlError:
        return None


def _leaves(value: Any, at: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict | list) and value:
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, inner in pairs:
            yield from _leaves(inner, f"{at}.{key}" if at else str(key))
    else:
        yield at, value


def _shown(value: Any) -> str:
    if value is None:
        return "none"
    text = printable(f"{value:.6g}" if isinstance(value, float) else str(value))
    return text if len(text) <= _VALUE else f"{text[: _VALUE - 3]}..."
