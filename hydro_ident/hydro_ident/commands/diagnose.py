"""`hydro_ident diagnose`: what physics a model leaves out, from recorded bags."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from hydro_ident.commands.results_folder import deliver, origin_of, write_files
from hydro_ident.mismatch.settings import LONGEST_S, LONGEST_SCAN_S
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json
from hydro_model.command_line.terminal import progress_bar

if TYPE_CHECKING:
    from hydro_ident.identify.results import Provenance
    from hydro_ident.mismatch.answer.outcome import Diagnosis, Finding
    from hydro_model.robot import Robot

#: Options that the result depends on, besides its bags and its robot.
_RESULT_OPTIONS = ("validate", "fixed_base", "refine", "longest")

_EPILOG = """\
DIR gets result.json and report.html and, unless the data were not enough, model.yaml (a robot
file with the effects that were found) and controller.yaml (a ROS parameters file). An earlier
result there is replaced, and that is said on standard error. Exit 0 done; 1 the data were not
enough; 2 bad usage or unreadable input, nothing written. Without plotly there is no report.html,
which a line says and no exit code.
"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="diagnose",
        description="Locate, name, model and verify the physics that a robot's model leaves out,"
        " from recorded bags.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("bags", nargs="+", metavar="BAG", help="rosbag2 directory or .mcap file")
    p.add_argument(
        "--robot",
        required=True,
        help="*.hydraulics.yaml, model.yaml or a shipped robot: the structure that is refitted",
    )
    p.add_argument(
        "--validate",
        nargs="+",
        default=[],
        metavar="BAG",
        help="bags to verify on; without them every fifth block is held out",
    )
    p.add_argument(
        "--fixed-base",
        action="store_true",
        help="keep the robot's base parameters as they are (to their stated deviations), so that"
        " payload, offsets and tilt can be told",
    )
    p.add_argument(
        "--refine",
        action="store_true",
        help="refine the effects' parameters by roll-outs over windows of the bags, where that"
        " rolls held-out windows out better (some seconds more)",
    )
    p.add_argument(
        "--longest",
        type=float,
        default=LONGEST_S,
        metavar="S",
        help="of longer recordings so many seconds are fitted, and as many verified on, in evenly"
        f" spread parts: {LONGEST_SCAN_S:g} or more (default: %(default)g)",
    )
    p.add_argument(
        "--processes",
        type=int,
        metavar="N",
        help="fits that go on side by side, the results are the same; each takes some hundred MB"
        " (default: as many as there are cores, at most 4)",
    )
    p.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the results")
    add_json(p, "result.json's content")
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    return diagnosed(parser().parse_args(arguments))[0]


def diagnosed(options: argparse.Namespace) -> tuple[int, Diagnosis]:
    """Diagnose as parsed options ask, write every result and say what was found.

    Parameters
    ----------
    options : Namespace
        Of `parser`.

    Returns
    -------
    int
        The command's exit code.
    Diagnosis

    Raises
    ------
    IdentError
        A bag cannot be read, or the folder not written.
    RobotError
        The robot file says what cannot be.
    """
    from hydro_ident.identify.results import REPORT_FILE
    from hydro_ident.mismatch.answer.diagnosis import diagnose
    from hydro_ident.mismatch.answer.diagnosis_file import result_dict
    from hydro_ident.mismatch.answer.outcome import NOT_ENOUGH
    from hydro_ident.mismatch.fitting.side_by_side import cores
    from hydro_ident.mismatch.settings import DiagnosisSettings, RefineSettings
    from hydro_ident.optional import say_if_no_report
    from hydro_ident.recordings.sources import bag_sources
    from hydro_model.robot_files import load_robot

    say_if_no_report("diagnose", REPORT_FILE, "all other files are")
    robot = load_robot(options.robot, narrow=True)
    training, validation = bag_sources(options.bags, options.validate, robot)
    sources = training, validation
    origin = origin_of(options, parser(), _RESULT_OPTIONS, sources, (robot, None))
    settings = DiagnosisSettings(
        options.fixed_base,
        refine=RefineSettings() if options.refine else None,
        longest_s=options.longest,
        processes=cores() if options.processes is None else options.processes,
    )
    with progress_bar():
        found = diagnose(robot, training, validation, settings)
    code = deliver(
        "diagnose",
        options,
        lambda folder: write_results(found, origin, folder),
        (result_dict(found, origin), summary_text(found)),
        found.problems if found.verdict == NOT_ENOUGH else None,
    )
    return code, found


def write_results(found: Diagnosis, origin: Provenance, folder: Path) -> None:
    """Write every result file of a diagnosis, or none.

    Parameters
    ----------
    found : Diagnosis
    origin : Provenance
    folder : Path

    Raises
    ------
    IdentError
        The folder cannot be written; what was there stays.
    """
    from hydro_ident.mismatch.answer.diagnosis_file import result_json
    from hydro_ident.report.diagnosis_report import report_html

    write_files(
        folder,
        result_json(found, origin),
        lambda: report_html(found, origin.as_dict()),
        None if found.robot is None else partial(_write_robot, found.robot, origin),
    )


def _write_robot(robot: Robot, origin: Provenance, folder: Path) -> None:
    from hydro_ident.identify.model_file import write_model
    from hydro_ident.identify.results import MODEL_FILE

    write_model(robot, folder / MODEL_FILE, origin.as_dict())


def summary_text(found: Diagnosis) -> str:
    """The result as lines for the terminal."""
    from hydro_ident.everyday_units import bracketed, told
    from hydro_ident.identify.validation_results import rollout_lines
    from hydro_ident.mismatch.answer.diagnosis_file import channel_dict
    from hydro_ident.mismatch.unnamed.describe import each_form, form_text

    lines = [f"verdict: {found.verdict}"]
    lines += [f"problem: {text}" for text in found.problems]
    lines += [f"lost: {loss.bag}: {loss.channel}: {loss.reason}" for loss in found.losses]
    for one in found.findings:
        lines += _finding_lines(found, one)
    for unknown in found.unexplained:
        lines.append(f"unexplained: {told(unknown.text)}")
        lines += [f"    a form of it: {form_text(form)}" for form in each_form(unknown.form)]
    if found.channels:
        lines.append("all held-out rows, without any finding -> with all of them:")
    for channel in found.channels:
        s = channel_dict(channel)
        before, after = float(s["rmse_before"]), float(s["rmse_after"])
        more = bracketed((before, after), channel.unit, " -> ")
        lines.append(
            f"  {channel.name:14} RMSE {before:10.4g} -> {after:10.4g}"
            f" {channel.unit}{more}, noise alone {s['noise_floor']:.3g}"
        )
    lines += rollout_lines(found.free_run)
    lines += [f"note: {text}" for text in found.notes]
    return "\n".join(lines)


def _finding_lines(found: Diagnosis, one: Finding) -> list[str]:
    """A finding: its names, the law in the model, its numbers and what held-out rows say."""
    from hydro_ident.everyday_units import bracketed, told
    from hydro_ident.mismatch.answer.diagnosis_file import finding_dict
    from hydro_ident.report.found_words import as_share, corners, law_in_model

    data = finding_dict(found, one)
    pairs = zip(data["names"], data["probability"], strict=True)
    names = " or ".join(f"{name} ({share:.0%})" for name, share in pairs)
    law = law_in_model(data)
    names += f", modelled as {law}" if law else ""
    where = told(data["where"]["text"])
    lines = [f"found in {data['channel']}, of {data['target']}: {names}, {where}"]
    for p in data["parameters"]:
        std = "" if p["std"] is None else f" +- {p['std']:.3g}"
        share = as_share(p["name"], p["value"])
        unit = f" ({share})" if share else "" if p["unit"] == "1" else f" {p['unit']}"
        more = bracketed((p["value"],), p["unit"])
        vague = ": no larger than its error" if (p["std"] or 0.0) > abs(p["value"]) else ""
        lines.append(f"    {p['name']} = {p['value']:.5g}{std}{unit}{more}{vague}")
    for p in corners(data):
        std = "" if p["std"] is None else f" +- {p['std']:.3g}"
        lines.append(
            f"    {p['name']} = {p['value']:.5g}{std} {p['unit']}: damped beyond 1, it lags as its"
            " slower pole does, and that is what the data tell"
        )
    before, after = data["heldout_rmse_before"], data["heldout_rmse_after"]
    units = {channel.name: channel.unit for channel in (*found.channels, *found.fitted)}
    if before is None:
        lines.append(f"    the rows to verify on do not measure {data['channel']}")
    elif data["heldout_exercised"]:
        lines.append(
            "    held-out RMSE in motion, with every other finding in the model:"
            f" {before:.4g} -> {after:.4g} {units.get(data['channel'], '')} with it"
        )
    else:
        freed = (
            " themselves; in motion the base that it frees predicts them better, RMSE"
            f" {before:.4g} -> {after:.4g} {units.get(data['channel'], '')}"
        )
        more = freed if one.verification.by_base(data["channel"]) else ""
        lines.append(f"    the rows to verify on do not exercise it{more}")
    if len(data["names"]) > 1:
        lines.append(f"    to tell them apart: {data['separating_experiment']}")
    return lines


def main() -> int:
    """Entry point."""
    return run_command("diagnose", run)


if __name__ == "__main__":
    sys.exit(main())
