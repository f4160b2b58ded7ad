"""Which joint, chamber or valve a column belongs to, by the words and numbers of its name."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hydro_ident.logs.guess import Reading, words_of
from hydro_ident.logs.joint_units import quantity_of, why_not
from hydro_ident.logs.map import SECTIONS
from hydro_ident.logs.names import Target, made_up
from hydro_ident.logs.units import UNITS
from hydro_ident.logs.words import COMMON, MEASURED, SUPPLY, TANK, alike, chamber_of, word_set
from hydro_model.arrays import FloatArray
from hydro_model.robot import Joint, Robot

_NAME, _ALIKE, _NUMBER, _CHAMBER = 4.0, 2.5, 2.0, 1.0
_OIL = word_set("oil öl oel huile aceite olio")
_SUPPLY_PA, _RATED_V = 2e7, 10.0
#: Share of a joint's range by which it may be recorded beyond its ends.
MARGIN = 0.02


class Targets:
    """The names that columns can have.

    Parameters
    ----------
    robot : Robot, optional
        Without one names are made of the columns' own.

    Attributes
    ----------
    robot
        As given.
    """

    def __init__(self, robot: Robot | None) -> None:
        self.robot = robot

    @property
    def supply_pa(self) -> float:
        """Supply pressure that readings are held against."""
        return _SUPPLY_PA if self.robot is None else self.robot.supply_pressure_pa

    def rated_v(self, valve: str) -> float:
        """Rated signal of a valve.

        Parameters
        ----------
        valve : str
        """
        valves = self.robot.valves if self.robot is not None else ()
        return next((v.rated_voltage_v for v in valves if v.name == valve), _RATED_V)

    def has_range(self, joint: str) -> bool:
        """Whether a joint's limits are known.

        Parameters
        ----------
        joint : str
        """
        return self._range_of(joint) is not None

    def _range_of(self, joint: str) -> Joint | None:
        """The joint, where it has limits that are finite."""
        joints = self.robot.joints if self.robot is not None else ()
        found = next((j for j in joints if j.name == joint), None)
        if found is None or not math.isfinite(found.upper - found.lower):
            return None
        return found

    def share_inside(self, joint: str, values: FloatArray, unit: str) -> float:
        """Share of an angle's samples within the joint's limits.

        Parameters
        ----------
        joint : str
        values : (N,) array
        unit : str

        Returns
        -------
        float
            0 where no limits are known.
        """
        limits = self._range_of(joint)
        known = values[np.isfinite(values)] * UNITS["position"][unit]
        if limits is None or not len(known):
            return 0.0
        margin = MARGIN * (limits.upper - limits.lower)
        inside = (known >= limits.lower - margin) & (known <= limits.upper + margin)
        return float(inside.mean())

    def whole_turns(self, joint: str, values: FloatArray, turn: float) -> FloatArray:
        """An unwrapped angle, by whole turns nearest to the middle of its joint's range.

        Parameters
        ----------
        joint : str
        values : (N,) array
        turn : float
            In the values' own unit: 360, or 2 pi.

        Returns
        -------
        (N,) array
        """
        limits = self._range_of(joint)
        if limits is None:
            return values
        middle = 0.5 * (limits.lower + limits.upper) * turn / (2.0 * math.pi)
        return values + turn * round((middle - float(np.nanmedian(values))) / turn)

    def names(self, section: str) -> tuple[str, ...]:
        """The robot's names of a section.

        Parameters
        ----------
        section : str

        Returns
        -------
        tuple of str
            Empty without a robot.
        """
        if self.robot is None or section == "oil_temperature":
            return ()
        if section == "pressures":
            return tuple(self.robot.pressure_names) if self.robot.cylinders else ()
        if section == "strokes":
            return tuple(c.name for c in self.robot.cylinders)
        if section in ("valves", "valve_commands", "spools"):
            return tuple(self.robot.valve_names)
        return tuple(self.robot.joint_names)

    def assign(self, columns: Mapping[str, tuple[str, Reading]]) -> dict[str, Target]:
        """Give columns their names, best fits first, each name once in its section.

        Parameters
        ----------
        columns : mapping of str to (str, Reading)
            Section and reading by column.

        Returns
        -------
        dict of str to Target
            Columns that got none are absent.
        """
        found: dict[str, Target] = {}
        for section in dict.fromkeys(section for section, _ in columns.values()):
            members = [r for s, r in columns.values() if s == section]
            if section == "oil_temperature":
                best = max(members, key=lambda r: bool(_OIL.intersection(r.words)))
                level = "sure" if _OIL.intersection(best.words) else "likely"
                found[best.column] = Target(section, "", level, ())
            elif section not in ("", "left out"):
                free = self.robot is None
                found |= made_up(section, members) if free else self._fit(section, members)
        return found

    def _fit(self, section: str, members: Sequence[Reading]) -> dict[str, Target]:
        names = self.names(section)
        scores = [
            (*self._score(section, r, name, members), r.column, name)
            for r in members
            for name in names
            if not self._why_not(section, r, name)
        ]
        measured = {r.column for r in members if MEASURED & {*r.words}}
        # Stable: what scores alike keeps the order of the columns.
        scores.sort(key=lambda entry: (-entry[0], entry[2] not in measured))
        found: dict[str, Target] = {}
        taken: set[str] = set()
        for score, why, column, name in scores:
            if column in found or name in taken or score <= 0.0:
                continue
            taken.add(name)
            level = "sure" if score >= _NAME else "likely" if score > _NUMBER else "guess"
            found[column] = Target(section, name, level, (why,))
        left = [n for n in names if n not in taken and n not in ("supply", "tank")]
        for reading in (r for r in members if r.column not in found):
            name = next((n for n in left if self._may_be(section, reading, n)), "")
            if name:
                left.remove(name)
                by_place = Target(section, name, "guess", (f"{name}: only by its place",))
                found[reading.column] = by_place
        return found

    def _may_be(self, section: str, reading: Reading, name: str) -> bool:
        """Whether nothing in a column's name speaks against a name that it has by its place."""
        if self._why_not(section, reading, name):
            return False
        body, _, chamber = name.partition("/")
        others = {n.partition("/")[0] for n in self.names(section)} - {body}
        if any(self._called(section, reading, other)[1] for other in others):
            return self._called(section, reading, body)[1] != ""
        if not chamber or chamber_of(reading.words):
            return chamber_of(reading.words) in ("", chamber)
        return not any(len(w) > 2 and w in SUPPLY | TANK for w in reading.words)

    def _why_not(self, section: str, reading: Reading, name: str) -> str:
        """Why a column cannot be the signal of a joint; empty where it can."""
        return why_not(reading, SECTIONS.get(section, ""), name, self.robot)

    def why_unnamed(self, section: str, reading: Reading) -> str:
        """Why a column got no name of its section.

        Parameters
        ----------
        section : str
        reading : Reading
        """
        names = self.names(section)
        if self.robot is not None and not names:
            return f"{section}: {self.robot.name} has none"
        called = [n for n in names if self.is_called(section, reading, n)] or names
        why = [self._why_not(section, reading, n) for n in called]
        return f"{section}: {why[0] if why and all(why) else 'no name is left for it'}"

    def is_called(self, section: str, reading: Reading, body: str) -> bool:
        """Whether a column is called by a name of a section, or by another word for it.

        Parameters
        ----------
        section : str
        reading : Reading
        body : str
            Without a chamber.
        """
        return bool(self._called(section, reading, body)[1])

    def quantity_of(self, section: str, name: str) -> str:
        """What a signal of a section measures, as of `logs.joint_units`.

        Parameters
        ----------
        section, name : str
        """
        return quantity_of(SECTIONS[section], name, self.robot)

    def _called(self, section: str, reading: Reading, body: str) -> tuple[float, str]:
        """How well a column is called by a name or by another word for it, and the word."""
        own, words = set(words_of(body)) - COMMON, set(reading.words)
        if hit := (words & own) - {word for word in own if len(word) < 2}:
            return _NAME, min(hit)
        # A stroke is `Hub`, whichever cylinder's.
        word = alike(words - {"hub"} if section == "strokes" else words, own)
        return (_ALIKE if word else 0.0), word

    def words(self) -> frozenset[str]:
        """Words of the robot's own names, without those that every name has."""
        sections = ("joints", "strokes", "valves") if self.robot is not None else ()
        names = [name for section in sections for name in self.names(section)]
        return frozenset(word for name in names for word in words_of(name)) - COMMON

    def _score(
        self, section: str, reading: Reading, name: str, members: Sequence[Reading]
    ) -> tuple[float, str]:
        numbers = [int(word) for word in reading.words if word.isdigit()]
        if section == "pressures" and "/" not in name:
            # `pP` and `pS` are the supply: the first p says no more than pressure.
            rest = set(reading.words[1:] if reading.words[:1] == ("p",) else reading.words)
            hit = rest & ((SUPPLY | {"p"}) if name == "supply" else TANK)
            # `lift_p` is a cylinder's.
            plain = not (numbers or chamber_of(reading.words) or rest & self.words())
            plain = plain and bool(hit)
            return (_NAME if plain else 0.0), f"{name}: '{min(hit, default='')}'"
        body, _, chamber = name.partition("/")
        index = self._index(section, body)
        letter = _CHAMBER if chamber and chamber_of(reading.words) == chamber else 0.0
        if chamber and not letter:
            return self._by_order(reading, members, numbers, index, chamber, name)
        called, word = self._called(section, reading, body)
        if word:
            return called + letter, f"{name}: '{word}'"
        if numbers and numbers[-1] - self._first(members) == index:
            # As many columns as names, all counted: no accident.
            whole = 0.5 if len(members) == len(self.names(section)) else 0.0
            return _NUMBER + letter + whole, f"{name}: number {numbers[-1]}"
        return 0.0, ""

    def _by_order(
        self,
        reading: Reading,
        members: Sequence[Reading],
        numbers: Sequence[int],
        index: int,
        chamber: str,
        name: str,
    ) -> tuple[float, str]:
        """p1, p2, p3, p4: chambers a and b of the first cylinder, then of the next."""
        if not numbers or any(chamber_of(r.words) for r in members):
            return 0.0, ""
        place = numbers[-1] - self._first(members)
        return (0.5 * _NUMBER if place == 2 * index + (chamber == "b") else 0.0), (
            f"{name}: number {numbers[-1]} of chambers counted a, b, a, b"
        )

    def _index(self, section: str, body: str) -> int:
        names = [name.partition("/")[0] for name in self.names(section)]
        return list(dict.fromkeys(names)).index(body)

    @staticmethod
    def _first(members: Sequence[Reading]) -> int:
        """Where the columns' own count begins: at 0 or at 1."""
        numbers = [int(w) for r in members for w in r.words if w.isdigit()]
        return 0 if 0 in numbers else 1
