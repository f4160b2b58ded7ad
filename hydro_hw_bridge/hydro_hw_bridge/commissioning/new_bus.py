"""`new_bus`: DBC and mapping for a robot whose own I/O is not there yet, to rehearse it by."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from hydro_hw_bridge.errors import BridgeError
from hydro_model.command_line.command import Parser, run_command, warn
from hydro_model.command_line.output import OutputError, add_json, report_files, write_text

NAME = "new_bus"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return run_command(NAME, _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog=NAME,
        description="Write NAME.dbc and NAME.mapping.yaml for a robot, of an I/O module that"
        " nobody has built: the simulated rig and the bridge speak it.",
    )
    parser.add_argument("--robot", required=True, help="robot file or shipped robot")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for both")
    parser.add_argument("--force", action="store_true", help="write anew what is there")
    add_json(parser, "the files written")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    from hydro_hw_bridge.commissioning.bus_files import bus_files
    from hydro_hw_bridge.protocol.codec import Codec
    from hydro_model.robot_files import load_robot

    robot = load_robot(options.robot)
    names = f"{robot.name}.dbc", f"{robot.name}.mapping.yaml"
    made = bus_files(robot, names[0])
    texts = dict(zip(names, (made.dbc, made.mapping), strict=True))
    there = [name for name in names if (options.out / name).exists()]
    if there and not options.force:
        raise BridgeError(f"{options.out / there[0]} is there already: --force writes it anew")
    # What the bridge would not take is not left behind.
    with tempfile.TemporaryDirectory() as folder:
        dbc, mapping = _written(Path(folder), texts)
        codec = Codec.load(dbc, mapping, robot)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{options.out}: cannot be made: {error.strerror}") from error
    files = _written(options.out, texts)
    if not made.fits_a_wire:
        load = codec.layout.describe_load()
        warn(NAME, [f"no CAN wire carries that, it is for a rehearsal alone: {load}"])
    report_files(options.json, "hydro_hw_bridge/new_bus/1", files)
    return 0


def _written(folder: Path, texts: dict[str, str]) -> list[Path]:
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


if __name__ == "__main__":
    sys.exit(main())
