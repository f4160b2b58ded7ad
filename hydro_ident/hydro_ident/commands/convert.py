"""`hydro_ident convert`: a CSV, MAT or Parquet log to a bag."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hydro_model.command import run_command

if TYPE_CHECKING:
    from hydro_ident.bag.log_convert import Conversion

_EPILOG = """\
The mapping says which signal of the log is which joint, pressure or valve, in which unit, and
where the time is. Every sample of the log becomes one cycle of the bag: nothing is resampled.
Exit 0 done; 2 bad usage or unreadable input, nothing written.
"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="convert",
        description="Convert a CSV, MAT or Parquet log to a bag, by a mapping file.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument(
        "log",
        metavar="LOG",
        type=Path,
        help=".csv, .txt, .tsv (also gzipped), .mat or .parquet file",
    )
    p.add_argument(
        "--map", required=True, type=Path, metavar="MAP.yaml", help="mapping of the log's signals"
    )
    p.add_argument(
        "--out", required=True, type=Path, metavar="BAG", help="directory of the bag; must be new"
    )
    p.add_argument("--note", default="", help="kept in the bag's metadata")
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    options = parser().parse_args(arguments)
    from hydro_ident.bag.log_convert import convert
    from hydro_ident.bag.log_file import read_log
    from hydro_ident.bag.log_map import read_map
    from hydro_ident.bag.provenance import software_version
    from hydro_ident.results import bag_sha256

    mapping = read_map(options.map)
    log = read_log(options.log, mapping.layout)
    metadata = {
        "log": log.path.name,
        "log_sha256": bag_sha256(log.path),
        "software": software_version(),
        "note": options.note,
    }
    print(summary_text(convert(log, mapping, options.out, metadata)))
    return 0


def summary_text(done: Conversion) -> str:
    """What was written, for the terminal."""
    lines = [
        f"written: {done.path}, {done.cycles} cycles at {done.rate_hz:.6g} Hz (intervals"
        f" {done.shortest_s * 1e3:.6g} to {done.longest_s * 1e3:.6g} ms)"
    ]
    lines += [f"  {topic}: {count} messages" for topic, count in done.counts.items()]
    if done.unused:
        lines.append(f"  not in the mapping: {', '.join(done.unused)}")
    return "\n".join(lines)


def main() -> int:
    """Entry point."""
    return run_command("convert", run)


if __name__ == "__main__":
    sys.exit(main())
