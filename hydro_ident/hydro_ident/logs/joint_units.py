"""What a joint's signal measures: of one that turns angles and torques, else ways and forces."""

from __future__ import annotations

from hydro_ident.logs.guess import Reading
from hydro_ident.logs.units import UNITS
from hydro_ident.logs.words import word_set
from hydro_model.robot import Robot

#: Quantity of any joint -> that of one that turns, that of one that slides.
_OF_KIND = {"position": ("angle", "length"), "effort": ("torque", "force")}
#: Words that leave no doubt; `q2` is a joint's of either kind.
SAYS = {
    "angle": word_set("angle ang winkel theta phi pitch inclination neigung angulo angolo"),
    "length": word_set("stroke hub weg len length laenge länge extension course carrera corsa"),
    "torque": word_set("torque moment drehmoment coppia"),
    "force": word_set("force kraft fuerza forza"),
}
_A = {"angle": "an angle", "length": "a length", "torque": "a torque", "force": "a force"}


def quantity_of(quantity: str, joint: str, robot: Robot | None) -> str:
    """What a signal of a joint measures, where its robot is known.

    Parameters
    ----------
    quantity : str
        Of its section: `position`, `effort`, or one that is no joint's.
    joint : str
    robot : Robot or None

    Returns
    -------
    str
        Key of `UNITS`: `angle` or `length`, `torque` or `force`; else as given.
    """
    found = next((j for j in robot.joints if j.name == joint), None) if robot else None
    if found is None or quantity not in _OF_KIND:
        return quantity
    return _OF_KIND[quantity][found.prismatic]


def why_not(reading: Reading, quantity: str, joint: str, robot: Robot | None) -> str:
    """Why a column cannot be a joint's: a way of one that turns, a torque of one that slides.

    Parameters
    ----------
    reading : Reading
    quantity : str
        As of `quantity_of`.
    joint : str
    robot : Robot or None

    Returns
    -------
    str
        Empty where neither its unit nor its words speak against it.
    """
    own = quantity_of(quantity, joint, robot)
    if own == quantity:
        return ""
    unit = reading.unit.unit if reading.unit is not None else ""
    said = {q for q in SAYS if unit in UNITS[q]}
    said = said or {q for q in SAYS if SAYS[q] & {*reading.words}}
    if not said or own in said:
        return ""
    return f"{_A[min(said)]}, and of {joint} it would be {_A[own]}"
