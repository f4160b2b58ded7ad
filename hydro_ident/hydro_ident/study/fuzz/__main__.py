"""`python -m hydro_ident.study.fuzz`: the campaign, behind `scripts/fuzz.sh`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_ident.study.fuzz.campaign import campaign
from hydro_ident.study.fuzz.sources import changed, digests
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import write_atomically


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="fuzz", description="Broken and hostile files for every loader, one after another."
    )
    parser.add_argument("--corpus", type=Path, required=True, help="folder of files to start from")
    parser.add_argument(
        "--minutes",
        type=float,
        default=5.0,
        help="how long (default 5); 0: nothing is tried, and the result in --json FILE says anew"
        " which sources have changed since its run",
    )
    parser.add_argument("--first-run", type=int, default=0, help="another one: other files")
    parser.add_argument("--keep", type=Path, help="where files with findings go")
    parser.add_argument("--json", type=Path, metavar="FILE", help="result, dated")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    root = options.corpus.resolve().parents[1]
    if options.minutes == 0.0 and options.json is not None:
        result = json.loads(options.json.read_bytes())
        result["changed_since"] = changed(result["sources"], root)
        _write(options.json, result)
        return 0
    of = digests(root)  # what runs, whatever is edited meanwhile
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
        _write(options.json, {**result, "sources": of, "changed_since": []})
    return 1 if any(tally["findings"] for tally in found["targets"].values()) else 0


def _write(file: Path, result: Mapping[str, Any]) -> None:
    write_atomically(file, json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(run_command("fuzz", _run))
