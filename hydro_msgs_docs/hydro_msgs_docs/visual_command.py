"""`visual_urdf`: a robot to look at, for RViz and robot_state_publisher."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report_files
from hydro_msgs_docs.layouts_command import write_layouts

_EPILOG = """\
Writes NAME.urdf (the robot's own with plain bodies and moving cylinders), NAME.rviz and
robot_state_publisher.yaml. The node visual_joints publishes the positions of all its joints.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """The `visual_urdf` executable."""
    return run_command("visual_urdf", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="visual_urdf",
        description="Write a robot to look at, for RViz and robot_state_publisher.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--robot", required=True, help="robot file or shipped robot")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="what is there is replaced"
    )
    add_json(parser, "the files written")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    from hydro_model.robot_files import load_robot
    from hydro_msgs_docs.rviz_files import rviz_view, state_publisher_parameters
    from hydro_msgs_docs.visual_urdf import visual_urdf

    robot = load_robot(options.robot)
    urdf = visual_urdf(robot)
    texts = {
        options.out / f"{robot.name}.urdf": urdf,
        options.out / f"{robot.name}.rviz": rviz_view(robot),
        options.out / "robot_state_publisher.yaml": state_publisher_parameters(urdf),
    }
    write_layouts(texts)
    report_files(options.json, "hydro_msgs_docs/visual_urdf/1", list(texts))
    return 0
