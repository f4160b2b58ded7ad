"""Where every number of a report came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import metadata
from typing import Any

from hydro_ident.bag.recorded_with import RecordedWith
from hydro_ident.identify.recording_summary import RecordingSummary
from hydro_ident.report.page import Section, bullets, table

_HASHED = (
    ("robot_files", "robot's file"),
    ("bags", "fitted"),
    ("validation", "checked on"),
    ("compared", "compared with"),
)
#: Where the command shown writes to: results say the same wherever they are, so not where.
_AGAIN = "again"
#: What the numbers rest on.
_LIBRARIES = ("numpy", "scipy", "numba", "plotly")


#: What bags keep beside their messages, as a reader knows it.
_KEPT = {
    "note": "note of the recording",
    "robot_file": "robot's file in the bag",
    "controller_parameters": "controller's parameters",
    "bridge_parameters": "bridge's parameters",
    "log": "converted from",
    "log_sha256": "that log's sha256",
}


def provenance_section(
    origin: Mapping[str, Any],
    method: Sequence[tuple[str, str]],
    notes: Sequence[str],
    recordings: Sequence[RecordingSummary] = (),
) -> Section:
    """Command, version, robot and bags with their hashes and what they say, method and notes.

    Parameters
    ----------
    origin : mapping
        Provenance, as in the result file.
    method : sequence of pair of str
        What was done how.
    notes : sequence of str
    recordings : sequence of RecordingSummary
    """
    command = f"ros2 run hydro_ident {origin['command']} --out {_AGAIN}"
    rows = [("command", command), ("version", f"hydro_ident {origin['version']}")]
    libraries = ", ".join(f"{name} {metadata.version(name)}" for name in _LIBRARIES)
    rows += [("libraries", libraries), ("robot", str(origin["robot"]))]
    for kind, what in _HASHED:
        rows += [(what, f"{b['name']}  sha256 {b['sha256']}") for b in origin[kind]]
    rows += _kept(recordings)
    body = table(("what", "value"), [*rows, *method], text=(1,))
    if notes:
        body += "<h3>Notes</h3>" + bullets(notes)
    lead = (
        "The same command, given in the same folder, on the same files gives the same numbers;"
        " result.json holds them all, with the command but for the folder that results go to."
    )
    return Section("provenance", "Where the numbers come from", lead, body)


def _kept(recordings: Sequence[RecordingSummary]) -> list[tuple[str, str]]:
    """What recordings were made with, each thing once, with the recordings that it is of."""
    of: dict[RecordedWith, list[str]] = {}
    for recording in recordings:
        for one in recording.recorded_with:
            of.setdefault(one, []).append(recording.name)
    # Together what is of one kind: whether it is the same throughout is seen at a glance.
    keys = list(dict.fromkeys(one.key for one in of))
    rows = []
    for one in sorted(of, key=lambda one: keys.index(one.key)):
        text = "  ".join(filter(None, (one.name, one.sha256 and f"sha256 {one.sha256}")))
        bags = "" if len(of[one]) == len(recordings) else f"  ({', '.join(of[one])})"
        rows.append((_KEPT.get(one.key, one.key), text + bags))
    return rows
