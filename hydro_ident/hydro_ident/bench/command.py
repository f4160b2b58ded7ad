"""`bench`: our work against what a user would take instead, a floor or a limit, in turns.

    scripts/bench.sh [--json F] [--rounds 5] [--only GROUP ...] [--growth MINUTES MINUTES ...]
    scripts/bench.sh --publish DIR

Peers are optional (requirements-bench.in); those that are not installed are said and skipped.
That results agree is checked before anything is timed. Ratios are those of medians over rounds;
the absolute times of a shared machine mean little. `--publish` measures nothing: it makes the
tables of performance.md in DIR anew from the results of bench, growth and soaks in it, and says
which of the measured sources have changed since. What rows are made of stands beside them, in
F_made.json.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_ident.bench import (
    bag_jobs,
    chain_jobs,
    diagnose_jobs,
    fit_jobs,
    growth,
    limits,
    made,
    model_jobs,
    names,
    page,
)
from hydro_ident.bench.job import Job, Row, run
from hydro_ident.bench.soak_page import SOAKS, with_soaks
from hydro_ident.errors import IdentError
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import write_atomically


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of `python -m hydro_ident.bench`."""
    return run_command("bench", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="bench", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--json", type=Path, metavar="F", help="write the rows as JSON")
    parser.add_argument("--rounds", type=int, default=5, help="rounds of each job (default 5)")
    parser.add_argument(
        "--only",
        choices=sorted(_GROUPS),
        nargs="*",
        default=list(_GROUPS),
        help="groups of jobs; none of them but --growth where none is named",
    )
    parser.add_argument(
        "--growth",
        type=float,
        nargs="+",
        metavar="MINUTES",
        help="also how time and memory of inspect, identify, recorder, player and (up to 10"
        " minutes) diagnose grow with a bag",
    )
    parser.add_argument(
        "--publish",
        type=Path,
        metavar="DIR",
        help="only make the tables of the documentation in DIR anew from its results",
    )
    parser.add_argument(
        "--root", type=Path, default=Path(), metavar="DIR", help="repository (default: here)"
    )
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    if options.rounds < 1 or (options.growth is not None and len(options.growth) < 2):
        raise IdentError("bench: expected --rounds of 1 or more and --growth of 2 lengths or more")
    if options.publish is not None:
        _publish(options.publish, options.root)
        return 0
    # What runs, whatever is edited meanwhile.
    of = None if options.json is None else made.made(options.root)
    threads = ", ".join(f"{name}={os.environ.get(name, 'unset')}" for name in made.THREADS)
    _say(f"threads: {threads}")
    _say(f"cores: {os.cpu_count()}, rounds: {options.rounds}; seconds unless a job says otherwise")
    _say(f"\n{page.HEAD}")
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in options.only:
            for row in _GROUPS[name](Path(folder), options.rounds):
                names.refuse_unknown([row.job], name)
                rows.append(row)
                _say(page.line(row))
        if options.growth is not None:
            for row in growth.growth_rows(options.growth, Path(folder)):
                names.refuse_unknown([row.job], "growth")
                rows.append(row)
                _say(page.line(row))
    if said := page.lost_cycles(rows):
        _say(f"\n{said}")
    if of is not None:
        _write(options.json, rows, of)
    return 0


def _say(text: str) -> None:
    print(text, flush=True)


def _publish(folder: Path, root: Path) -> None:
    path = folder / page.PAGE
    try:
        for file in (folder / "results" / name for name in (*page.RESULTS, *SOAKS)):
            if not file.is_file():
                continue
            if file.name in page.RESULTS:
                found = json.loads(file.read_text(encoding="utf-8"))
                names.refuse_unknown([one["job"] for one in found], str(file))
            if (of := made.renewed(file, root)) is not None:
                write_atomically(made.file_of(file), of)
        text = path.read_text(encoding="utf-8")
        text = page.with_tables(text, folder / "results")
        write_atomically(path, with_soaks(text, folder / "results"))
    except OSError as error:
        raise IdentError(f"{path}: cannot be published: {error.strerror}") from error


def _write(path: Path, rows: Sequence[Row], of: Mapping[str, Any]) -> None:
    text = json.dumps([row.as_json() for row in rows], indent=2, allow_nan=False) + "\n"
    try:
        made.write(path, text, of)
    except OSError as error:
        raise IdentError(f"{path}: cannot be written: {error.strerror}") from error


def _timed(jobs: Iterator[Job], rounds: int) -> Iterator[Row]:
    for job in jobs:
        try:
            yield run(job, rounds)
        except AssertionError as error:
            raise IdentError(f"{job.name}: {job.peer} does not agree: {error}") from error


def _dynamics(folder: Path, rounds: int) -> Iterator[Row]:
    try:
        pin = importlib.import_module("pinocchio")
    except ImportError:
        print("rigid body: pinocchio is not installed, skipped", file=sys.stderr)
        return
    yield from _timed(model_jobs.dynamics_jobs(pin), rounds)


def _simulation(folder: Path, rounds: int) -> Iterator[Row]:
    yield from _timed(model_jobs.simulation_jobs(), rounds)
    yield from model_jobs.real_time_rows(rounds)


def _bag(folder: Path, rounds: int) -> Iterator[Row]:
    def say(text: str) -> None:
        print(text, file=sys.stderr)

    yield from _timed(bag_jobs.bag_jobs(bag_jobs.write_bag(folder), say), rounds)


def _control(folder: Path, rounds: int) -> Iterator[Row]:
    yield from limits.control_ticks(rounds)


def _start(folder: Path, rounds: int) -> Iterator[Row]:
    yield from limits.command_starts(bag_jobs.write_small(folder), rounds)


def _fit(folder: Path, rounds: int) -> Iterator[Row]:
    missing = fit_jobs.missing_peer()
    if missing:
        print(missing, file=sys.stderr)
        return
    yield from _timed(fit_jobs.fit_jobs(), rounds)
    yield fit_jobs.memory_row(folder, rounds)


def _diagnose(folder: Path, rounds: int) -> Iterator[Row]:
    yield from diagnose_jobs.diagnose_rows(folder)


def _chain(folder: Path, rounds: int) -> Iterator[Row]:
    yield from chain_jobs.chain_rows(rounds)


_GROUPS: dict[str, Callable[[Path, int], Iterator[Row]]] = {
    "dynamics": _dynamics,
    "simulation": _simulation,
    "fit": _fit,
    "bag": _bag,
    "diagnose": _diagnose,
    "control": _control,
    "chain": _chain,
    "start": _start,
}
