"""Words that columns' names have for chambers and lines, and German ones that are written as one.

A compound is parted only where the whole of it says which chamber, line or signal is meant: of
`Ringleitung`, the supply's, `Ring` alone would make a rod's side, and of `Differenzdruck` a part
alone any pressure.
"""

from __future__ import annotations

import re

CHAMBER_A = frozenset(["a", "piston", "kolben", "bore", "head", "cap", "ks"])
CHAMBER_B = frozenset(["b", "rod", "stange", "annulus", "ring", "rs"])
SUPPLY = frozenset(["s", "supply", "pump", "pumpe", "sys", "system", "versorgung", "ps", "pp"])
TANK = frozenset(["t", "tank", "return", "ruecklauf", "rücklauf", "pt"])
#: Words of every name of their kind: they tell nothing apart.
COMMON = frozenset(["cylinder", "cyl", "zylinder", "valve", "ventil", "joint", "link", "gelenk"])

_SIDE, _LINE = "(?:seiten?|raum|kammer)", "(?:leitungs?)"
#: Places where pressures are measured, by the word that says which.
_SIDES = {
    "kolben": f"kolben{_SIDE}",
    "stange": f"(?:kolben)?stangen?{_SIDE}",
    "ring": f"ring{_SIDE}",
}
_LINES = {
    "versorgung": f"versorgungs?{_LINE}?",
    "pumpe": f"pumpen?{_LINE}?",
    "system": "systems?",
    "tank": f"tank{_LINE}?",
    "rücklauf": f"r(?:ü|ue)cklauf{_LINE}?",
}
_OTHERS = {
    "kolben": "kolben",
    "stange": "(?:kolben)?stangen?",
    "zylinder": "zylinder(?:kammer)?",
    **{word: word for word in ("supply", "pump", "return", "piston", "rod")},
}
#: What compounds are parted into, by their pattern.
_COMPOUNDS = [
    *(
        (re.compile(f"{place}(druck|pressure)"), word)
        for places in (_SIDES, _LINES, _OTHERS)
        for word, place in places.items()
    ),
    *((re.compile(place), word) for word, place in _SIDES.items()),
    *((re.compile(f"{word}(winkel)"), word) for word in ("gelenk", "ist", "soll")),
    (re.compile("(?:zylinder|kolben)(weg|hub)"), "zylinder"),
    (re.compile("ventil(spannung)"), "ventil"),
    (re.compile("(?:öl|oel)(temperatur)"), "öl"),
]


def parts_of(word: str) -> tuple[str, ...]:
    """The words that a compound is made of, as far as they mean something.

    Parameters
    ----------
    word : str
        Lower case.

    Returns
    -------
    tuple of str
        The word itself where it is none, or one that is not known whole.

    Examples
    --------
    >>> parts_of("versorgungsdruck"), parts_of("differenzdruck")
    (('versorgung', 'druck'), ('differenzdruck',))
    """
    for pattern, first in _COMPOUNDS:
        if (match := pattern.fullmatch(word)) is not None:
            return (first, *match.groups())
    return (word,)
