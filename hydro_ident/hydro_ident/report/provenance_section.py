"""Where every number of a report came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import metadata
from typing import Any

from hydro_ident.report.page import Section, bullets, table

_HASHED = (
    ("robot_files", "robot's file"),
    ("bags", "fitted"),
    ("validation", "checked on"),
    ("compared", "compared with"),
)
#: What the numbers rest on.
_LIBRARIES = ("numpy", "scipy", "numba", "plotly")


def provenance_section(
    origin: Mapping[str, Any], method: Sequence[tuple[str, str]], notes: Sequence[str]
) -> Section:
    """Command, version, robot and bags with their hashes, method and notes.

    Parameters
    ----------
    origin : mapping
        Provenance, as in the result file.
    method : sequence of pair of str
        What was done how.
    notes : sequence of str
    """
    rows = [("command", str(origin["command"])), ("version", f"hydro_ident {origin['version']}")]
    libraries = ", ".join(f"{name} {metadata.version(name)}" for name in _LIBRARIES)
    rows += [("libraries", libraries), ("robot", str(origin["robot"]))]
    for kind, what in _HASHED:
        rows += [(what, f"{b['name']}  sha256 {b['sha256']}") for b in origin[kind]]
    body = table(("what", "value"), [*rows, *method], text=(1,))
    if notes:
        body += "<h3>Notes</h3>" + bullets(notes)
    lead = "The same command on the same files gives the same numbers; result.json holds them all."
    return Section("provenance", "Where the numbers come from", lead, body)
