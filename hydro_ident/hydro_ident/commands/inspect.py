"""`inspect`: what is in a bag."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from hydro_ident.bag.reader import read_bag
from hydro_ident.commands.output import write_json
from hydro_ident.inspection import Inspection, inspect_bag, robot_of
from hydro_model.command import printable, run_command


def main(arguments: Sequence[str] | None = None) -> int:
    """The `inspect` executable."""
    return run_command("inspect", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="inspect", description="Say what is in a bag: rates, gaps, ranges, health."
    )
    parser.add_argument("bag", type=Path, help="rosbag2 directory or .mcap file")
    parser.add_argument("--robot", help="robot file or shipped robot (default: the bag's own)")
    parser.add_argument("--json", type=Path, metavar="F", help="write the same as JSON")
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    bag = read_bag(options.bag)
    inspection = inspect_bag(bag, robot_of(bag, options.robot), strict=options.robot is not None)
    if options.json is not None:
        write_json(options.json, inspection.as_dict())
    print(text_of(inspection))
    return 0


def text_of(inspection: Inspection) -> str:
    """An inspection as lines for a person, what matters first.

    Parameters
    ----------
    inspection : Inspection

    Returns
    -------
    str
    """
    lines = [*_head(inspection), *_troubles(inspection), *_topics(inspection)]
    # Names and notes come from the bag: nothing in them commands the terminal.
    return "\n".join(printable(line) for line in [*lines, *_ranges(inspection)])


def _head(i: Inspection) -> list[str]:
    sums = "checksums hold" if i.checksummed else "not checksummed"
    sums = "a checksum FAILS" if i.checksum_failed else sums
    packing = ", ".join(i.compression) or "no chunks"
    plural = "" if i.files == 1 else "s"
    lines = [
        i.bag,
        f"  {i.duration_s:.3f} s, {i.messages} messages, {i.size_bytes / 1e6:.1f} MB"
        f" in {i.files} file{plural} ({packing}; {sums})",
    ]
    if i.rate_hz is not None:
        lines.append(f"  robot {i.robot}: {i.cycles} cycles at {i.rate_hz:.2f} Hz")
    elif i.robot is None:
        lines.append("  the bag names no known robot: give --robot to see its signals")
    lines += [f"  {key}: {value}" for key, value in i.metadata.items() if value]
    return lines


def _troubles(i: Inspection) -> list[str]:
    lines = [f"  DAMAGE  {text}" for text in i.damage]
    lines += [f"  CHECK   {finding.signal}: {finding.text}" for finding in i.findings]
    lines += [f"  SAID    {text}" for text in i.diagnostics]
    lines += [f"  LOST    {loss['channel']}: {loss['reason']}" for loss in i.losses]
    if i.channels:
        lines.append(f"  channels: {', '.join(i.channels)}")
    return ["", "health", *(lines or ["  nothing irregular"])]


def _topics(i: Inspection) -> list[str]:
    lines = ["", f"{'topic':32s} {'count':>9s} {'Hz':>8s} {'missing':>8s} {'twice':>6s}  type"]
    for t in i.topics:
        rate = "-" if t.rate_hz is None else f"{t.rate_hz:.2f}"
        lines.append(
            f"{t.topic:32s} {t.count:9d} {rate:>8s} {t.missing:8d} {t.duplicates:6d}"
            f"  {t.message_type}"
        )
    return lines


def _ranges(i: Inspection) -> list[str]:
    if not i.ranges:
        return []
    lines = ["", f"{'signal':32s} {'low':>13s} {'high':>13s} {'mean':>13s}  unit"]
    lines += [
        f"{r.signal:32s} {r.low:13.6g} {r.high:13.6g} {r.mean:13.6g}  {r.unit}" for r in i.ranges
    ]
    return lines
