"""`scripts/mutants.sh`: change the gate and the watchdogs, and see that the tests notice."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

from hydro_ident.errors import IdentError
from hydro_ident.study.by_name import chosen
from hydro_ident.study.mutants.changes import changes
from hydro_ident.study.mutants.listed import TARGETS, Target
from hydro_ident.study.mutants.page import (
    PAGE,
    Run,
    left_over,
    result_of,
    unargued,
    with_table,
)
from hydro_ident.study.mutants.trial import SURVIVED, covered, prepare, tried
from hydro_ident.study.placed import write_result
from hydro_ident.study.sources import digest, digests_of
from hydro_model.command_line.command import Parser, run_command


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="mutants",
        description="Change the gate and the watchdogs in one place at a time, and see that a"
        " test of theirs fails. The sources stay as they are.",
    )
    p.add_argument("names", nargs="*", metavar="NAME", help="modules (default: all)")
    p.add_argument("--list", action="store_true", help="say which there are, run nothing")
    p.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help="write the outcome there (modules that were not run stay), and the table of"
        f" {PAGE} in the folder above it, if any",
    )
    p.add_argument(
        "--again",
        action="store_true",
        help="with --json: try only what the run in FILE did not notice, as long as the source is"
        " the same; for after a test was added and none asserts less",
    )
    p.add_argument(
        "--root", type=Path, default=Path(), metavar="DIR", help="repository (default: here)"
    )
    return p


def run(arguments: Sequence[str]) -> int:
    """Try every change; 0 where all that survived are argued, 1 where one is not."""
    options = parser().parse_args(arguments)
    picked = chosen(TARGETS, options.names)
    if options.list:
        for one in picked:
            print(f"{one.name}: {one.file} ({', '.join(one.tests)})")
        return 0
    root: Path = options.root.resolve()
    prepare()
    rows = _rows(options.json) if options.again else {}
    runs = []
    for target in picked:
        runs.append(_tried(root, target, rows.get(target.name)))
        if options.json is not None:
            _write(options.json.resolve(), runs)
    problems = unargued(runs)
    print("\n".join(problems) or "every change is noticed or argued")
    return 1 if problems else 0


def _rows(path: Path | None) -> dict[str, Any]:
    """The modules of an earlier run by name."""
    if path is None or not path.is_file():
        raise IdentError(
            f"--again: expected --json with the file of a run, found {path or 'none'}"
        )
    return {row["name"]: row for row in json.loads(path.read_text(encoding="utf-8"))["modules"]}


def _tried(root: Path, target: Target, row: Mapping[str, Any] | None) -> Run:
    path = root / target.file
    source = path.read_text(encoding="utf-8")
    of_tests = digests_of(root, target.test_files(root), ())
    coverage = covered(root, target)
    if tried(root, target, source) != SURVIVED:
        raise IdentError(f"expected the tests of {target.file} to pass, found they do not")
    left = [one for one in changes(source) if target.holds(one.where)]
    earlier = Counter[str]()
    if row is not None and row["sha256"] == digest(path):
        left, earlier = left_over(left, row)
    ends = []
    for number, change in enumerate(left, 1):
        ends.append((change, tried(root, target, change.source)))
        if sys.stderr.isatty():
            print(f"\r{target.name}: {number} of {len(left)}", end="", file=sys.stderr)
    done = Run(target, digest(path), of_tests, coverage, tuple(ends), earlier)
    print(f"{target.name}: {done.count} changes, {len(done.survivors)} not noticed", flush=True)
    return done


def _write(path: Path, runs: Sequence[Run]) -> None:
    date = datetime.now(timezone.utc).date().isoformat()
    tool = f"cosmic-ray {metadata.version('cosmic-ray')}"
    before = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
    write_result(path, result_of(date, tool, runs, before), PAGE, with_table)


if __name__ == "__main__":
    sys.exit(run_command("mutants", run))
