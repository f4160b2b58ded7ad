"""Numbers of a log or a recording that no machine of its robot has: units that were mistaken.

Usual units of one quantity are ten or more apart (bar and MPa; psi and bar 14.5), so that wide
limits find every one of them; bar for atm or kgf/cm2 they do not. Positions are held against the
joints' ranges where they are read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from hydro_ident.logs.units import UNITS
from hydro_model.arrays import FloatArray
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, VALVE_COMMAND, VALVE_STATE

#: Shares of the supply's pressure: with the pump on some pressure is above the first; no load
#: makes twice as much as the areas of a cylinder make of the supply (the second).
_PRESSURE_UNDER, _PRESSURE_OVER = 0.15, 2.0
#: Shares of a valve's rated signal.
_SIGNAL_UNDER, _SIGNAL_OVER = 0.01, 1.5
#: Logs are recorded at other rates than their machine's, at 50 Hz what runs at 500; a unit of time
#: that was mistaken makes 60 and more of it.
_RATES = 50.0
_BAR = 1e5
#: What a reading of pressure that is not in Pa is usually in; others are like bar.
USUAL_UNITS = ("bar", "kPa", "MPa", "psi")
#: Below it a cylinder has no rod side: a plunger.
_SMALLEST_M2 = 1e-9


def unit_warnings(robot: Robot | None, fields: Mapping[str, Iterable[FloatArray]]) -> list[str]:
    """What cannot be in the units that the mapping says.

    Parameters
    ----------
    robot : Robot or None
    fields : mapping of str to iterable of (N, k) array
        Topic to what its `effort` holds, Pa absolute or V.

    Returns
    -------
    list of str
        A sentence each; none without a robot.
    """
    if robot is None:
        return []
    found = []
    largest = _largest(fields.get(CHAMBER_PRESSURES, ()))
    if largest is not None:
        found += _of_pressures(robot, largest - robot.atmospheric_pressure_pa)
    rated = max((valve.rated_voltage_v for valve in robot.valves), default=0.0)
    for topic, section in ((VALVE_STATE, "valves"), (VALVE_COMMAND, "valve_commands")):
        largest = _largest(np.abs(values) for values in fields.get(topic, ()))
        if largest is None or not rated:
            continue
        if not _SIGNAL_UNDER * rated <= largest <= _SIGNAL_OVER * rated:
            found.append(
                f"{section}: expected up to {rated:g} V, the valves' rated signal, found at most"
                f" {largest:.4g} V: is the unit another one{_or(largest < rated, 'did none open')}"
            )
    return found


def rate_warning(robot: Robot | None, period_s: float) -> str:
    """What cannot be a rate of this machine's samples, or of a log of them.

    Parameters
    ----------
    robot : Robot or None
    period_s : float
        From cycle to cycle.

    Returns
    -------
    str
        Empty where it may be one, or without a robot.
    """
    if robot is None or not 0.0 < period_s < np.inf:
        return ""
    rate_hz = 1.0 / period_s
    if 1.0 / _RATES <= rate_hz / robot.sensors.rate_hz <= _RATES:
        return ""
    slow = rate_hz < robot.sensors.rate_hz
    mistaken = "milliseconds read as seconds" if slow else "seconds read as milliseconds"
    return (
        f"expected about {robot.sensors.rate_hz:g} Hz, sensors.rate_hz of the robot file, found"
        f" {rate_hz:.4g} Hz: is the unit of time another one, {mistaken}?"
    )


def pressure_reach_pa(robot: Robot) -> tuple[float, float] | None:
    """Within what the largest pressure of a machine is while its pump is on.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    pair of float or None
        Pa gauge; None where the robot file tells nothing of it.
    """
    supply = robot.supply_pressure_pa
    if supply <= 0.0 or not robot.cylinders:
        return None
    ratio = max(c.area_a_m2 / max(c.area_b_m2, _SMALLEST_M2) for c in robot.cylinders)
    return _PRESSURE_UNDER * supply, _PRESSURE_OVER * ratio * supply


def pressure_units(robot: Robot, largest: float) -> list[str]:
    """In which other units than Pa a number may be the largest pressure of a machine.

    Parameters
    ----------
    robot : Robot
    largest : float

    Returns
    -------
    list of str
        The one that brings it nearest to the robot's supply first.
    """
    reach = pressure_reach_pa(robot)
    if reach is None or largest <= 0.0:
        return []
    pa = {unit: largest * UNITS["pressure"][unit] for unit in USUAL_UNITS}
    fitting = [unit for unit in USUAL_UNITS if reach[0] <= pa[unit] <= reach[1]]
    return sorted(fitting, key=lambda unit: abs(np.log(pa[unit] / robot.supply_pressure_pa)))


def _of_pressures(robot: Robot, largest_pa: float) -> list[str]:
    reach = pressure_reach_pa(robot)
    if reach is None or reach[0] <= largest_pa <= reach[1]:
        return []
    supply = robot.supply_pressure_pa
    return [
        f"pressures: expected up to about {supply / _BAR:.4g} bar gauge, the supply of"
        f" {robot.name}, found at most {largest_pa / _BAR:.4g} bar: is the unit another one"
        f"{_or(largest_pa < supply, 'was the pump off')}"
    ]


def _or(small: bool, why: str) -> str:
    return f", or {why}?" if small else "?"


def _largest(fields: Iterable[FloatArray]) -> float | None:
    """The largest number of some arrays; None where there is none."""
    known = [float(v[np.isfinite(v)].max()) for v in fields if np.isfinite(v).any()]
    return max(known, default=None)
