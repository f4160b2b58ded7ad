"""`python -m hydro_ident.study.fuzz`: the campaign, behind `scripts/fuzz.sh`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from hydro_ident.study.fuzz.campaign import campaign
from hydro_model.command import run_command
from hydro_model.output import write_atomically


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fuzz", description="Broken and hostile files for every loader, one after another."
    )
    parser.add_argument("--corpus", type=Path, required=True, help="folder of files to start from")
    parser.add_argument("--minutes", type=float, default=5.0, help="how long (default 5)")
    parser.add_argument("--first-run", type=int, default=0, help="another one: other files")
    parser.add_argument("--keep", type=Path, help="where files with findings go")
    parser.add_argument("--json", type=Path, metavar="FILE", help="result, dated")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    found = campaign(
        options.corpus, 60.0 * options.minutes, first_run=options.first_run, keep=options.keep
    )
    for name, tally in found["targets"].items():
        print(
            f"{name:14s} {tally['read']:7d} read {tally['refused']:7d} refused"
            f" {len(tally['findings']):4d} findings  slowest {tally['slowest_s']:.2f} s"
        )
    print(f"{found['runs']} runs in {found['seconds']:.0f} s, {found['peak_mb']} MB at most")
    if options.json is not None:
        result = {"schema": "hydro_ident/fuzz/1", "date": time.strftime("%Y-%m-%d"), **found}
        write_atomically(options.json, json.dumps(result, indent=1) + "\n")
    return 1 if any(tally["findings"] for tally in found["targets"].values()) else 0


if __name__ == "__main__":
    sys.exit(run_command("fuzz", _run))
