"""Words that columns' names have for chambers, lines and motions, and German compounds of them.

A compound is parted only where the whole of it says which chamber, line or signal is meant: of
`Ringleitung`, the supply's, `Ring` alone would make a rod's side, and of `Differenzdruck` a part
alone any pressure.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Sequence


def word_set(text: str) -> frozenset[str]:
    """Words of a text, apart.

    Parameters
    ----------
    text : str
    """
    return frozenset(text.split())


CHAMBER_A = word_set("a piston kolben bore head cap ks pistone embolo fond fondello fondo")
CHAMBER_B = word_set("b rod stange annulus ring rs tige vastago stelo annulaire anular anulare")
SUPPLY = word_set(
    "s supply pump pumpe sys system versorgung ps pp"
    " pompe alimentation bomba alimentacion pompa alimentazione"
)
TANK = word_set(
    "t tank return ruecklauf rücklauf pt reservoir retour tanque retorno serbatoio ritorno"
)
#: Words of pressures, beside a current those of transducers.
OF_PRESSURES = word_set("p press pressure druck pression presion pressione")
#: Words for what was measured, beside what was asked for.
MEASURED = word_set(
    "ist act actual meas measured applied state fb feedback mesure medido misurato"
)
#: Words of every name of their kind: they tell nothing apart.
COMMON = word_set(
    "cylinder cyl zylinder valve ventil joint link gelenk"
    " verin vanne cilindro valvula articulacion valvola giunto"
)
#: Words for the same motion. Those that also name an inclination (`Neigung`) or any link are not
#: among them, and none is more than likely: machines differ in what they call a boom.
_ALIKE = tuple(
    frozenset(words.split())
    for words in (
        "lift hub heb heben",
        "tilt kipp kippen",
        "boom ausleger fleche pluma",
        "arm stick dipper stiel bras brazo",
        "bucket löffel loeffel godet cazo benna",
        "slew swing schwenk schwenken",
        "telescope teleskop",
    )
)
MOTIONS = frozenset[str]().union(*_ALIKE)
_MOTIONS = "hub|heb|kipp|ausleger|stiel|arm|löffel|loeffel|schwenk|teleskop"

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
    (re.compile("(?:zylinder|kolben)(weg|hub|kraft)"), "zylinder"),
    (re.compile("schieber(weg|hub|position|stellung)"), "schieber"),
    (re.compile("ventil(spannung|strom)"), "ventil"),
    (re.compile("(?:öl|oel)(temperatur)"), "öl"),
]
#: What is parted into the motion and what is measured there.
_OF_MOTIONS = re.compile(f"({_MOTIONS})(zylinder|ventil)?(druck|winkel|weg|kraft)?")


_UMLAUTS = "äöüÄÖÜß"


def words_in(text: str) -> tuple[str, ...]:
    """Words and numbers of a text, lower case, compounds apart.

    Parameters
    ----------
    text : str
        Without a unit.

    Returns
    -------
    tuple of str
        Accents are left out, umlauts are not.

    Examples
    --------
    >>> words_in("pA_lift"), words_in("Tankdruck 12")
    (('p', 'a', 'lift'), ('tank', 'druck', '12'))
    """
    # Programs of controllers call an instance of a function block so: `fbLift`, no feedback.
    text = re.sub(r"\bfb(?=[A-ZÄÖÜ])", "", text)
    parts = re.findall(r"[A-ZÄÖÜ]?[a-zäöüß]+|[A-ZÄÖÜ]+(?![a-zäöüß])|\d+", _plain(text))
    return tuple(word for part in parts for word in parts_of(part.lower()))


def _plain(name: str) -> str:
    whole = unicodedata.normalize("NFC", name)
    return "".join(c if c in _UMLAUTS else unicodedata.normalize("NFD", c)[0] for c in whole)


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
    if (match := _OF_MOTIONS.fullmatch(word)) is not None:
        return tuple(part for part in match.groups() if part)
    return (word,)


def chamber_of(words: Sequence[str]) -> str:
    """The chamber that a name says.

    Parameters
    ----------
    words : sequence of str

    Returns
    -------
    str
        `a`, `b`, or empty where it says none, or both.

    Examples
    --------
    >>> chamber_of(["piston", "side"]), chamber_of(["piston", "rod", "side"]), chamber_of(["p"])
    ('a', 'b', '')
    """
    text = " ".join(words).replace("piston rod", "rod").split()
    said = [bool(CHAMBER_A.intersection(text)), bool(CHAMBER_B.intersection(text))]
    return {(True, False): "a", (False, True): "b"}.get((said[0], said[1]), "")


def alike(words: Collection[str], own: Collection[str]) -> str:
    """The word for a motion that a name has in another language than its robot.

    Parameters
    ----------
    words : collection of str
        Of the name.
    own : collection of str
        Of the robot's name.

    Returns
    -------
    str
        Empty where there is none.
    """
    known = frozenset[str]().union(*(group for group in _ALIKE if group.intersection(own)))
    return min(known.intersection(words), default="")
