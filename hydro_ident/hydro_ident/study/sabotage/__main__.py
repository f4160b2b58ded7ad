"""`scripts/sabotage.sh`: break the diagnosis on purpose, and see that the tests notice."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import datetime, timezone
from pathlib import Path

from hydro_ident.errors import IdentError
from hydro_ident.study.by_name import chosen
from hydro_ident.study.placed import write_result
from hydro_ident.study.sabotage.listed import SABOTAGES
from hydro_ident.study.sabotage.page import PAGE, result_of, with_table
from hydro_ident.study.sabotage.trial import PACKAGE, outcomes
from hydro_model.command_line.command import Parser, run_command


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="sabotage",
        description="Put deliberate faults into a copy of the diagnosis, one at a time, and see"
        " that the test named for each passes without it and fails with it.",
    )
    p.add_argument("names", nargs="*", metavar="NAME", help="sabotages (default: all)")
    p.add_argument("--list", action="store_true", help="say what they are, run nothing")
    p.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help=f"write the outcome there, and the table of {PAGE} in the folder above it, if any",
    )
    p.add_argument(
        "--root", type=Path, default=Path(), metavar="DIR", help="repository (default: here)"
    )
    return p


def run(arguments: Sequence[str]) -> int:
    """Run the sabotages; 0 where every one of them is caught, 1 where one is not."""
    options = parser().parse_args(arguments)
    picked = chosen(SABOTAGES, options.names)
    if options.list:
        for one in picked:
            print(f"{one.name}: {one.breaks} ({one.file}; {one.test})")
        return 0
    root: Path = options.root.resolve()
    if not (root / PACKAGE).is_dir():
        raise IdentError(f"expected the sources in {root / PACKAGE}, found none")
    found = []
    for outcome in outcomes(root, picked):
        print(outcome.text, flush=True)
        found.append(outcome)
    caught = sum(one.caught for one in found)
    print(f"{caught} of {len(found)} sabotages were caught")
    if options.json is not None:
        result = result_of(datetime.now(timezone.utc).date().isoformat(), found)
        write_result(options.json, result, PAGE, with_table)
    return 0 if caught == len(found) else 1


if __name__ == "__main__":
    sys.exit(run_command("sabotage", run))
