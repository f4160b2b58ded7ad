"""The page of `check_robot`: what is wrong, the drawing, strokes, levers and loads."""

from __future__ import annotations

from typing import Any

import numpy as np

from hydro_ident.report.figure import Axis, Figure, line, unit_text
from hydro_ident.report.page import Row, Section, Verdict, also, number, page, paragraph, table
from hydro_ident.report.palette import BEFORE, joint_colour
from hydro_ident.report.robot_drawing import drawings
from hydro_ident.robots.robot_check import ERROR, WARNING, RobotCheck
from hydro_ident.robots.robot_ranges import CylinderRange
from hydro_model.robot import STANDARD_PARAMETERS, STANDARD_UNITS, FloatArray, Robot
from hydro_model.robot_files import datasheet_inertia

_DRAWN = (
    "Hold these beside the machine. A joint's colour is that of its link (solid) and cylinder"
    " (dashed), in all drawings as in the first one's legend; the base has the text's. Dotted"
    " lines lead from the joint's axis to the cylinder's pins: 1, the barrel's, on the link"
    " before, at `l1_m`; 2, the rod's, on the joint's own link, at `l2_m`. A pin on the wrong side"
    " is a wrong sign of `q0_rad` or `child_pin_angle_rad`."
)
_RANGES = (
    "Over the joint's limits. Dashed: the ends of the stroke, and what supply and tank pressure"
    " give at the piston. A lever that comes near zero, or a load near the dashed lines, is where"
    " the machine will be hard to move."
)


def robot_html(check: RobotCheck) -> str:
    """One self-contained HTML page.

    Parameters
    ----------
    check : RobotCheck

    Returns
    -------
    str
    """
    robot = check.robot
    pictures = "".join(figure.html() for figure in drawings(robot))
    sections = [Section("geometry", "Links and pins", _drawn(robot), pictures)]
    if check.ranges:
        body = _table(check) + "".join(_figure(robot, r).html() for r in check.ranges)
        sections.append(Section("cylinders", "Strokes, levers and loads", _RANGES, body))
    sections.append(_bodies(robot))
    return page(f"Robot description: {robot.name}", _verdict(check), sections)


def _drawn(robot: Robot) -> str:
    """What the drawing shows, and the cylinders that it cannot show."""
    drawn = {cylinder.name for cylinder in robot.closed_chains}
    slid = [c.name for c in robot.cylinders if c.name not in drawn]
    if not slid:
        return _DRAWN
    return (
        f"{_DRAWN} Not drawn: {', '.join(slid)}. A cylinder that slides with its joint has no pins"
        " in the file."
    )


def _verdict(check: RobotCheck) -> Verdict:
    found = {
        level: tuple(f"{r.about}: {r.text}" for r in check.remarks if r.level == level)
        for level in ("error", "warning", "note")
    }
    heads = {"error": "Wrong", "warning": "To look at", "note": "To know"}
    cards = tuple((heads[level], lines) for level, lines in found.items() if lines)
    if check.wrong:
        tone, headline = "bad", "This description cannot be used as it is."
    elif found[WARNING]:
        tone, headline = "warn", "Nothing contradicts itself; some things are worth a look."
    else:
        tone, headline = "good", "Nothing in this description contradicts itself."
    said = ("The files alone were looked at, not the machine: compare the drawing with it.",)
    word = ERROR if check.wrong else "consistent"
    return Verdict(tone, headline, word, (*cards, ("What this is", said)))


def _table(check: RobotCheck) -> str:
    head = ("cylinder", "joint from", "to", "stroke from, m", "to", "of", "lever from, m", "to")
    names = check.robot.joint_names
    rows = [
        Row(
            (
                r.cylinder.name,
                f"{r.q[0]:.3f} {r.unit}",
                f"{r.q[-1]:.3f} {r.unit}",
                *(f"{v:.3f}" for v in (r.stroke_m.min(), r.stroke_m.max(), r.cylinder.stroke_m)),
                *(f"{v:.3f}" for v in (r.lever_m.min(), r.lever_m.max())),
            ),
            below=also((r.q[0], r.q[-1]), r.unit),
            dot=joint_colour(names, r.cylinder.joint),
        )
        for r in check.ranges
    ]
    return table(head, rows)


def _figure(robot: Robot, r: CylinderRange) -> Figure:
    colour = joint_colour(robot.joint_names, r.cylinder.joint)
    joint, load = Axis(r.cylinder.joint, r.unit), "load, over poses of the rest"
    q = joint.of(r.q)
    traces = [
        line("stroke", (q, r.stroke_m), colour),
        _level("ends of the stroke", q, 0.0),
        _level("", q, r.cylinder.stroke_m),
        line("lever arm", (q, r.lever_m), colour, panel=1),
        _level("", q, 0.0, panel=1),
        line(load, (q, 1e-3 * r.load_low_n), colour, panel=2),
        line(load, (q, 1e-3 * r.load_high_n), colour, panel=2, legend=False),
        _level("what the supply gives", q, 1e-3 * r.push_n, panel=2),
        _level("", q, 1e-3 * r.pull_n, panel=2),
    ]
    panels = ("stroke in m", "lever arm in m", "load at rest in kN")
    return Figure(r.cylinder.name, joint, panels, traces)


def _level(name: str, q: FloatArray, value: float, *, panel: int = 0) -> dict[str, Any]:
    ends = q[[0, -1]]
    level = (ends, np.full(2, value))
    return line(name, level, BEFORE, panel=panel, dash="dash", legend=bool(name))


def _bodies(robot: Robot) -> Section:
    named = zip(STANDARD_PARAMETERS, STANDARD_UNITS, strict=True)
    head = ("link", *(f"{name}, {unit_text(unit)}" for name, unit in named))
    rows = [
        Row(
            (link, *(number(float(v)) for v in values)),
            dot=joint_colour(robot.joint_names, joint),
        )
        for link, joint, values in zip(
            robot.link_names, robot.joint_names, datasheet_inertia(robot), strict=True
        )
    ]
    lead = "Of the URDF, fixed attachments included; moments and inertias in the joint's frame."
    # Names alone: the page is passed on, and paths are of the computer that it was made on.
    names = [f"`{file.name}`" for file in (robot.source, robot.urdf) if file is not None]
    files = f"Files: {', '.join(names)}."
    return Section("bodies", "Bodies", lead, table(head, rows) + paragraph(files))
