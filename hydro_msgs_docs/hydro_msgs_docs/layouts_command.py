"""`live_layouts`: layout files of PlotJuggler and Foxglove for a robot."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report_files, unwritable, write_text
from hydro_msgs_docs.errors import ContractError


class LayoutError(ContractError):
    """A layout that cannot be written (exit code 2)."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The `live_layouts` executable."""
    return run_command("live_layouts", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="live_layouts",
        description="Write layouts for PlotJuggler and Foxglove: bringup, tracking, diagnosis.",
    )
    parser.add_argument("--robot", required=True, help="robot file or shipped robot")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="gets plotjuggler/*.xml and foxglove/*.json; what is there is replaced",
    )
    add_json(parser, "the files written")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    from hydro_model.robot_files import load_robot
    from hydro_msgs_docs.layout_files import foxglove, plotjuggler
    from hydro_msgs_docs.live_layouts import views

    texts = {}
    for view in views(load_robot(options.robot)):
        texts[options.out / "plotjuggler" / f"{view.name}.xml"] = plotjuggler(view)
        texts[options.out / "foxglove" / f"{view.name}.json"] = foxglove(view)
    write_layouts(texts)
    report_files(options.json, "hydro_msgs_docs/live_layouts/1", list(texts))
    return 0


def write_layouts(texts: Mapping[Path, str]) -> None:
    """Write files, and the folders they lie in.

    Parameters
    ----------
    texts : mapping of Path to str

    Raises
    ------
    LayoutError
        One cannot be written.
    """
    for path, text in texts.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LayoutError(unwritable(path, error)) from error
        write_text(path, text)
