"""A YAML mapping read key by key, each with its type checked and its place in the message."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from difflib import get_close_matches
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from hydro_model.errors import RobotError
from hydro_model.robot import FloatArray

_REQUIRED: Any = object()
#: Share of letters in common from which a key is taken for another one, misspelt.
_ALIKE = 0.8
# Aliases may nest to a size that no message should try to print.
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxdict = 2, 3, 3


def _no_path(text: str) -> bool:
    """Whether no file can have this name."""
    parts = PurePath(text).parts
    return not text.isprintable() or any(len(part.encode()) > 255 for part in parts)


class Fields:
    """Typed access to one mapping of a description file.

    Parameters
    ----------
    data : mapping
        What the YAML parser returned.
    where : str
        File and place, for messages.

    Raises
    ------
    RobotError
        From every reader: a required key is absent or a value has the wrong type.
    """

    def __init__(self, data: Mapping[str, Any], where: str) -> None:
        self._data = data
        self.where = where
        self._known = set[str]()

    def __contains__(self, key: str) -> bool:
        self._known.add(key)
        return key in self._data

    def keys(self) -> tuple[str, ...]:
        """The keys that are there."""
        return tuple(str(key) for key in self._data)

    def check_spelling(self) -> None:
        """Refuse keys that nobody asked for and that look like one that was asked for in vain.

        Others are somebody else's and left alone. To be called when all has been read.
        """
        absent = self._known.difference(self.keys())
        for key in self.keys():
            if key in self._known:
                continue
            meant = [known for known in sorted(absent) if known.startswith(f"{key}_")]
            meant += get_close_matches(key, sorted(absent), 1, _ALIKE)
            if meant:
                raise RobotError(f"{self.where}: unknown key '{key}', did you mean '{meant[0]}'?")

    def check_known(self) -> None:
        """Refuse every key that nobody asked for; misspelt ones as `check_spelling` does.

        For mappings in which nobody else has keys. To be called when all has been read.
        """
        self.check_spelling()
        unknown = [key for key in self.keys() if key not in self._known]
        if unknown:
            raise RobotError(
                f"{self.where}: unknown key '{unknown[0]}', expected"
                f" {', '.join(sorted(self._known))}"
            )

    def _get(self, key: str, default: Any, expected: str) -> Any:
        self._known.add(key)
        if key in self._data:
            return self._data[key]
        if default is _REQUIRED:
            raise RobotError(f"{self.where}: key '{key}' is missing, expected {expected}")
        return default

    def _wrong(self, key: str, expected: str, value: object) -> RobotError:
        found = _SHORT.repr(value)
        found = found if len(found) <= 60 else found[:57] + "..."
        if isinstance(value, date):  # a datetime is one, too
            found = f"the date {value}: YAML makes one of it where it stands without quotes"
            if expected == "a text":
                found += f', write "{value}"'
        return RobotError(f"{self.where}: '{key}' should be {expected}, found {found}")

    def text(self, key: str, default: str = _REQUIRED) -> str:
        """A non-empty string."""
        value = self._get(key, default, "a text")
        if not isinstance(value, str) or not value:
            raise self._wrong(key, "a text", value)
        return value

    def name(self, key: str) -> str:
        """A text that may become part of a file's name: one line, no `/`, no leading dot."""
        value = self.text(key)
        leads_away = value[0] == "." or "/" in value or "\\" in value
        if leads_away or not value.isprintable() or len(value) > 200:
            raise self._wrong(key, "a name without '/', '\\' and a dot in front", value)
        return value

    def file(self, key: str, source: Path) -> Path:
        """A file of the user's choice, relative to the folder of `source`, the naming file."""
        value = self.text(key)
        wanted = f"a file, named relative to {source.parent} or by its whole path"
        if _no_path(value):
            raise self._wrong(key, wanted, value)
        return source.parent / value

    def file_below(self, key: str, source: Path) -> Path:
        """A file in or below the folder of the file that names it: no name or link leads out.

        `source` is the naming file. It may be a link itself, as what `colcon build
        --symlink-install` leaves in `share`: then the folder that it points into counts, too.
        """
        value = self.text(key)
        named = PurePath(value)
        folder = source.parent
        leads_away = named.is_absolute() or ".." in named.parts
        wanted = f"a file in or below {folder}, named relative to it"
        if leads_away or _no_path(value):
            raise self._wrong(key, wanted, value)
        try:
            target = (folder / named).resolve()
            homes = (folder.resolve(), source.resolve().parent)
        except (OSError, RuntimeError):  # links that lead in a circle
            raise self._wrong(key, wanted, value) from None
        if not any(target.is_relative_to(home) for home in homes):
            raise self._wrong(key, f"{wanted}, and no link out of it", value)
        return folder / named

    def flag(self, key: str, default: bool = _REQUIRED) -> bool:
        """true or false."""
        value = self._get(key, default, "true or false")
        if not isinstance(value, bool):
            raise self._wrong(key, "true or false", value)
        return value

    def number(self, key: str, default: float = _REQUIRED) -> float:
        """A finite number; YAML 1.1 reads `1e6` as a text, which is accepted too."""
        value = self._get(key, default, "a number")
        return self._number(key, value)

    def _number(self, key: str, value: object) -> float:
        if isinstance(value, str):
            try:
                value = float(value)
            except ValueError:
                raise self._wrong(key, "a number", value) from None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._wrong(key, "a number", value)
        try:
            number = float(value)
        except OverflowError:  # an integer beyond what a float holds
            number = math.inf
        if not math.isfinite(number):
            raise self._wrong(key, "a finite number", value)
        return number

    def positive(self, key: str, default: float = _REQUIRED) -> float:
        """A finite number above zero."""
        value = self.number(key, default)
        if value <= 0.0:
            raise self._wrong(key, "a number above 0", value)
        return value

    def not_negative(self, key: str, default: float = _REQUIRED) -> float:
        """A finite number of zero or more."""
        value = self.number(key, default)
        if value < 0.0:
            raise self._wrong(key, "a number of 0 or more", value)
        return value

    def vector(self, key: str, size: int, default: Sequence[float] = _REQUIRED) -> FloatArray:
        """An array of `size` finite numbers."""
        value = self._get(key, default, f"{size} numbers")
        if not isinstance(value, list | tuple) or len(value) != size:
            raise self._wrong(key, f"{size} numbers", value)
        return np.array([self._number(key, v) for v in value])

    def numbers(self, key: str) -> list[float]:
        """A list of finite numbers of any length."""
        value = self._get(key, _REQUIRED, "a list of numbers")
        if not isinstance(value, list | tuple):
            raise self._wrong(key, "a list of numbers", value)
        return [self._number(key, v) for v in value]

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of non-empty strings."""
        value = self._get(key, _REQUIRED, "a list of texts")
        if not isinstance(value, list) or not all(isinstance(v, str) and v for v in value):
            raise self._wrong(key, "a list of texts", value)
        return tuple(value)

    def rows(self, key: str) -> list[list[float]]:
        """A list of lists of finite numbers, which may differ in length."""
        value = self._get(key, _REQUIRED, "a list of rows of numbers")
        if not isinstance(value, list):
            raise self._wrong(key, "a list of rows of numbers", value)
        names = [f"{key}[{index}]" for index in range(len(value))]
        whole = Fields(dict(zip(names, value, strict=True)), self.where)
        return [whole.numbers(name) for name in names]

    def matrix(self, key: str, shape: tuple[int, int]) -> FloatArray:
        """A matrix of finite numbers, row by row; `shape` says how many rows and columns."""
        rows = self._get(key, _REQUIRED, f"a {shape[0]} x {shape[1]} matrix")
        if not isinstance(rows, list) or len(rows) != shape[0]:
            raise self._wrong(key, f"{shape[0]} rows", rows)
        return np.array(
            [Fields({key: row}, self.where).vector(key, shape[1]) for row in rows]
        ).reshape(shape)

    def mapping_of_numbers(self, key: str) -> dict[str, float]:
        """A mapping from names to finite numbers."""
        value = self._get(key, _REQUIRED, "a mapping of names to numbers")
        if not isinstance(value, dict):
            raise self._wrong(key, "a mapping of names to numbers", value)
        return {str(name): self._number(f"{key}.{name}", v) for name, v in value.items()}

    def fields(self, key: str, default: Mapping[str, Any] = _REQUIRED) -> Fields:
        """A nested mapping."""
        value = self._get(key, default, "a mapping")
        if not isinstance(value, dict):
            raise self._wrong(key, "a mapping", value)
        return Fields(value, f"{self.where}, {key}")

    def optional_fields(self, key: str) -> Fields | None:
        """A nested mapping, or None where the key is absent or null."""
        self._known.add(key)
        return None if self._data.get(key) is None else self.fields(key)

    def items(self, key: str) -> Iterator[Fields]:
        """The mappings of a list; none where the key is absent, or nothing stands behind it."""
        value = self._get(key, [], "a list")
        value = [] if value is None else value
        if not isinstance(value, list):
            raise self._wrong(key, "a list", value)
        for index, item in enumerate(value):
            if not isinstance(item, dict):
                raise self._wrong(f"{key}[{index}]", "a mapping", item)
            name = item.get("name")
            label = name if isinstance(name, str) else index
            yield Fields(item, f"{self.where}, {key}[{label}]")
