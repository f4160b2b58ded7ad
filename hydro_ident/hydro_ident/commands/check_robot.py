"""`check_robot`: whether a robot description can be true, with a drawing of it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report, write_text
from hydro_model.command_line.terminal import coloured

if TYPE_CHECKING:
    from hydro_ident.robots.robot_check import RobotCheck

_COLOURS = {"error": "red", "warning": "yellow"}


def main(arguments: Sequence[str] | None = None) -> int:
    """The `check_robot` executable."""
    return run_command("check_robot", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="check_robot",
        description="Check a robot description: strokes within the cylinders, lever arms, loads at"
        " rest, masses, numbers in another unit, and what the file leaves to defaults; draw its"
        " geometry.",
        epilog="Exit 0 nothing wrong; 1 an error in the description; 2 bad usage or an unreadable"
        " file. Without plotly nothing is drawn, which a line says and no exit code.",
    )
    parser.add_argument(
        "robot", metavar="ROBOT", help="*.hydraulics.yaml, model.yaml or a shipped robot"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.html", help="draw links, pins, strokes and lever arms"
    )
    add_json(parser, "the findings")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    from hydro_ident.optional import installed, say_if_no_report
    from hydro_ident.robots.robot_check import check_robot
    from hydro_model.robot_files import load_robot

    if options.out is not None:
        say_if_no_report("check_robot", str(options.out), "the description is checked")
    check = check_robot(load_robot(options.robot, check_strokes=False))
    if options.out is not None and installed("plotly"):
        from hydro_ident.report.robot_report import robot_html

        write_text(options.out, robot_html(check))
    report(options.json, check.as_dict(), "\n".join(lines_of(check)))
    return 1 if check.wrong else 0


def lines_of(check: RobotCheck) -> Iterator[str]:
    """A check as lines for a person.

    Parameters
    ----------
    check : RobotCheck

    Yields
    ------
    str
    """
    robot = check.robot
    count = len(robot.cylinders)
    joints = f"{robot.dof} joint{'' if robot.dof == 1 else 's'}"
    yield f"{robot.name}: {joints}, {count} cylinder{'' if count == 1 else 's'} ({robot.source})"
    if check.ranges:
        yield ""
        yield (
            f"{'cylinder':20s} {'joint range':>20s} {'stroke m':>16s} {'of':>6s} {'lever m':>16s}"
        )
    for r in check.ranges:
        joint = f"{r.q[0]:.3f} to {r.q[-1]:.3f} {r.unit}"
        stroke = f"{r.stroke_m.min():.3f} to {r.stroke_m.max():.3f}"
        lever = f"{r.lever_m.min():.3f} to {r.lever_m.max():.3f}"
        yield (
            f"{r.cylinder.name:20s} {joint:>20s} {stroke:>16s} {r.cylinder.stroke_m:6.3f}"
            f" {lever:>16s}"
        )
    yield ""
    if not check.remarks:
        yield "nothing to remark"
    for remark in check.remarks:
        level = f"{remark.level.upper():8s}"
        colour = _COLOURS.get(remark.level)
        level = coloured(level, colour) if colour else level
        yield f"{level} {remark.about}: {remark.text}"
