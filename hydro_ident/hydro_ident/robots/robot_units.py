"""Numbers of a robot description that no machine has, and the unit that was likely meant.

The bounds leave room for every hydraulic arm: they are there for numbers in another unit, which
are off by a factor of ten and more, and not to judge a design.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hydro_ident.everyday_units import EDGE_DROP_PA, L_MIN, LENGTHS_M, PRESSURES_PA
from hydro_ident.robots.robot_numbers import meant, number_errors, number_warnings
from hydro_ident.robots.robot_ranges import CylinderRange
from hydro_model.robot import Cylinder, FloatArray, Robot, Valve

#: Largest bore, m: where ISO 6022, the heavy series of cylinders, ends; and the smallest there is.
_BORES_M = (0.01, 0.5)
#: Longest stroke, m, and that beyond which it is worth a look; the shortest of an arm.
_STROKES_M, _LONG_M = (0.03, 10.0), 5.0
#: Bore over stroke and rod over bore: cylinders have at most one, and at least a third.
_WIDE, _THIN = 2.0, 0.15
#: A lever longer than the whole arm is odd; so many times, and one of the two is in another unit.
_LEVERS = 3.0
#: Supply, bar: from low-pressure hydraulics to jacks; and what is usual.
_SUPPLY_BAR, _USUAL_BAR = (10.0, 700.0), (50.0, 400.0)
#: Nominal flow of a valve at 35 bar over one edge, l/min: from miniature servo valves to big
#: three-stage ones; and what is usual.
FLOWS_L_MIN, _USUAL_FLOWS = (0.5, 2000.0), (1.0, 1000.0)
#: A full stroke at full opening and the whole supply over one edge, s.
_STROKE_S = (0.05, 120.0)

#: A revolute joint with limits beyond a turn to either side, rad, has them in degrees. A turn that
#: was rounded up, 6.2832 or 6.3, is one.
_TURN_RAD = 1.01 * 2.0 * np.pi
#: Length of an arm, m, and how many times its longest cylinder that is, beyond which one of the
#: two is in another unit: long booms of concrete pumps have 60 m and some twenty times.
_ARM_M, _REACHES = 20.0, 30.0

#: Units that may have been meant, in m and in bar.
_LENGTHS = {"mm": LENGTHS_M["mm"], "cm": LENGTHS_M["cm"], "inches": 0.0254}
_PRESSURES = {
    unit: PRESSURES_PA[unit] / PRESSURES_PA["bar"] for unit in ("Pa", "kPa", "MPa", "bar", "psi")
}
#: What a valve's numbers may have been taken for, and by how much its flow is then too small.
_VALVE_MISTAKES = {
    "a drop in Pa taken for bar": np.sqrt(1e5),
    "a flow in m^3/s taken for l/min": L_MIN,
    "a flow in l/s taken for l/min": 60.0,
    "a coefficient in l/(min sqrt(bar)) taken for m^3/(s sqrt(Pa))": 1.0 / (L_MIN * np.sqrt(1e5)),
}


def edge_l_min(coefficient: float) -> float:
    """Flow over an edge at full opening and 35 bar, l/min.

    Parameters
    ----------
    coefficient : float
        m^3/(s sqrt(Pa)).
    """
    return float(coefficient * np.sqrt(EDGE_DROP_PA) * L_MIN)


def geometry_errors(robot: Robot) -> Iterator[tuple[str, str]]:
    """Joint limits in degrees and links in another unit than metres.

    What else is computed of such joints, and of loads on such links, tells nothing.

    Parameters
    ----------
    robot : Robot

    Yields
    ------
    about, text : str
        A joint that a cylinder moves, or `links`.
    """
    driven = {cylinder.joint for cylinder in robot.cylinders}
    yield from ((about, text) for about, text in _degrees(robot) if about in driven)
    arm = _arm_m(robot)
    longest = max((_length_m(c) for c in robot.cylinders), default=0.0)
    if arm > _ARM_M and 0.0 < _REACHES * longest < arm:
        text = f"an arm of {arm:.4g} m in the URDF, the longest cylinder has {longest:.3g} m"
        yield "links", text + meant(arm, _LENGTHS, (0.5 * longest, _REACHES * longest), "m")


def _degrees(robot: Robot) -> Iterator[tuple[str, str]]:
    for joint in robot.joints:
        ends = [end for end in (joint.lower, joint.upper) if np.isfinite(end)]
        if not joint.prismatic and any(abs(end) > _TURN_RAD for end in ends):
            low, high = np.radians([joint.lower, joint.upper])
            yield (
                joint.name,
                f"limits {joint.lower:g} to {joint.upper:g} rad, more than a turn: in degrees?"
                f" Those are {low:.3g} to {high:.3g} rad",
            )


def _length_m(cylinder: Cylinder) -> float:
    """From pin to pin with the rod out, or what its pins are apart from the joint."""
    return max(cylinder.x0_m + cylinder.stroke_m, cylinder.l1_m, cylinder.l2_m)


def unit_errors(robot: Robot, ranges: tuple[CylinderRange, ...]) -> Iterator[tuple[str, str]]:
    """Numbers that are in another unit for certain.

    Parameters
    ----------
    robot : Robot
    ranges : tuple of CylinderRange
        Of its cylinders.

    Yields
    ------
    about, text : str
    """
    found = [entry for r in ranges for entry in _lengths(r, _arm_m(robot))]
    found += _supply(robot)
    yield from found
    odd = {about for about, _ in found}
    # So does a range that is below a supply in another unit.
    yield from (e for e in number_errors(robot) if e[0] != "sensors" or "supply" not in odd)
    for valve, cylinder in _valves(robot):
        # A time that follows from another error says nothing of the valve.
        if not odd & {cylinder.name, "supply"}:
            yield from _stroke_time(valve, cylinder, robot.supply_pressure_pa)


def _lengths(r: CylinderRange, arm_m: float) -> Iterator[tuple[str, str]]:
    c = r.cylinder
    if c.bore_m > _BORES_M[1]:
        yield c.name, f"bore {c.bore_m:g} m{meant(c.bore_m, _LENGTHS, _BORES_M, 'm')}"
    if c.stroke_m > _STROKES_M[1]:
        likely = meant(c.stroke_m, _LENGTHS, (_STROKES_M[0], _LONG_M), "m")
        yield c.name, f"stroke {c.stroke_m:g} m{likely}"
    lever = float(np.abs(r.lever_m).max())
    if c.l1_m > 0.0 and 0.0 < _LEVERS * arm_m < lever:
        text = f"lever arm up to {lever:.4g} m on an arm of {arm_m:.3g} m, pins or links"
        yield c.name, text + meant(lever, _LENGTHS, (0.01 * arm_m, arm_m), "m")


def unit_warnings(robot: Robot, ranges: tuple[CylinderRange, ...]) -> Iterator[tuple[str, str]]:
    """Numbers that are unlikely.

    Parameters
    ----------
    robot : Robot
    ranges : tuple of CylinderRange
        Of its cylinders.

    Yields
    ------
    about, text : str
    """
    for r in ranges:
        c = r.cylinder
        if _LONG_M < c.stroke_m <= _STROKES_M[1]:
            yield c.name, f"stroke {c.stroke_m:g} m: in metres?"
        if c.bore_m > _WIDE * c.stroke_m:
            yield c.name, f"bore {c.bore_m:g} m, stroke {c.stroke_m:g} m: both in metres?"
        if 0.0 < c.rod_m < _THIN * c.bore_m:
            yield c.name, f"rod {c.rod_m:g} m in a bore of {c.bore_m:g} m: both in metres?"
        lever, arm = float(np.abs(r.lever_m).max()), _arm_m(robot)
        if c.l1_m > 0.0 and 0.0 < arm < lever <= _LEVERS * arm:
            yield c.name, f"lever arm up to {lever:.3g} m, the whole arm is {arm:.3g} m long"
    driven = {cylinder.joint for cylinder in robot.cylinders}
    yield from ((about, text) for about, text in _degrees(robot) if about not in driven)
    for valve, _ in _valves(robot):
        yield from _flow(valve)
    yield from number_warnings(robot)


def _arm_m(robot: Robot) -> float:
    """Length of all links in a line, m, from the first joint on."""
    links: list[FloatArray] = [joint.translation_m for joint in robot.joints[1:]]
    return float(sum(np.linalg.norm(link) for link in [*links, robot.tip_offset_m]))


def _supply(robot: Robot) -> Iterator[tuple[str, str]]:
    pa = robot.supply_pressure_pa
    bar = pa * 1e-5
    # No supply at all is another remark.
    if not robot.cylinders or pa <= robot.tank_pressure_pa or _within(bar, _SUPPLY_BAR):
        return
    text = f"supply pressure {bar:g} bar, expected {_SUPPLY_BAR[0]:g} to {_SUPPLY_BAR[1]:g}"
    # As it was typed: into a file in Pa, or on a command line in bar.
    typed = pa if bar < _SUPPLY_BAR[0] else bar
    yield "supply", text + meant(typed, _PRESSURES, _USUAL_BAR, "bar")


def _valves(robot: Robot) -> Iterator[tuple[Valve, Cylinder]]:
    for valve in robot.valves:
        yield valve, robot.cylinder(valve.cylinder)


def _flow(valve: Valve) -> Iterator[tuple[str, str]]:
    flows = [edge_l_min(c) for c in (valve.c_pa, valve.c_at, valve.c_pb, valve.c_bt)]
    odd = [flow for flow in flows if not _within(flow, FLOWS_L_MIN)]
    if odd:
        text = f"an edge gives {odd[0]:.3g} l/min at 35 bar{_mistaken(odd[0])}"
        yield valve.name, text


def _stroke_time(valve: Valve, cylinder: Cylinder, supply_pa: float) -> Iterator[tuple[str, str]]:
    flow = valve.c_pa * np.sqrt(max(supply_pa, 0.0))
    if flow <= 0.0:
        return
    seconds = float(cylinder.stroke_m * cylinder.area_a_m2 / flow)
    if not _within(seconds, _STROKE_S):
        mistaken = _mistaken(edge_l_min(valve.c_pa))
        text = f"a full stroke of {cylinder.name} takes {seconds:.3g} s with the valve wide open"
        yield valve.name, f"{text}{mistaken}"


def _mistaken(flow: float) -> str:
    found = [
        f"{mistake} ({flow * factor:.3g} l/min)"
        for mistake, factor in _VALVE_MISTAKES.items()
        if not _within(flow, FLOWS_L_MIN) and _within(flow * factor, _USUAL_FLOWS)
    ]
    return f": {' or '.join(found)}?" if found else ": are the units right?"


def _within(value: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] <= value <= bounds[1]
