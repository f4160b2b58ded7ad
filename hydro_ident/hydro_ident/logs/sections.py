"""Which section of a mapping takes a column, or why none does."""

from __future__ import annotations

from collections.abc import Iterable

from hydro_ident.logs.elsewhere import COMMANDED_WORDS, REFERENCE_WORDS, elsewhere
from hydro_ident.logs.guess import Reading
from hydro_ident.logs.joint_units import SAYS
from hydro_ident.logs.names import Target
from hydro_ident.logs.targets import Targets
from hydro_ident.logs.words import MEASURED, OF_PRESSURES, word_set

#: Of a slide, too, these are its cylinder's.
_STROKES = word_set(
    "stroke hub course carrera corsa kolben piston cylinder cyl zylinder verin cilindro"
)
_SPOOLS = word_set("spool schieber kolbenschieber lvdt")
_VALVE_NAMES = word_set("valve ventil vanne valvula valvola")
_VALVES = _VALVE_NAMES | word_set("u joystick servo pwm")
#: Of a valve, for where its spool is.
_PLACES = word_set("position pos opening öffnung oeffnung ouverture apertura stellung weg")
#: Words of what sensors measure that read in volts or ampere.
_OF_SENSORS = {
    "ratio": _SPOOLS,
    "angle": SAYS["angle"],
    "length": SAYS["length"] - {"hub"},
    "effort": SAYS["torque"] | SAYS["force"],
    "temperature": word_set("temp temperature temperatur temperatura"),
}


def section_of(reading: Reading, targets: Targets) -> str:
    """Section of the mapping that takes a column.

    Parameters
    ----------
    reading : Reading
    targets : Targets

    Returns
    -------
    str
        `left out` where none does.
    """
    words = set(reading.words)
    quantity = _of_machine(reading)
    if _elsewhere(reading, targets):
        return "left out"
    if quantity in ("angle", "length") and words & (REFERENCE_WORDS | COMMANDED_WORDS):
        return "references"
    if quantity == "length":
        return _of_length(reading, targets)
    if quantity == "voltage":
        return "valves" if words & MEASURED else "valve_commands"
    if quantity == "ratio":
        return _of_share(reading, targets)
    return {
        "angle": "joints",
        "pressure": "pressures",
        "current": "valve_commands",
        "temperature": "oil_temperature",
        "effort": "efforts",
    }.get(quantity, "left out")


def why_left_out(reading: Reading, targets: Targets) -> tuple[str, ...]:
    """Why no section takes a column.

    Parameters
    ----------
    reading : Reading
    targets : Targets

    Returns
    -------
    tuple of str
        What speaks for its quantity, then why that is not taken.
    """
    if why := _elsewhere(reading, targets):
        return (*reading.why, why)
    if reading.quantity in ("velocity", "acceleration"):
        return (*reading.why, "not taken: the analysis differentiates positions itself")
    if reading.quantity == "ratio":
        return (*reading.why, "not taken: a share that no word calls a spool's or a valve's")
    return reading.why


def missing_of(given: Iterable[Target], targets: Targets) -> tuple[str, ...]:
    """What the robot has and no column became.

    Parameters
    ----------
    given : iterable of Target
        What columns became.
    targets : Targets

    Returns
    -------
    tuple of str
    """
    robot, found = targets.robot, {(t.section, t.name) for t in given}
    if robot is None:
        return ()
    driven = {c.joint: c.name for c in robot.cylinders}
    lost = [
        f"joints, {j.name}"
        for j in robot.joints
        if not {("joints", j.name), ("strokes", driven.get(j.name, ""))} & found
    ]
    pressures, valves = targets.names("pressures"), targets.names("valves")
    lost += [f"pressures, {n}" for n in pressures if ("pressures", n) not in found]
    lost += [f"valves, {n}" for n in valves if not {("valves", n), ("valve_commands", n)} & found]
    return tuple(lost)


def _of_length(reading: Reading, targets: Targets) -> str:
    """A cylinder's stroke, or the way of a joint that slides."""
    robot = targets.robot
    if robot is None:
        return "strokes"
    cylinders = {c.joint: c.name for c in robot.cylinders}
    called = {
        j.name
        for j in robot.joints
        if targets.is_called("joints", reading, j.name)
        or (j.name in cylinders and targets.is_called("strokes", reading, cylinders[j.name]))
    }
    meant = [j for j in robot.joints if j.name in called] or robot.joints
    driven = any(j.name in cylinders for j in meant)
    slide = all(j.prismatic for j in meant) and not (driven and _STROKES & {*reading.words})
    return "joints" if slide or not cylinders else "strokes"


def _of_share(reading: Reading, targets: Targets) -> str:
    """Of its whole stroke a spool's position, of its rated signal what a valve is to do."""
    words = set(reading.words)
    asked = words & (COMMANDED_WORDS | REFERENCE_WORDS)
    if reading.quantity == "length":  # the spool's way
        return "left out" if asked else "spools"
    spool, valve = words & _SPOOLS, words & _VALVES
    whose = words & targets.words() or any(word.isdigit() for word in words)
    if spool or valve or (asked and whose):
        measured = words & (MEASURED | _PLACES) or not valve
        return "spools" if measured and not asked else "valve_commands"
    return "left out"


def _of_machine(reading: Reading) -> str:
    """What is measured: of a sensor's loop current or voltage what its words say."""
    words = set(reading.words)
    if reading.quantity == "length":
        return "ratio" if words & (_SPOOLS | _VALVE_NAMES) else "length"
    if reading.quantity not in ("voltage", "current"):
        return reading.quantity
    if words & OF_PRESSURES and reading.quantity == "current":
        return "pressure"
    # A signal that is asked for goes to a valve, whichever pressure it is to make.
    if words & (COMMANDED_WORDS | REFERENCE_WORDS):
        return reading.quantity
    if words & OF_PRESSURES:
        return "pressure"
    of_sensors = {"ratio": _SPOOLS} if words & _VALVE_NAMES else _OF_SENSORS
    return next((q for q, said in of_sensors.items() if words & said), reading.quantity)


def _elsewhere(reading: Reading, targets: Targets) -> str:
    unit = reading.unit is not None
    return elsewhere(_of_machine(reading), reading.words, targets.words(), unit=unit)
