"""The campaign's numbers in the safety case, made from the committed results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydro_hw_bridge.faults.naming import SILENT
from hydro_ident.study.placed import NOT_PUBLISHED, placed, published

#: Of the results folder, and the page beside it.
RESULT, PAGE = "faults.json", "safety_case.md"
#: More changed sources of one folder than this are counted, and not named.
NAMED_AT_MOST = 20
BEGIN, END = "<!-- faults: begin -->", "<!-- faults: end -->"


def with_tables(text: str, folder: Path) -> str:
    """The page with its tables made anew.

    Parameters
    ----------
    text : str
    folder : Path
        Of the results.

    Raises
    ------
    IdentError
        The page has no place for them.
    """
    result = published(folder, RESULT)
    return placed(text, NOT_PUBLISHED if result is None else told(result), BEGIN, END)


def told(result: Mapping[str, Any]) -> str:
    """A run, whose `result` is that of the file, as Markdown."""
    parts = []
    if "device_time" in result:
        parts += [_device(result["device_time"]), _silent(result["device_time"]["silent"])]
    if "wall_time" in result:
        parts.append(_wall(result["wall_time"]))
    return "\n".join(parts)


def _since(found: Mapping[str, Any]) -> str:
    """Which sources are no longer those of a run, by folder."""
    groups: dict[str, list[str]] = {}
    for path in found["changed_since"]:
        groups.setdefault(_folder(path), []).append(path)
    if not groups:
        return ""
    known = {_folder(path) for path in found["sources"]}
    told = [_group(name, paths) for name, paths in sorted(groups.items()) if name in known]
    unknown = [f"`{name}`" for name in sorted(groups) if name not in known]
    text = f" Changed since that run: {'; '.join(told)}." if told else ""
    if unknown:
        text += f" It wrote down no digests of {', '.join(unknown)}: whether these changed"
        text += " since is not known."
    return text


def _group(name: str, paths: list[str]) -> str:
    if len(paths) > NAMED_AT_MOST:
        return f"{len(paths)} sources of `{name}`"
    return f"of `{name}` {', '.join(f'`{Path(path).name}`' for path in paths)}"


def _folder(path: str) -> str:
    """The folder that a source lies in, from its package on."""
    parts = Path(path).parts
    package = next((k for k, part in enumerate(parts) if part.startswith("hydro_")), -1)
    return "/".join(parts[package + 1 : -1])


def _device(found: Mapping[str, Any]) -> str:
    lines = [
        f"Run of {found['date']}, device time: {found['injections']} injections"
        f" ({found['lockstep']} of them in lockstep), {found['tripped']} trips,"
        f" {len(found['broken'])} broken promises. Largest step at a valve"
        f" {found['largest_step_v']:.3f} V per cycle,"
        f" {found['largest_reenable_step_v']:.3f} V where a gate drives again:"
        " one whose trip was cleared is held to 10 V/s and judged by that,"
        " a bridge started anew to the slew limit."
        f" Worst case to 0 V {found['worst_ms']:.0f} ms, but for encoders that are stuck and valve"
        " frames that are the same again: the first of these is in time for 10 ms."
        " Promises of more than one cycle (2 ms) and their worst cases are of injections that are"
        " not in lockstep, where the machine's time waits for whoever is late."
        f"{_since(found)}",
        "",
        "| fault | injections | of them with a promised stop, above 2 ms not in lockstep"
        " | promised, ms | worst, ms |",
        "|---|---|---|---|---|",
    ]
    for kind, row in found["kinds"].items():
        lines += _device_rows(kind, row)
    return "\n".join(lines) + "\n"


def _device_rows(kind: str, row: Mapping[str, Any]) -> list[str]:
    """One for each promise; how many injections of the kind there were is told once."""
    if not row["stops_promised"]:
        return [f"| {kind} | {row['injections']} | 0 | - | - |"]
    return [
        f"| {kind} | {'' if k else row['injections']} | {one['stops_promised']}"
        f" | {one['promised_ms']:.0f} | {one['worst_ms']:.0f} |"
        for k, one in enumerate(row.get("promises", [row]))
    ]


def _silent(found: Mapping[str, Mapping[str, int]]) -> str:
    lines = [
        "Every other injection had to show in the bridge's diagnostics: by a counter that grew and"
        " by the words of its reason. Of these nothing has to, and that is why:",
        "",
        "| nothing has to show | injections | of them named all the same | why |",
        "|---|---|---|---|",
    ]
    for key, why in SILENT.items():
        row = found.get(key, {"injections": 0, "named_all_the_same": 0})
        lines.append(f"| {key} | {row['injections']} | {row['named_all_the_same']} | {why} |")
    return "\n".join(lines) + "\n"


def _wall(found: Mapping[str, Any]) -> str:
    timer = found["timer_late_ms"]
    lines = [
        f"Run of {found['date']}, wall time, real processes: {found['injections']} injections"
        f" in {found['minutes']:.0f} minutes"
        f" ({found['left_out']} tries left out, as the computer was too busy to drive),"
        f" {len(found['broken'])} broken promises beyond the time"
        f"{_excused(found)}"
        f" {found['trips_by_the_busy_computer']} trips in between that nobody asked for."
        f" A bare timer on the same machine woke {timer['wakes']} times, late by"
        f" {timer['p50']:.2f} ms (median), {timer['p99']:.2f} ms (99 %), {timer['p99.9']:.2f} ms"
        f" (99.9 %), {timer['max']:.1f} ms at most.{_beyond(found)}{_since(found)}",
        "",
        "| fault | injections | excused by a stall | promised, ms | median, ms | 90 %, ms"
        " | worst, ms | above the promise | of them with the timer as late"
        " | with our processes waiting as long | with neither | timer at worst then, ms"
        " | waited for a core, median, ms | at worst, ms |",
        f"|{'---|' * 14}",
    ]
    for kind, row in found["kinds"].items():
        # A run of before promises were told apart has one row of all.
        rows = list(row.get("promises", [row]))
        driven_on = row["injections"] - sum(one["injections"] for one in rows)
        rows += [{"injections": driven_on}] if driven_on else []
        lines += [
            f"| {kind} | {one['injections']} | {one.get('excused_by_a_stall', '-')}"
            f" | {_wall_times(one)} |"
            for one in rows
        ]
    return "\n".join(lines) + "\n"


def _beyond(found: Mapping[str, Any]) -> str:
    """How the times of all kinds lie beside what was promised; nothing of a run of before."""
    beyond = found.get("beyond_promise_ms")
    if not beyond:
        return ""
    return (
        f" Of all {beyond['injections']} injections with a promised time the valves were at 0 V"
        f" {beyond['p50']:+.1f} ms from it (median), {beyond['p90']:+.1f} ms (90 %),"
        f" {beyond['p99']:+.1f} ms (99 %), {beyond['max']:+.1f} ms at most; below 0 is sooner."
    )


def _excused(found: Mapping[str, Any]) -> str:
    """Of how many nothing can be said; a run of before did not count them."""
    if "excused_by_a_stall" not in found:
        return " (what a stall excused was not counted yet),"
    return (
        f", {found['excused_by_a_stall']} injections of which nothing more can be said, as a trip"
        " that a stall of the computer makes stands in the place of what had to be seen,"
    )


def _wall_times(row: Mapping[str, Any]) -> str:
    """Cells behind the numbers of injections; a dash for what was not measured."""
    times = [f"{key}_ms" for key in ("promised", "p50", "p90", "max")]
    above = [
        "above",
        *(f"above_with_{key}" for key in ("the_timer_as_late", "as_much_waiting", "neither")),
    ]
    waits = ["timer_max_ms", "waited_p50_ms", "waited_max_ms"]
    cells = [f"{row[key]:.1f}" if key in row else "-" for key in times]
    cells += [str(row.get(key, "-")) for key in above]
    cells += [f"{row[key]:.1f}" if key in row else "-" for key in waits]
    return " | ".join(cells)
