"""`compare_tracking`: several runs of one path in one table."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydro_model.command_line.command import Parser, run_command, warn
from hydro_model.command_line.output import add_json, report
from hydro_model.command_line.terminal import advance, progress_bar

if TYPE_CHECKING:
    from hydro_ident.recordings.metrics import Tracking

#: A run faster than its reference by more than this share is void: rho rewards oscillation.
SPEED_EXCESS = 0.10
#: References that differ by more than this share in length or speed are not of one path.
_SAME = 0.01
_HEADS = ("RMSE mm", "max error mm", "max speed m/s", "rho s")
_KEYS = ("rmse_mm", "max_error_mm", "max_speed_m_s", "rho_s")


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="compare_tracking",
        description="Tip tracking of several runs, side by side: by the rig's true tip and by"
        " the encoders. A run whose largest speed exceeds the reference's by more than"
        f" {SPEED_EXCESS:.0%} is void, and so is one whose reference is not that of the longest"
        " run (another path, or one that was cut short); the command then exits with 1.",
    )
    p.add_argument(
        "runs", nargs="+", metavar="NAME=BAG,TRUTH", help="a name, a bag and the rig's side file"
    )
    p.add_argument("--robot", required=True, help="robot whose kinematics give the tip")
    p.add_argument("--against", metavar="NAME", help="print the other runs' RMSE over this one's")
    add_json(p)
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    options = parser().parse_args(arguments)
    from hydro_ident.bag.reader import read_bag
    from hydro_ident.bag.recording import RECORDING_TOPICS
    from hydro_ident.commands.tracking import tracking_of, warnings_of
    from hydro_ident.errors import IdentError
    from hydro_model.robot_files import load_robot

    robot = load_robot(options.robot, narrow=True)
    rows, warnings = {}, []
    with progress_bar():
        for number, text in enumerate(options.runs):
            name, path, truth = _parts(text)
            bag = read_bag(path, RECORDING_TOPICS)
            advance(f"run {number + 1} of {len(options.runs)}: {name}", number, len(options.runs))
            rows[name] = tracking_of(bag, robot, truth)
            warnings += [f"{name}: {text}" for text in warnings_of(bag, robot, rows[name])]
    if options.against is not None and options.against not in rows:
        raise IdentError(
            f"--against: expected one of {', '.join(rows)}, found '{options.against}'"
        )
    lines = [table(rows)]
    lines += [] if options.against is None else ratios(rows, options.against)
    report(options.json, as_dict(rows), "\n".join(lines))
    warn("compare_tracking", warnings)
    apart = other_paths(rows)
    void = [name for name, row in rows.items() if is_void(row["truth"]) or name in apart]
    if void:
        print(f"compare_tracking: void: {', '.join(void)}", file=sys.stderr)
    for text in apart.values():
        print(f"compare_tracking: {text}", file=sys.stderr)
    return 1 if void else 0


def _parts(text: str) -> tuple[str, Path, Path]:
    from hydro_ident.errors import IdentError

    name, _, files = text.partition("=")
    bag, _, truth = files.partition(",")
    if not (name and bag and truth):
        raise IdentError(f"expected NAME=BAG,TRUTH, found '{text}'")
    return name, Path(bag), Path(truth)


def as_dict(rows: Mapping[str, Mapping[str, Tracking]]) -> dict[str, Any]:
    """The rows by the true tip, and under `encoders` the same by the encoders."""

    def figures(row: Tracking) -> dict[str, float]:
        return {key: getattr(row, key) for key in _KEYS}

    true = {name: figures(row["truth"]) for name, row in rows.items()}
    return {**true, "encoders": {n: figures(row["encoders"]) for n, row in rows.items()}}


def is_void(row: Tracking) -> bool:
    """Whether a run was faster than its reference allows.

    `row` holds the figures of the run.
    """
    return row.max_speed_m_s > (1.0 + SPEED_EXCESS) * row.reference_speed_m_s


def other_paths(rows: Mapping[str, Mapping[str, Tracking]]) -> dict[str, str]:
    """Runs whose reference is another one than that of the longest, each with a sentence.

    A run that was stopped on its way has little error: it is no better for that.

    `rows` are as for `ratios`.
    """
    longest = max(rows, key=lambda name: rows[name]["encoders"].duration_s)
    whole = _moved(rows[longest]["encoders"])
    found = {}
    for name, row in rows.items():
        own = _moved(row["encoders"])
        if any(abs(a - b) > _SAME * b for a, b in zip(own, whole, strict=True)):
            found[name] = (
                f"{name} followed another path than {longest}, or was cut short: its reference"
                f" moves for {own[0]:.2f} s at up to {own[1]:.3f} m/s, that of {longest} for"
                f" {whole[0]:.2f} s at up to {whole[1]:.3f} m/s"
            )
    return found


def _moved(row: Tracking) -> tuple[float, float]:
    """For how long and how fast a run's reference moves."""
    return row.duration_s, row.reference_speed_m_s


def ratios(rows: Mapping[str, Mapping[str, Tracking]], against: str) -> list[str]:
    """How many times larger each other run's true RMSE is.

    `against` is the run that the others are divided by.

    `rows` hold the figures of every run, by its name and by what measured them.
    """
    best = rows[against]["truth"].rmse_mm
    return [
        f"RMSE of {name} is {row['truth'].rmse_mm / best:.2f} times that of {against}"
        for name, row in rows.items()
        if name != against
    ]


def table(rows: Mapping[str, Mapping[str, Tracking]]) -> str:
    """The table for the terminal.

    `rows` are as for `ratios`.
    """
    width = max(len(name) for name in rows) + 2
    lines, apart = [], other_paths(rows)
    for source, title in (("truth", "true tip"), ("encoders", "by encoders")):
        lines.append(f"{title:{width + 2}}" + "".join(f"{head:>15}" for head in _HEADS))
        for name, row in rows.items():
            values = "".join(f"{getattr(row[source], key):15.4f}" for key in _KEYS)
            void = is_void(row[source]) or name in apart
            lines.append(f"  {name:{width}}{values}" + ("  VOID" if void else ""))
    return "\n".join(lines)


def main() -> int:
    """Entry point."""
    return run_command("compare_tracking", run)


if __name__ == "__main__":
    sys.exit(main())
