"""`hydro_ident identify`: bags in, parameters, a model and a report out."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hydro_model.command import run_command

if TYPE_CHECKING:
    from hydro_ident.identification import Identification
    from hydro_ident.results import Provenance

_EPILOG = """\
DIR gets result.json and report.html and, unless the data were not enough, model.yaml (a robot
file) and controller.yaml (a ROS parameters file). Exit 0 done; 1 the data were not enough;
2 bad usage or unreadable input, nothing written.
"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="identify",
        description="Identify base inertial parameters, friction, bulk modulus and valve edges,"
        " and the effects that the robot file lists, from recorded bags.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 directory or .mcap file")
    p.add_argument(
        "--robot",
        required=True,
        help="*.hydraulics.yaml, model.yaml or a shipped robot: geometry and listed effects",
    )
    p.add_argument(
        "--validate",
        nargs="+",
        default=[],
        metavar="BAG",
        help="bags to score the predictions on; without them every fifth block is held out",
    )
    p.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the results")
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    options = parser().parse_args(arguments)
    from hydro_ident.bag.recording import read_recording
    from hydro_ident.identification import NOT_ENOUGH, identify
    from hydro_ident.results import provenance
    from hydro_model.robot_files import load_robot

    robot = load_robot(options.robot)
    training = [read_recording(bag, robot) for bag in options.bags]
    validation = [read_recording(bag, robot) for bag in options.validate]
    # Without --out: the same input gives the same result wherever it is written.
    command = ["identify", *options.bags, "--robot", options.robot]
    command += ["--validate", *options.validate] if options.validate else []
    origin = provenance(
        shlex.join(command),
        options.robot,
        [recording.path for recording in training],
        [recording.path for recording in validation],
    )
    found = identify(robot, training, validation)
    write_results(found, origin, options.out)
    print(summary_text(found))
    if found.verdict == NOT_ENOUGH:
        print(f"identify: {'; '.join(found.problems)}", file=sys.stderr)
        return 1
    print(f"written: {options.out}")
    return 0


def write_results(found: Identification, origin: Provenance, folder: Path) -> None:
    """Write every result file of an identification, or none.

    Parameters
    ----------
    found : Identification
    origin : Provenance
    folder : Path

    Raises
    ------
    IdentError
        The folder cannot be written; what was there stays.
    """
    from hydro_ident.controller_file import controller_text
    from hydro_ident.model_file import write_model
    from hydro_ident.report.identification_report import report_html
    from hydro_ident.results import (
        CONTROLLER_FILE,
        MODEL_FILE,
        REPORT_FILE,
        RESULT_FILE,
        result_json,
        write_together,
    )

    def fill(fresh: Path) -> None:
        (fresh / RESULT_FILE).write_text(result_json(found, origin), encoding="utf-8")
        (fresh / REPORT_FILE).write_text(report_html(found, origin.as_dict()), encoding="utf-8")
        if found.robot is not None:
            write_model(found.robot, fresh / MODEL_FILE, origin.as_dict())
            text = controller_text(folder / MODEL_FILE)
            (fresh / CONTROLLER_FILE).write_text(text, encoding="utf-8")

    write_together(folder, fill)


def summary_text(found: Identification) -> str:
    """The result as a table for the terminal."""
    from hydro_ident.report.identification_report import readable

    lines = [f"verdict: {found.verdict}"]
    lines += [f"problem: {text}" for text in found.problems]
    lines += [f"note: {text}" for text in found.notes]
    width = max((len(readable(p)) for p in found.parameters), default=0)
    for p in found.parameters:
        given = "" if p.datasheet is None else f"  (given {p.datasheet:.5g})"
        mark = "" if p.identifiable else "  NOT DETERMINED"
        lines.append(
            f"  {readable(p):{width}}  {p.value:12.5g} +- {p.std:9.3g} {p.unit}{given}{mark}"
        )
    for channel in found.channels:
        s = channel.summary()
        lines.append(
            f"  {channel.name:14} RMSE {s['rmse_before']:10.4g} -> {s['rmse_after']:10.4g}"
            f" {channel.unit}, fit {s['fit_before_pct']:6.1f} -> {s['fit_after_pct']:5.1f} %"
        )
    return "\n".join(lines)


def main() -> int:
    """Entry point."""
    return run_command("identify", run)


if __name__ == "__main__":
    sys.exit(main())
