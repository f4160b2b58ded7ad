"""Single numbers of a robot description that no machine has: atmosphere, oil, ranges, rates.

What a number is held against here is itself or one other; sizes that tell of one another are
`hydro_ident.robots.robot_units`'s.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from hydro_ident.everyday_units import PRESSURES_PA
from hydro_model.robot import Robot

#: Effective bulk modulus of a hydraulic chamber: from a foaming reservoir to steel-piped oil.
BULK_BOUNDS_PA = (1.0e7, 5.0e9)
#: Atmosphere, Pa: from the highest mines to the deepest.
_ATMOSPHERES_PA = (5.0e4, 1.1e5)
#: A range of pressure sensors is no more than this many times the supply where it was one unit.
_RANGES = 20.0
#: A tank above none and below this, Pa gauge, is in bar or MPa: none is known to 10 mbar.
_LEAST_TANK_PA = 1000.0
#: A back pressure, Pa gauge.
_TANKS_PA = (1e4, 5e6)
#: No joint that oil moves is faster, rad/s or m/s.
_FASTEST = 10.0
_VOLTAGES_V = (0.1, 100.0)
_FEWEST_COUNTS = 1000
_RATES_HZ = (10.0, 1e4)
#: Angles of pins that were rounded up to a turn are one.
_TURN_RAD = 1.01 * 2.0 * np.pi
_USUAL_PRESSURES = {unit: PRESSURES_PA[unit] for unit in ("bar", "MPa", "kPa", "psi", "mbar")}
_MODULI = {"bar": 1e5, "MPa": 1e6, "GPa": 1e9, "psi": PRESSURES_PA["psi"]}


def meant(
    value: float, units: Mapping[str, float], plausible: tuple[float, float], into: str
) -> str:
    """The units in which a number would be plausible.

    Parameters
    ----------
    value : float
        As it was written.
    units : mapping of str to float
        How many `into` one of each is.
    plausible : pair of float
        In `into`.
    into : str

    Returns
    -------
    str
        To stand behind the number.
    """
    found = [
        f"{value:.4g} {unit} are {value * factor:.4g} {into}"
        for unit, factor in units.items()
        if plausible[0] <= value * factor <= plausible[1]
    ]
    return f": in another unit? {' and '.join(found)}" if found else ": is the unit right?"


def number_errors(robot: Robot) -> Iterator[tuple[str, str]]:
    """Numbers of fluid and sensors that are in another unit for certain.

    Parameters
    ----------
    robot : Robot

    Yields
    ------
    about, text : str
    """
    if not robot.cylinders:
        return
    pa = robot.atmospheric_pressure_pa
    if not _ATMOSPHERES_PA[0] <= pa <= _ATMOSPHERES_PA[1]:
        likely = meant(pa, {**_USUAL_PRESSURES, "atm": 101325.0}, _ATMOSPHERES_PA, "Pa")
        expected = f"expected {_ATMOSPHERES_PA[0]:g} to {_ATMOSPHERES_PA[1]:g}"
        yield "fluid", f"atmospheric_pressure_pa {pa:g} Pa, {expected}{likely}"
    yield from _moduli(robot)
    range_pa, supply_pa = robot.sensors.pressure_range_pa, robot.supply_pressure_pa
    if range_pa < supply_pa:
        likely = meant(range_pa, _USUAL_PRESSURES, (supply_pa, _RANGES * supply_pa), "Pa")
        text = f"pressure.range_pa {range_pa:g} Pa, below the supply of {supply_pa:g} Pa"
        yield "sensors", f"{text}{likely}"


def _moduli(robot: Robot) -> Iterator[tuple[str, str]]:
    """Of the fluid where all cylinders have one modulus, which is where it then stands."""
    low, high = BULK_BOUNDS_PA
    own = {c.name: c.bulk_modulus_pa for c in robot.cylinders}
    if len(set(own.values())) == 1:
        own = {"fluid": robot.cylinders[0].bulk_modulus_pa}
    for about, pa in own.items():
        if not low <= pa <= high:
            text = f"bulk_modulus_pa {pa:g} Pa, expected {low:g} to {high:g}"
            yield about, text + meant(pa, _MODULI, (1e8, 3e9), "Pa")


def number_warnings(robot: Robot) -> Iterator[tuple[str, str]]:
    """Numbers of tank, joints, valves, sensors and pins that are unlikely.

    Parameters
    ----------
    robot : Robot

    Yields
    ------
    about, text : str
    """
    tank_pa = robot.tank_pressure_pa
    if robot.cylinders and 0.0 < tank_pa < _LEAST_TANK_PA:
        likely = meant(tank_pa, _USUAL_PRESSURES, _TANKS_PA, "Pa")
        yield "supply", f"tank_pressure_pa {tank_pa:g} Pa{likely}"
    for joint in robot.joints:
        if _FASTEST < joint.velocity_limit < np.inf:
            unit = "m/s: in mm/s?" if joint.prismatic else "rad/s: in degrees per second?"
            scale = 1e-3 if joint.prismatic else np.pi / 180.0
            those = f"Those are {scale * joint.velocity_limit:.3g} {unit.partition(':')[0]}"
            yield joint.name, f"velocity limit {joint.velocity_limit:g} {unit} {those}"
    for valve in robot.valves:
        volts = valve.rated_voltage_v
        if not _VOLTAGES_V[0] <= volts <= _VOLTAGES_V[1]:
            likely = meant(volts, {"mV": 1e-3, "kV": 1e3}, (1.0, 30.0), "V")
            yield valve.name, f"rated_voltage_v {volts:g} V{likely}"
    yield from _sensors(robot)
    yield from _pins(robot)


def _sensors(robot: Robot) -> Iterator[tuple[str, str]]:
    counts, rate_hz = robot.sensors.encoder_counts_per_rev, robot.sensors.rate_hz
    if counts < _FEWEST_COUNTS:
        bits = f" Those of {counts} bits are {2**counts}" if 10 <= counts <= 32 else ""
        text = f"counts_per_rev {counts}, steps of {360.0 / counts:.3g} degrees: of the joint?"
        yield "sensors", f"{text}{bits}"
    if not _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]:
        likely = meant(rate_hz, {"kHz": 1e3, "mHz": 1e-3}, (50.0, 5000.0), "Hz")
        if 50.0 <= 1.0 / rate_hz <= 5000.0:
            likely = f": a period in s? That of {1.0 / rate_hz:.4g} Hz"
        yield "sensors", f"rate_hz {rate_hz:g} Hz{likely}"


def _pins(robot: Robot) -> Iterator[tuple[str, str]]:
    for cylinder in robot.closed_chains:
        angles = {k: float(getattr(cylinder, k)) for k in ("q0_rad", "child_pin_angle_rad")}
        for key, angle in angles.items():
            if abs(angle) > _TURN_RAD:
                those = f"Those are {np.radians(angle):.4g} rad"
                yield cylinder.name, f"{key} {angle:g} rad, more than a turn: in degrees? {those}"
