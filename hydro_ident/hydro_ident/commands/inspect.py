"""`inspect`: what is in a bag."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report
from hydro_model.command_line.terminal import advance, coloured, progress_bar
from hydro_model.errors import printable

if TYPE_CHECKING:
    from hydro_ident.inspecting.health import Finding
    from hydro_ident.inspecting.inspection import Inspection


#: What two columns of the topics mean, where health has nothing to say of them.
_MISSING = "missing: by the topic's own rate; what cycles lack stands under health"
_TWICE = "twice: a stamp that came again, with nothing new; harmless where health is silent on it"


def main(arguments: Sequence[str] | None = None) -> int:
    """The `inspect` executable."""
    return run_command("inspect", _run, arguments)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="inspect", description="Say what is in a bag: rates, gaps, ranges, health."
    )
    parser.add_argument("bag", type=Path, metavar="BAG", help="rosbag2 directory or .mcap file")
    parser.add_argument(
        "--robot",
        help="robot file or shipped robot (default: the one that the bag names, if it is shipped"
        " or in a *.hydraulics.yaml here or beside the bag; of a bag that names none the shipped"
        " one with its joints)",
    )
    add_json(parser)
    return parser


def _run(arguments: Sequence[str]) -> int:
    options = _parser().parse_args(arguments)
    from hydro_ident.inspecting.inspection_reading import inspect_bag
    from hydro_model.robot_files import load_robot

    # Before the bag, which may take long.
    robot = None if options.robot is None else load_robot(options.robot, narrow=True)
    with progress_bar():
        # Where who gives no file may have one.
        folders = list(dict.fromkeys(p.resolve() for p in (Path(), options.bag.absolute().parent)))
        inspection = inspect_bag(options.bag, robot, strict=robot is not None, folders=folders)
        advance("looking at signals", 1, 1)
    report(options.json, inspection.as_dict(), text_of(inspection))
    return 0


def text_of(inspection: Inspection) -> str:
    """An inspection as lines for a person, what matters first.

    Names and notes come from the bag: nothing in them commands the terminal.

    Parameters
    ----------
    inspection : Inspection

    Returns
    -------
    str
    """
    parts = (_verdict, _head, _troubles, _channels, _ranges, _topics, _origin)
    return "\n".join(line for part in parts for line in part(inspection))


def _verdict(i: Inspection) -> list[str]:
    """One line that answers whether the bag can be used."""
    if i.damage:
        said = coloured("damaged", "red") + ": what can be read is used"
    elif i.robot is None:
        named = printable(i.metadata.get("robot", ""))
        # What is wrong with a file stands under health.
        which = "no file here can be used" if i.robot_troubles else "no one file is here"
        none = "none is named, and none that is shipped has its joints"
        what = f"the bag names '{named}', of which {which}" if named else none
        said = coloured("no robot", "yellow") + f": {what}; give --robot"
    elif not i.channels:
        said = coloured("nothing to identify", "red") + ": no channel is complete"
    elif count := len(_irregular(i)) + len(i.losses) + len(i.diagnostics):
        said = coloured(f"{count} to look at", "yellow")
    else:
        said = coloured("healthy", "green")
    return [f"{printable(i.bag)}: {said}"]


def _head(i: Inspection) -> list[str]:
    sums = "checksums hold" if i.checksummed else "not checksummed"
    sums = "a checksum FAILS" if i.checksum_failed else sums
    packing = printable(", ".join(i.compression)) or "no chunks"
    plural = "" if i.files == 1 else "s"
    lines = []
    if i.cycles:
        rate = "cycle, of no rate" if i.rate_hz is None else f"cycles at {i.rate_hz:.2f} Hz"
        lines.append(f"  robot {printable(str(i.robot))}: {i.cycles} {rate}")
    lines.append(
        f"  {i.duration_s:.3f} s, {i.messages} messages, {i.size_bytes / 1e6:.1f} MB"
        f" in {i.files} file{plural} ({packing}; {sums})"
    )
    if i.robot_file is not None:
        file = printable(i.robot_file)
        lines.append(f"  robot by the name in the bag: {file} (--robot takes another)")
    if i.robot_by_joints:
        lines.append("  robot by its joints, as the bag names none (--robot takes another)")
    note = i.metadata.get("note", "")
    return lines + ([f"  note: {printable(note)}"] if note else [])


def _troubles(i: Inspection) -> list[str]:
    check, lines = coloured("CHECK", "yellow"), list[str]()
    if i.robot is None:
        lines.append(f"  {check}   joints, pressures and valves were not looked at: give --robot")
        lines += [f"  {check}   {printable(text)}" for text in i.robot_troubles]
    lines += [f"  {coloured('DAMAGE', 'red')}  {printable(text)}" for text in i.damage]
    lines += [f"  {check}   {printable(f'{one.signal}: {one.text}')}" for one in _irregular(i)]
    lines += [f"  {coloured('SAID', 'yellow')}    {printable(text)}" for text in i.diagnostics]
    lines += [
        f"  {coloured('LOST', 'yellow')}    {printable(said)}"
        for said in (f"{loss['channel']}: {loss['reason']}" for loss in i.losses)
    ]
    known = [
        f"  to know {printable(f'{one.signal}: {one.text}')}" for one in i.findings if one.harmless
    ]
    return ["", "health", *(lines or ["  nothing irregular"]), *known]


def _irregular(i: Inspection) -> list[Finding]:
    return [one for one in i.findings if not one.harmless]


def _channels(i: Inspection) -> list[str]:
    return [f"  channels: {printable(', '.join(i.channels))}"] if i.channels else []


def _origin(i: Inspection) -> list[str]:
    lines = [
        f"  {printable(f'{key}: {value}')}"
        for key, value in i.metadata.items()
        if value and key != "note"
    ]
    return ["", "from", *lines] if lines else []


def _topics(i: Inspection) -> list[str]:
    head = f"{'topic':32s} {'count':>9s} {'Hz':>8s} {'missing':>8s} {'twice':>6s}"
    # Where nothing is missing, a column of dashes would only take room.
    gaps = any(t.longest_gap is not None for t in i.topics)
    lines = ["", head + (f"  {'longest gap':>22s}" if gaps else "") + "  type"]
    for t in i.topics:
        rate = "-" if t.rate_hz is None else f"{t.rate_hz:.2f}"
        gap = f"  {'-' if t.longest_gap is None else t.longest_gap.text:>22s}" if gaps else ""
        lines.append(
            f"{printable(t.topic):32s} {t.count:9d} {rate:>8s} {t.missing:8d} {t.duplicates:6d}"
            f"{gap}  {printable(t.message_type)}"
        )
    if any(t.missing for t in i.topics):
        lines.append(f"  {_MISSING}")
    if any(t.duplicates for t in i.topics):
        lines.append(f"  {_TWICE}")
    return lines


def _ranges(i: Inspection) -> list[str]:
    """Every signal's span, below it in the unit that people use where that is another one."""
    from hydro_ident.everyday_units import everyday, rounded

    if not i.ranges:
        return []
    lines = ["", f"{'signal':32s} {'low':>13s} {'high':>13s} {'mean':>13s}  unit"]
    for r in i.ranges:
        values = r.low, r.high, r.mean
        columns = " ".join(f"{value:13.6g}" for value in values)
        lines.append(f"{printable(r.signal):32s} {columns}  {printable(r.unit)}")
        told = everyday(r.unit)
        if told is not None:
            unit, size = told
            columns = " ".join(f"{rounded(size * value):>13s}" for value in values)
            lines.append(f"{'':32s} {columns}  {unit}")
    return lines


if __name__ == "__main__":
    sys.exit(main())
