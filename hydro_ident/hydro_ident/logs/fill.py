"""What an entry of a suggested mapping says beside the signal: unit, sign, wrap, raw range.

The robot's joint limits, rated signals and supply pressure decide where the file gives no unit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection

from hydro_ident.logs.columns import wrap_of
from hydro_ident.logs.guess import Reading
from hydro_ident.logs.map import OF_JOINTS, SECTIONS
from hydro_ident.logs.names import Target
from hydro_ident.logs.signal import FILL_IN, unwrapped
from hydro_ident.logs.targets import Targets
from hydro_ident.logs.units import UNITS
from hydro_model.arrays import FloatArray

Entry = dict[str, object]

#: Largest pressure over the supply's of the robot: between these it is believed.
_UNDER, _SUPPLY_UNDER, _OVER = 0.1, 0.4, 1.6
#: A tank line stays below this share of it; in a unit that is ten times smaller it would not.
_TANK_OVER = 0.15
#: No pressure is further below the atmosphere than that, and the error of a zero.
_LOWEST_PA = -1.2e5
#: Between these a temperature without a unit is one of oil in degC; 300 K is not.
_OIL_C = (-50.0, 150.0)
#: Units that numbers alone may tell apart; of `atm` or `mbar` the file has to say so.
_TOLD = {u: UNITS["pressure"][u] for u in ("Pa", "kPa", "MPa", "bar", "psi")}


def fill(
    entry: Entry,
    values: FloatArray,
    reading: Reading,
    target: Target,
    targets: Targets,
) -> tuple[str, list[str]]:
    """Add to an entry what its section needs.

    Parameters
    ----------
    entry : dict
        Is added to.
    values : (N,) array
        As recorded.
    reading : Reading
    target : Target
    targets : Targets

    Returns
    -------
    str, list of str
        How sure that is, and why.
    """
    if reading.unknown:
        return _fill_unknown(entry, values, target, targets)
    if target.section not in ("pressures", "valves", "valve_commands") and _is_raw(
        reading, target
    ):
        return _fill_raw(entry, target)
    filler: Callable[..., tuple[str, list[str]]] = {
        "pressures": _fill_pressure,
        "joints": _fill_angle,
        "references": _fill_angle,
        "valve_commands": _fill_voltage,
        "valves": _fill_voltage,
    }.get(target.section, _fill_unit)
    return filler(entry, values, reading, target, targets)


def _is_raw(reading: Reading, target: Target) -> bool:
    """Whether a column is what a sensor gives out, or of a spool its way."""
    measured = "" if reading.unit is None else reading.unit.quantity
    return measured in ("voltage", "current") or (
        target.section == "spools" and measured == "length"
    )


def _fill_raw(entry: Entry, target: Target) -> tuple[str, list[str]]:
    """Of a sensor whose range nothing here tells."""
    spool = target.section == "spools"
    entry |= {"raw": FILL_IN, "span": [-1, 1] if spool else FILL_IN}
    entry["unit"] = "1" if spool else FILL_IN
    return "open", ["a sensor's raw signal: raw and span are on its label"]


def _fill_unknown(
    entry: Entry, values: FloatArray, target: Target, targets: Targets
) -> tuple[str, list[str]]:
    """The file states a unit, and another one would be a guess against it."""
    if target.section in ("valves", "valve_commands"):
        rated = targets.rated_v(target.name)
        entry |= {"raw": FILL_IN, "span": [-rated, rated], "unit": "V"}
    else:
        entry["unit"] = FILL_IN
    if target.section in OF_JOINTS and (period := wrap_of(values)):
        entry["wrap"] = round(period, 9)
    return "open", []


def _fill_unit(
    entry: Entry,
    values: FloatArray,
    reading: Reading,
    target: Target,
    targets: Targets,
) -> tuple[str, list[str]]:
    del values, targets
    quantity = {**SECTIONS, "oil_temperature": "temperature"}[target.section]
    if reading.unit is not None and reading.unit.unit in UNITS[quantity]:
        entry["unit"] = reading.unit.unit
    elif quantity == "length":
        # A cylinder's stroke of more than ten metres there is not.
        entry["unit"] = "mm" if max(abs(reading.low), abs(reading.high)) > 10.0 else "m"
        return "likely", [f"{entry['unit']}: within {reading.low:.4g} to {reading.high:.4g}"]
    elif quantity == "ratio":
        entry["unit"] = "%" if _percent(reading) else "1"
        return "likely", [f"{entry['unit']}: within {reading.low:.4g} to {reading.high:.4g}"]
    elif quantity != "temperature" or not _OIL_C[0] < reading.low <= reading.high < _OIL_C[1]:
        entry["unit"] = FILL_IN
    return "sure", []


def _fill_angle(
    entry: Entry,
    values: FloatArray,
    reading: Reading,
    target: Target,
    targets: Targets,
) -> tuple[str, list[str]]:
    quantity = targets.quantity_of(target.section, target.name)
    if quantity == "length":
        return _fill_way(entry, values, reading, target, targets)
    why: list[str] = []
    level = "sure"
    if period := wrap_of(values):
        entry["wrap"] = round(period, 9)
        why.append(f"jumps by {period:.6g}: wrapped")
    if reading.unit is not None and reading.unit.unit in UNITS[quantity]:
        entry["unit"] = reading.unit.unit
    elif max(abs(reading.low), abs(reading.high)) > 7.0:
        entry["unit"] = "deg"
        level = "likely"
        why.append(f"deg: reaches {max(abs(reading.low), abs(reading.high)):.4g}")
    else:
        fits = [u for u in ("rad", "deg") if targets.share_inside(target.name, values, u) > 0.99]
        entry["unit"] = fits[0] if len(fits) == 1 else "rad"
        level = "likely" if len(fits) == 1 else "guess"
        why.append(f"{entry['unit']}: no unit given, numbers within {reading.low:.4g} to"
                   f" {reading.high:.4g}")  # fmt: skip
    if targets.has_range(target.name):
        if period:
            values = targets.whole_turns(target.name, unwrapped(values, period), period)
        level, remark = _against_limits(entry, values, target, targets, level)
        why += [remark] if remark else []
    return level, why


def _fill_way(
    entry: Entry,
    values: FloatArray,
    reading: Reading,
    target: Target,
    targets: Targets,
) -> tuple[str, list[str]]:
    """Of a joint that slides."""
    units = UNITS["length"]
    span = f"within {reading.low:.4g} to {reading.high:.4g}"
    if reading.unit is not None and reading.unit.unit in units:
        entry["unit"], level, why = reading.unit.unit, "sure", []
    else:
        fits = [u for u in units if targets.share_inside(target.name, values, u) > 0.99]
        if len(fits) != 1:
            entry["unit"] = FILL_IN
            return "open", [f"unit: {span}, could be {', '.join(fits or units)}"]
        entry["unit"], level, why = fits[0], "likely", [f"{fits[0]}: {span}"]
    if targets.has_range(target.name):
        level, remark = _against_limits(entry, values, target, targets, level)
        why += [remark]
    return level, why


def _against_limits(
    entry: Entry, values: FloatArray, target: Target, targets: Targets, level: str
) -> tuple[str, str]:
    unit = str(entry["unit"])
    if targets.share_inside(target.name, values, unit) > 0.99:
        return level, "within the joint's range"
    turn = 2.0 * math.pi / UNITS["position"][unit]
    near = targets.whole_turns(target.name, values, turn)
    if (
        targets.quantity_of(target.section, target.name) == "angle"
        and "wrap" not in entry
        and targets.share_inside(target.name, near, unit) > 0.99
    ):
        # As of a wrapped angle, `convert` then looks for the whole turns.
        entry["wrap"] = round(turn, 9)
        return "guess", "within the joint's range by whole turns"
    if targets.share_inside(target.name, -values, unit) > 0.99:
        entry["sign"] = -1
        return "guess", "within the joint's range only with its sign changed"
    return "guess", "outside the joint's range: give sign and offset, or minus for an inclinometer"


def _fill_pressure(
    entry: Entry,
    values: FloatArray,
    reading: Reading,
    target: Target,
    targets: Targets,
) -> tuple[str, list[str]]:
    del values
    if reading.unit is not None and reading.unit.unit in UNITS["pressure"]:
        entry["unit"] = reading.unit.unit
        return "sure", []
    if reading.unit is not None and reading.unit.quantity in ("current", "voltage"):
        return _fill_transducer(entry, reading, targets)
    limit = targets.supply_pa
    share = {u: reading.high * factor / limit for u, factor in _TOLD.items()}
    low = {"supply": _SUPPLY_UNDER, "tank": 0.0}.get(target.name, _UNDER)
    over = _TANK_OVER if target.name == "tank" else _OVER
    fitting = [u for u, of_supply in share.items() if low < of_supply < over]
    if target.name != "tank" and len(fitting) == 1:
        unit = fitting[0]
        supply = limit / UNITS["pressure"][unit]
        entry["unit"] = unit
        return "likely", [f"{unit}: largest {reading.high:.4g} {unit}, supply {supply:.4g} {unit}"]
    entry["unit"] = FILL_IN
    return "open", [f"unit: largest {reading.high:.4g} could be {', '.join(fitting) or 'any'}"]


def unit_of_others(
    reading: Reading, target: Target, targets: Targets, others: Collection[str]
) -> tuple[str, str]:
    """The unit of a pressure whose name and numbers tell none, from the log's other pressures.

    Parameters
    ----------
    reading : Reading
    target : Target
    targets : Targets
    others : collection of str
        Units of the others, each of its own column.

    Returns
    -------
    str, str
        The unit and why; empty where there are not two others of one unit, or where it does not
        fit the numbers.
    """
    if len(others) < 2 or len(set(others)) > 1:
        return "", ""
    unit = next(iter(others))
    factor = UNITS["pressure"][unit]
    over = (_TANK_OVER if target.name == "tank" else _OVER) * targets.supply_pa
    if reading.low * factor < _LOWEST_PA or not 0.0 < reading.high * factor < over:
        return "", ""
    return unit, f"{unit}: as the log's other pressures, largest {reading.high:.4g} {unit}"


def _fill_transducer(entry: Entry, reading: Reading, targets: Targets) -> tuple[str, list[str]]:
    """A transducer's loop current or voltage: its range comes from the robot file."""
    unit = "" if reading.unit is None else reading.unit.unit
    # Of currents there is one usual range; of voltages 0 to 5 or 10, 1 to 5, 0.5 to 4.5 ...
    entry["raw"] = {"mA": [4, 20], "A": [0.004, 0.02]}.get(unit, FILL_IN)
    entry["unit"] = "bar"
    label = [f"raw: the range in {unit} is on its label"] if entry["raw"] == FILL_IN else []
    if targets.robot is None:
        entry["span"] = FILL_IN
        return "open", ["a transducer's raw signal: its range is on its label"]
    top = targets.robot.sensors.pressure_range_pa / 1e5
    entry["span"] = [0, round(top, 3)]
    why = f"a transducer's raw signal; 0 to {top:g} bar is the robot file's range"
    return "open" if label else "guess", [why, *label]


def _fill_voltage(
    entry: Entry,
    values: FloatArray,
    reading: Reading,
    target: Target,
    targets: Targets,
) -> tuple[str, list[str]]:
    del values
    one_sided = reading.low * reading.high > 0.0
    aside = ["stays on one side of zero: is 0 V neutral? else give an offset"] if one_sided else []
    if reading.unit is not None and reading.unit.unit in UNITS["voltage"]:
        entry["unit"] = reading.unit.unit
        return "guess" if one_sided else "sure", aside
    rated = targets.rated_v(target.name)
    if reading.quantity == "ratio":
        return _fill_share(entry, reading, rated, aside)
    if reading.quantity == "current":
        entry |= {"raw": FILL_IN, "span": [-rated, rated], "unit": "V"}
        return "open", ["a current: raw is what stands for minus and plus the rated signal"]
    entry["unit"] = "V"
    if max(abs(reading.low), abs(reading.high)) <= 1.01 * rated:
        return "guess" if one_sided else "likely", [f"V: within the valve's {rated:g} V", *aside]
    entry |= {"raw": FILL_IN, "span": [-rated, rated]}
    return "open", [f"beyond the valve's {rated:g} V: not volts"]


def _fill_share(
    entry: Entry, reading: Reading, rated: float, aside: list[str]
) -> tuple[str, list[str]]:
    """A valve's signal as a share of its rated one."""
    whole = 100.0 if _percent(reading) else 1.0
    entry |= {"raw": [-whole, whole], "span": [-rated, rated], "unit": "V"}
    if max(abs(reading.low), abs(reading.high)) > 1.01 * whole:
        entry["raw"] = FILL_IN
        return "open", [f"beyond {whole:g}: no share of the valve's {rated:g} V", *aside]
    return "guess", [f"a share: {whole:g} for the valve's rated {rated:g} V", *aside]


def _percent(reading: Reading) -> bool:
    """Whether a share is in percent: as the file says, else by its numbers."""
    if reading.unit is not None and reading.unit.unit in UNITS["ratio"]:
        return reading.unit.unit == "%"
    return max(abs(reading.low), abs(reading.high)) > 2.0
