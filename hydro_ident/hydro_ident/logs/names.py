"""What columns become; where no robot says which names there are, made of the columns' own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hydro_ident.logs.guess import Reading
from hydro_ident.logs.words import CHAMBER_A, CHAMBER_B, OF_PRESSURES, SUPPLY, TANK, chamber_of


@dataclass(frozen=True, slots=True)
class Target:
    """What a column becomes.

    Attributes
    ----------
    section, name : str
    level : str
    why : tuple of str
    """

    section: str
    name: str
    level: str
    why: tuple[str, ...]


def made_up(section: str, members: Sequence[Reading]) -> dict[str, Target]:
    """Names made of the columns' own, where no robot says which there are.

    Parameters
    ----------
    section : str
    members : sequence of Reading

    Returns
    -------
    dict of str to Target
    """
    found: dict[str, Target] = {}
    for k, reading in enumerate(members, 1):
        words = list(reading.words)
        why = "no robot given: the name is made up"
        if section == "pressures":
            name = _own_chamber(words, k)
        else:
            stem = [w for w in words if len(w) > 1 or w.isdigit()] or [str(k)]
            kind = {"joints": "joint", "strokes": "cylinder"}.get(section, "")
            name = "_".join(stem)
            name = f"{kind or section.rstrip('s')}{name}" if name.isdigit() else name
        if name not in [t.name for t in found.values()]:
            found[reading.column] = Target(section, name, "guess", (why,))
    return found


def _own_chamber(words: Sequence[str], k: int) -> str:
    given = set(words)
    numbers = [int(word) for word in words if word.isdigit()]
    chamber = chamber_of(words)
    if not chamber and not numbers and given & SUPPLY:
        return "supply"
    if not chamber and not numbers and given & TANK:
        return "tank"
    stem = [w for w in words if len(w) > 1 and w not in CHAMBER_A | CHAMBER_B and not w.isdigit()]
    stem = [w for w in stem if w not in OF_PRESSURES]
    if chamber:
        return f"{'_'.join(stem) or f'cylinder{numbers[-1] if numbers else k}'}/{chamber}"
    place = (numbers[-1] if numbers else k) - 1
    return f"cylinder{place // 2 + 1}/{'ab'[place % 2]}"
