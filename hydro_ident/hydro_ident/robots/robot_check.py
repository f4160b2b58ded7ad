"""Whether a robot description can be true: strokes, levers, loads, bodies, units, missing numbers.

What can be computed from the files alone. Nothing here knows the machine: a description without
remarks may still be of another one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro_ident.robots.robot_file_gaps import missing_fields
from hydro_ident.robots.robot_ranges import CylinderRange, cylinder_ranges, least_inertia
from hydro_ident.robots.robot_units import geometry_errors, unit_errors, unit_warnings
from hydro_ident.robots.robot_unused import unused_fields
from hydro_model.description.robot_checks import slightly_wide
from hydro_model.effects import resolve
from hydro_model.errors import RobotError
from hydro_model.multibody.joint_ranges import limits
from hydro_model.multibody.spatial import central_inertia
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import datasheet_inertia

SCHEMA = "hydro_ident/robot_check/1"
ERROR, WARNING, NOTE = "error", "warning", "note"
#: A lever this much shorter than the longest one is small.
SMALL_LEVER = 0.25
#: Share of the stroke that counts as close to its end.
CLOSE_END = 0.02
#: Share of what the supply gives above which a load at rest leaves little to move with.
HEAVY = 0.8
#: Links of hydraulic arms have more.
_LIGHT_KG = 1.0


@dataclass(frozen=True, slots=True)
class Remark:
    """One thing to look at.

    Attributes
    ----------
    level : str
        `error`, `warning` or `note`.
    about : str
        Joint, cylinder, link, valve or section of the file.
    text : str
        A sentence with numbers.
    """

    level: str
    about: str
    text: str


@dataclass(frozen=True, slots=True)
class RobotCheck:
    """What was found.

    Attributes
    ----------
    robot : Robot
    ranges : tuple of CylinderRange
    remarks : tuple of Remark
        Errors first.
    """

    robot: Robot
    ranges: tuple[CylinderRange, ...]
    remarks: tuple[Remark, ...]

    @property
    def wrong(self) -> bool:
        """Whether there is an error among the remarks."""
        return any(remark.level == ERROR for remark in self.remarks)

    def as_dict(self) -> dict[str, Any]:
        """For a JSON file."""
        return {
            "schema": SCHEMA,
            "robot": self.robot.name,
            "file": str(self.robot.source),
            "cylinders": [r.as_dict() for r in self.ranges],
            "remarks": [
                {"level": r.level, "about": r.about, "text": r.text} for r in self.remarks
            ],
        }


def check_robot(robot: Robot) -> RobotCheck:
    """Look a robot description over.

    Parameters
    ----------
    robot : Robot
        As read; its strokes may be outside the cylinders
        (``load_robot(..., check_strokes=False)``).

    Returns
    -------
    RobotCheck
    """
    ranges, geometry = cylinder_ranges(robot), dict(geometry_errors(robot))
    # What follows from numbers in another unit would bury them.
    told = [r for r in ranges if r.cylinder.joint not in geometry]
    remarks = [Remark(ERROR, about, text) for about, text in geometry.items()]
    remarks += [remark for r in told for remark in _cylinder(r, robot, loaded=not geometry)]
    remarks += [*_masses(robot), *_bodies(robot), *_joints(robot), *_effects(robot)]
    remarks += [Remark(ERROR, about, text) for about, text in unit_errors(robot, ranges)]
    remarks += [Remark(WARNING, about, text) for about, text in unit_warnings(robot, ranges)]
    remarks += [Remark(WARNING, about, text) for about, text in missing_fields(robot)]
    remarks += [Remark(WARNING, about, text) for about, text in unused_fields(robot)]
    order = (ERROR, WARNING, NOTE)
    return RobotCheck(robot, ranges, tuple(sorted(remarks, key=lambda r: order.index(r.level))))


def _cylinder(r: CylinderRange, robot: Robot, *, loaded: bool) -> Iterator[Remark]:
    yield from _strokes(r)
    yield from _levers(r)
    if loaded:
        yield from _loads(r, robot)


def _strokes(r: CylinderRange) -> Iterator[Remark]:
    name, stroke, unit = r.cylinder.name, r.cylinder.stroke_m, r.unit
    low, high = float(r.stroke_m.min()), float(r.stroke_m.max())
    if low < 0.0 or high > stroke:
        inside = r.inside
        allowed = (
            "no position in them is inside"
            if inside is None
            else f"inside it is from {inside[0]:.3f} to {inside[1]:.3f} {unit}"
        )
        yield Remark(
            WARNING if slightly_wide(r.cylinder, r.q) else ERROR,
            name,
            f"joint limits {r.q[0]:.3f} to {r.q[-1]:.3f} {unit} of {r.cylinder.joint} move the"
            f" piston from {low:.3f} to {high:.3f} m, its stroke is 0 to {stroke:.3f} m;"
            f" {allowed}",
        )
    elif min(low, stroke - high) < CLOSE_END * stroke:
        yield Remark(
            NOTE,
            name,
            f"the joint's limits leave {1e3 * min(low, stroke - high):.0f} mm to an end of the"
            f" stroke: the small chamber is stiff there",
        )
    if r.cylinder.l1_m > 0.0 and r.cylinder.x0_m < stroke:
        yield Remark(
            WARNING,
            name,
            f"x0_m = {r.cylinder.x0_m:.3f} m from pin to pin with the rod in cannot house a stroke"
            f" of {stroke:.3f} m",
        )


def _levers(r: CylinderRange) -> Iterator[Remark]:
    name, unit = r.cylinder.name, r.unit
    for q in r.dead_centres:
        yield Remark(
            ERROR,
            name,
            f"dead centre at {q:.3f} {unit} of {r.cylinder.joint}, inside its limits: the lever"
            " arm passes through zero and the cylinder neither moves nor holds the joint there",
        )
    if r.dead_centres:
        return
    size = np.abs(r.lever_m)
    if size.min() < SMALL_LEVER * size.max():
        yield Remark(
            WARNING,
            name,
            f"the lever arm falls to {size.min():.3f} m at {r.q[size.argmin()]:.3f} {unit}"
            f" of {r.cylinder.joint}, {100.0 * size.min() / size.max():.0f} % of its longest",
        )
    if r.lever_m[0] < 0.0:
        yield Remark(
            NOTE,
            name,
            f"extending it lowers the position of joint {r.cylinder.joint}: as on the machine?",
        )


def _loads(r: CylinderRange, robot: Robot) -> Iterator[Remark]:
    name = r.cylinder.name
    if r.cylinder.name not in {valve.cylinder for valve in robot.valves}:
        yield Remark(WARNING, name, "no valve feeds it: the controller cannot drive its joint")
    if robot.supply_pressure_pa <= robot.tank_pressure_pa:
        yield Remark(
            ERROR,
            "supply",
            f"supply pressure {1e-5 * robot.supply_pressure_pa:.0f} bar, tank"
            f" {1e-5 * robot.tank_pressure_pa:.0f} bar: nothing moves",
        )
        return
    share = r.load_share
    if not np.isfinite(share) or share < HEAVY:
        return
    yield Remark(
        ERROR if share > 1.0 else WARNING,
        name,
        f"gravity asks for {1e-3 * r.worst_force_n:.1f} kN in some pose, {100.0 * share:.0f} % of"
        f" what the supply gives ({1e-3 * r.pull_n:.1f} to {1e-3 * r.push_n:.1f} kN)",
    )


def _masses(robot: Robot) -> Iterator[Remark]:
    smallest, worst = least_inertia(robot)
    if smallest <= 0.0:
        pose = ", ".join(
            f"{name} {value:.2f}" for name, value in zip(robot.joint_names, worst, strict=True)
        )
        yield Remark(
            ERROR,
            robot.name,
            f"the mass matrix is not positive definite at {pose}: masses or inertias are missing"
            " or wrong, and no simulation can run",
        )


def _bodies(robot: Robot) -> Iterator[Remark]:
    """Bodies of the URDF that cannot exist; an identified robot's are another matter."""
    for name, values in zip(robot.link_names, datasheet_inertia(robot), strict=True):
        if values[0] == 0.0:
            yield Remark(WARNING, name, "no mass in the URDF")
            continue
        if robot.cylinders and 0.0 < values[0] < _LIGHT_KG:
            text = f"mass {values[0]:g} kg, of a hydraulic arm: in t, or a placeholder?"
            yield Remark(WARNING, name, text)
        if wrong := _impossible(values):
            yield Remark(WARNING, name, f"no body has these inertias: {wrong}")


def _impossible(values: FloatArray) -> str:
    """Why a body with these `STANDARD_PARAMETERS` cannot exist; empty where it can."""
    _, central = central_inertia(values)
    a, b, c = np.linalg.eigvalsh(central).tolist()
    principal = f"principal inertias about the centre of mass {a:.3g}, {b:.3g}, {c:.3g} kg m^2"
    slack = 1e-9 * max(abs(c), 1e-12)
    if a < -slack:
        return f"{principal}, one is negative"
    return f"{principal}, one exceeds the sum of the others" if a + b < c - slack else ""


def _joints(robot: Robot) -> Iterator[Remark]:
    for joint, (low, high) in zip(robot.joints, limits(robot).tolist(), strict=True):
        if not np.isfinite([joint.lower, joint.upper]).all():
            text = f"no limits in the URDF: looked at from {low:.2f} to {high:.2f}"
            yield Remark(NOTE, joint.name, text)
        absent = [
            key
            for key, value in (("velocity", joint.velocity_limit), ("effort", joint.effort_limit))
            if not 0.0 < value < np.inf
        ]
        if absent:
            text = (
                f"the URDF's <limit> has no {' and no '.join(absent)}: `excite` needs both, the"
                " controller the velocity"
            )
            yield Remark(WARNING, joint.name, text)
        driven = any(c.joint == joint.name for c in robot.cylinders)
        if robot.cylinders and not driven:
            yield Remark(NOTE, joint.name, "no cylinder moves it: its torque has to be measured")


def _effects(robot: Robot) -> Iterator[Remark]:
    """What nothing could be made of among the listed effects, each looked at by itself first."""
    each = [_refused(replace(robot, effects=(spec,))) for spec in robot.effects]
    # Sound ones may still be one effect listed twice.
    for text in dict.fromkeys(filter(None, each)) or filter(None, [_refused(robot)]):
        yield Remark(ERROR, "effects", text)


def _refused(robot: Robot) -> str:
    """Why a robot's effects cannot be what its file lists, without the file; empty: they can."""
    try:
        resolve(robot)
    except RobotError as error:
        return str(error).removeprefix(f"{robot.source}: ")
    return ""
