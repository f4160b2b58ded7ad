"""`hydro_ident convert`: a log of another tool to a bag, or a mapping for it to start from."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hydro_ident.errors import BagError
from hydro_model.command_line.command import Parser, run_command, warn
from hydro_model.command_line.output import add_json, report, write_text
from hydro_model.command_line.terminal import progress_bar

if TYPE_CHECKING:
    from hydro_ident.logs.convert import Conversion

_EPILOG = """\
The mapping says which signal of the log is which joint, pressure or valve, in which unit, and
where the time is. Every sample of the log becomes one cycle of the bag: nothing is resampled.
--suggest writes a mapping to start from, with its reasons; what it cannot know says FILL_IN.
Exit 0 done; 2 bad usage or unreadable input, nothing written.
"""

#: Signals that the mapping does not name, as far as they are listed for a person.
_MOST_UNUSED = 12


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="convert",
        description="Convert a CSV, MAT or Parquet log to a bag, by a mapping file.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument(
        "log",
        metavar="LOG",
        type=Path,
        help=".csv, .txt, .tsv, .lvm, .asc (also gzipped), .mat or .parquet file",
    )
    p.add_argument("--map", type=Path, metavar="MAP.yaml", help="mapping of the log's signals")
    p.add_argument("--out", type=Path, metavar="BAG", help="directory of the bag; must be new")
    p.add_argument(
        "--suggest", type=Path, metavar="NEW.yaml", help="write a mapping to start from instead"
    )
    p.add_argument("--robot", help="for --suggest: robot file or shipped robot, for its names")
    add_json(p, "the report")
    p.add_argument("--note", default="", help="kept in the bag's metadata")
    return p


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    p = parser()
    options = p.parse_args(arguments)
    if options.suggest is not None:
        if options.map is not None or options.out is not None:
            p.error("--suggest writes a mapping: it goes without --map and --out")
        return _suggest(options)
    if options.map is None or options.out is None:
        p.error("expected --map MAP.yaml and --out BAG; --suggest NEW.yaml writes a first mapping")
    if options.robot is not None:
        p.error("--robot goes with --suggest; a mapping names its robot itself")
    return _convert(options)


def _convert(options: argparse.Namespace) -> int:
    from hydro_ident.bag.provenance import software_version
    from hydro_ident.identify.origin import bag_sha256
    from hydro_ident.logs.convert import convert
    from hydro_ident.logs.file import read_log
    from hydro_ident.logs.map import read_map

    mapping = read_map(options.map)
    log = read_log(options.log, mapping.layout)
    metadata = {
        "log": log.path.name,
        "log_sha256": bag_sha256(log.path),
        "software": software_version(),
        "note": options.note,
    }
    with progress_bar():
        done = convert(log, mapping, options.out, metadata)
    report(options.json, done.as_dict(), summary_text(done))
    warn("convert", done.warnings)
    return 0


def _suggest(options: argparse.Namespace) -> int:
    from hydro_ident.logs.file import read_log
    from hydro_ident.logs.suggest import suggest
    from hydro_ident.logs.suggest_text import lines_of, mapping_text
    from hydro_model.robot_files import load_robot

    if options.suggest.exists():
        raise BagError(f"{options.suggest}: exists already, nothing overwritten")
    robot = load_robot(options.robot, narrow=True) if options.robot is not None else None
    suggestion = suggest(read_log(options.log), robot, options.robot or "")
    write_text(options.suggest, mapping_text(suggestion))
    lines = [
        *lines_of(suggestion),
        f"written: {options.suggest}; look at it, then: convert {options.log} --map"
        f" {options.suggest} --out BAG",
    ]
    report(options.json, suggestion.as_dict(), "\n".join(lines))
    return 0


def summary_text(done: Conversion) -> str:
    """What was written, for the terminal.

    Parameters
    ----------
    done : Conversion

    Returns
    -------
    str
    """
    lines = [
        f"written: {done.path}, {done.cycles} cycles at {done.rate_hz:.6g} Hz (intervals"
        f" {done.shortest_s * 1e3:.6g} to {done.longest_s * 1e3:.6g} ms)"
    ]
    # What was done to times and values is to be read; signals of the log may be many hundreds.
    lines += [f"  {remark}" for remark in done.remarks]
    lines += [f"  {topic}: {count} messages" for topic, count in done.counts.items()]
    if done.unused:
        more = len(done.unused) - _MOST_UNUSED
        rest = f" and {more} more (all with --json)" if more > 0 else ""
        lines.append(f"  not in the mapping: {', '.join(done.unused[:_MOST_UNUSED])}{rest}")
    return "\n".join(lines)


def main() -> int:
    """Entry point."""
    return run_command("convert", run)


if __name__ == "__main__":
    sys.exit(main())
