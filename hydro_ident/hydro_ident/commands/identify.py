"""`hydro_ident identify`: bags in, parameters, a model and a report out."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from hydro_ident.commands.results_folder import deliver, origin_of, write_files
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json
from hydro_model.command_line.terminal import progress_bar

if TYPE_CHECKING:
    from hydro_ident.identify.identification import Identification, Settings
    from hydro_ident.identify.results import Provenance
    from hydro_ident.parameters.model_statistics import Statistics
    from hydro_ident.parameters.parameters import Parameter
    from hydro_model.robot import Robot

_EPILOG = """\
DIR gets result.json and report.html and, unless the data were not enough, model.yaml (a robot
file), controller.yaml (a ROS parameters file) and, where bodies with these base parameters can
exist, identified.urdf with such bodies. An earlier result there is replaced, and that is said on
standard error. Exit 0 done; 1 the data were not enough; 2 bad usage or unreadable input, nothing
written. Without plotly there is no report.html, which a line says and no exit code; without
clarabel it does not begin.
"""


def _add_filters(p: argparse.ArgumentParser) -> None:
    filters = p.add_argument_group("filters of the force channels (zero-phase Butterworth)")
    filters.add_argument(
        "--differentiation-cutoff",
        type=float,
        default=25.0,
        metavar="HZ",
        help="of positions before they are differentiated, and of forces (default %(default)g)",
    )
    filters.add_argument(
        "--parallel-cutoff",
        type=float,
        default=10.0,
        metavar="HZ",
        help="of both sides of the equation that is fitted (default %(default)g)",
    )
    filters.add_argument(
        "--filter-order",
        type=int,
        default=4,
        metavar="N",
        help="of one pass (default %(default)d)",
    )
    filters.add_argument(
        "--decimation",
        type=int,
        default=0,
        metavar="N",
        help="fit every N-th sample; 1: all (default: two per period of the parallel cut-off)",
    )


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
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
    p.add_argument(
        "--compare",
        metavar="MODEL",
        help="an earlier model.yaml: what changed since, per parameter, with its significance",
    )
    p.add_argument(
        "--hold-out",
        type=int,
        default=5,
        metavar="N",
        help="without --validate, keep every N-th block from the fit and score on it; 0: fit"
        " everything, score nothing (default %(default)d)",
    )
    _add_filters(p)
    p.add_argument(
        "--estimator",
        choices=("auto", "ols", "wls", "robust", "iv"),
        default="auto",
        help="ordinary, weighted by each channel's noise, robust against outliers and dropouts, or"
        " with the recorded references as instruments (default %(default)s: robust where samples"
        " stand out, iv where the references show a bias, else wls)",
    )
    p.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="spread the bags over this Dask cluster, which sees them under the same paths",
    )
    p.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the results")
    add_json(p, "result.json's content")
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    options = parser().parse_args(arguments)
    from hydro_ident.identify.compare import Sides, compare
    from hydro_ident.identify.earlier_model import check_same_machine
    from hydro_ident.identify.identification import identify
    from hydro_ident.identify.results import REPORT_FILE, result_dict
    from hydro_ident.identify.verdict import NOT_ENOUGH
    from hydro_ident.optional import require, say_if_no_report
    from hydro_ident.parameters.model_statistics import Statistics, read_statistics
    from hydro_ident.recordings.sources import bag_sources
    from hydro_ident.recordings.workers import workers_at
    from hydro_model.robot_files import load_robot

    require("clarabel", "bodies that can exist")
    say_if_no_report("identify", REPORT_FILE, "all other files are")
    robot = load_robot(options.robot, narrow=True)
    settings = settings_of(options)
    old = load_robot(options.compare, narrow=True) if options.compare else None
    if old is not None:
        check_same_machine(old, robot, options.compare)
    training, validation = bag_sources(options.bags, options.validate, robot)
    sources, robots = (training, validation), (robot, old)
    origin = origin_of(options, parser(), _RESULT_OPTIONS, sources, robots)
    with workers_at(options.scheduler) as workers, progress_bar():
        found = identify(robot, training, validation, settings, workers)
    if old is not None and found.robot is not None:
        before = Statistics() if old.source is None else read_statistics(old.source)
        sides = Sides(before, found_statistics(found, origin))
        comparison = compare(old, found.robot, found.parameters, options.compare, sides)
        found = replace(found, comparison=comparison)
    return deliver(
        "identify",
        options,
        lambda folder: write_results(found, origin, folder),
        (result_dict(found, origin), summary_text(found)),
        found.problems if found.verdict == NOT_ENOUGH else None,
    )


#: Command-line options of the filters and the field of `FilterSettings` that each one sets.
_FILTER_OPTIONS = {
    "differentiation_cutoff": "differentiation_hz",
    "parallel_cutoff": "parallel_hz",
    "filter_order": "order",
    "decimation": "keep_every",
}
#: Options that the result depends on, besides its bags and its robot.
_RESULT_OPTIONS = ("validate", "compare", "hold_out", "estimator", *_FILTER_OPTIONS)


def settings_of(options: argparse.Namespace) -> Settings:
    """The estimators' settings of a command line.

    `options` is what argparse made of it.
    """
    from hydro_ident.errors import IdentError
    from hydro_ident.estimate.signals.derivatives import FilterSettings
    from hydro_ident.identify.identification import Settings

    chosen = {field: getattr(options, name) for name, field in _FILTER_OPTIONS.items()}
    if options.hold_out < 0 or options.hold_out == 1:
        raise IdentError(f"expected --hold-out of 0, 2 or more, found {options.hold_out}")
    filters = FilterSettings(**chosen)
    return Settings(filters=filters, hold_out_every=options.hold_out, estimator=options.estimator)


def found_statistics(found: Identification, origin: Provenance) -> Statistics:
    """What later comparisons have to know of an identification.

    `origin` names the bags.
    """
    from hydro_ident.parameters.model_statistics import statistics_of

    return statistics_of(
        found.parameters, found.inertial, found.hydraulic, found.channels, origin.bags
    )


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
    from hydro_ident.identify.results import result_json
    from hydro_ident.report.identification_report import report_html

    write_files(
        folder,
        result_json(found, origin),
        lambda: report_html(found, origin.as_dict()),
        None if found.robot is None else partial(_write_robot, found.robot, found, origin),
    )


def _write_robot(robot: Robot, found: Identification, origin: Provenance, folder: Path) -> None:
    from hydro_ident.identify.model_file import write_model
    from hydro_ident.identify.results import MODEL_FILE, URDF_FILE
    from hydro_ident.identify.urdf_file import write_urdf

    statistics = found_statistics(found, origin)
    write_model(robot, folder / MODEL_FILE, origin.as_dict(), statistics)
    write_urdf(robot, folder / URDF_FILE)


def summary_text(found: Identification) -> str:
    """The result as a table for the terminal."""
    from hydro_ident.identify.validation_results import comparison_lines, rollout_lines

    lines = [f"verdict: {found.verdict}"]
    if found.estimator is not None:
        lines.append(f"estimator: {found.estimator.name}: {found.estimator.reason}")
    lines += [f"problem: {text}" for text in found.problems]
    lines += [f"lost: {loss.bag}: {loss.channel}: {loss.reason}" for loss in found.losses]
    lines += [f"note: {text}" for text in found.notes]
    lines += [*_parameter_lines(found), *_channel_lines(found)]
    lines += rollout_lines(found.free_run)
    lines += [] if found.comparison is None else comparison_lines(found.comparison)
    return "\n".join(lines)


def _parameter_lines(found: Identification) -> list[str]:
    from hydro_ident.everyday_units import beside
    from hydro_ident.parameters.parameters import student_95

    names = [_short(p) for p in found.parameters]
    width = max(map(len, names), default=0)
    lines = ["parameters, +- half the 95 % interval:"] if names else []
    for name, p in zip(names, found.parameters, strict=True):
        given = "" if p.datasheet is None else f"  (given {p.datasheet:.5g})"
        told = beside((p.value,), p.unit)
        told = f" = {told}" if told else ""
        rest = "  HELD" if p.held else "  NOT USED" if p.reason else "  NOT DETERMINED"
        mark = "" if p.identifiable else rest
        error = "" if p.untold else f" +- {student_95(p.dof) * p.std:9.3g}"
        lines.append(f"  {name:{width}}  {p.value:12.5g}{error} {p.unit}{told}{given}{mark}")
    return lines


def _channel_lines(found: Identification) -> list[str]:
    from hydro_ident.everyday_units import bracketed
    from hydro_ident.identify.rejection import rejected_channels

    rejected = rejected_channels(found.given, found.inertial, found.hydraulic)
    lines = []
    for channel in found.channels:
        s = channel.summary()
        mark = "  REJECTED, not in model.yaml" if channel.name in rejected else ""
        before, after = float(s["rmse_before"]), float(s["rmse_after"])
        more = bracketed((before, after), channel.unit, " -> ")
        lines.append(
            f"  {channel.name:14} RMSE {before:10.4g} -> {after:10.4g}"
            f" {channel.unit}{more}, fit {s['fit_before_pct']:6.1f} ->"
            f" {s['fit_after_pct']:5.1f} %{mark}"
        )
    return lines


def _short(parameter: Parameter) -> str:
    """A name that fits a line; the sum it stands for is in the report and in result.json."""
    others = len(parameter.combination.keys() - {parameter.name})
    return parameter.name + (f" + {others} more" if others else "")


def main() -> int:
    """Entry point."""
    return run_command("identify", run)


if __name__ == "__main__":
    sys.exit(main())
