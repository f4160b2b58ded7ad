"""Columns that are no signal of the machine's joints, chambers and valves, by words that say so.

Without them a load pressure would become a chamber's, and a coolant's temperature the oil's, by
being the first of their kind.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

from hydro_ident.logs.words import OF_PRESSURES, SUPPLY, chamber_of, word_set

#: Words for what is asked for.
REFERENCE_WORDS = word_set(
    "ref reference soll sollwert des desired target set setpoint requested consigne consigna"
    " riferimento"
)
#: Words for what a person or a controller asks for: of a valve that is its signal.
COMMANDED_WORDS = word_set("cmd command commanded demand stell")
_BOTH = REFERENCE_WORDS | COMMANDED_WORDS
#: Of which a mapping has no place for what is asked for; French has `des` for "of the".
_ASKED = {"pressure": _BOTH - {"des"}, "temperature": _BOTH - {"des"}, "effort": _BOTH}
_OTHER = {
    "pressure": word_set(
        "differential difference delta diff differenz differenzdruck load last lastdruck ls"
        " loadsensing pilot steuer steuerdruck accumulator speicher speicherdruck ambient"
        " atmospheric atm umgebung umgebungsdruck luftdruck bremsdruck solldruck"
    ),
    "angle": word_set("pump pumpe pompe bomba pompa swash"),
    "temperature": word_set(
        "ambient umgebung umgebungstemperatur air luft lufttemperatur coolant water wasser"
        " kühlmittel kühlmitteltemperatur kuehlmitteltemperatur motor engine motortemperatur"
        " cpu board ambiante ambiente aria"
    ),
    "voltage": frozenset(word for word in SUPPLY if len(word) > 2)
    | word_set("battery batterie bat batt ubat vbat akku bordnetz versorgungsspannung"),
}
_WHAT = {
    "angle": "an angle of something else than a joint",
    "pressure": "a pressure of something else than a chamber or a line",
    "temperature": "a temperature of something else than the oil",
    "voltage": "a voltage of something else than a valve",
}
_COILS = word_set("valve ventil servo coil solenoid spule magnet vanne valvula valvola")


def elsewhere(quantity: str, words: Sequence[str], own: Collection[str], *, unit: bool) -> str:
    """Why a column is no signal of the machine's joints, chambers and valves.

    Parameters
    ----------
    quantity : str
    words : sequence of str
        Of its name.
    own : collection of str
        Words of the robot's names, which always mean the machine.
    unit : bool
        Whether the file gives a unit.

    Returns
    -------
    str
        Empty where nothing says so.
    """
    if quantity == "current" and not unit and not {*words} & (_COILS | OF_PRESSURES | {*own}):
        return "not taken: a current that no word calls a valve's"
    asked = ({*words} & _ASKED.get(quantity, frozenset())) - {*own}
    if asked:
        return f"not taken: '{min(asked)}' says what was asked for and not what was measured"
    said = ({*words} & _OTHER.get(quantity, frozenset())) - {*own}
    if not said or (quantity == "pressure" and chamber_of(words)):
        return ""
    return f"not taken: '{min(said)}' says {_WHAT[quantity]}"
