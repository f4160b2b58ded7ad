"""The table of the performance page, made from the committed results."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_ident.bench import made
from hydro_ident.bench.job import Row
from hydro_ident.study.placed import NOT_PUBLISHED, placed, published

#: Of the results folder, each with its place's name on the page beside it.
RESULTS, PAGE = {"bench.json": "bench", "growth.json": "growth"}, "performance.md"
HEAD = "| job | against | ours | theirs | ratio | goal |\n|---|---|---|---|---|---|"
#: In the place of a time of cycles that were never answered.
NEVER = "never answered"


def line(row: Row) -> str:
    """A row of the table."""
    ours, theirs = (
        f"{one:.3g}" if math.isfinite(one) else NEVER for one in (row.ours, row.theirs)
    )
    ratio = f"{row.ratio:.2f}" if math.isfinite(row.ratio) else "any"
    return f"| {row.job} | {row.peer} | {ours} | {theirs} | {ratio} | {row.goal:.3g} |"


def lost_cycles(rows: Sequence[Row]) -> str:
    """A sentence on the cycles that were never answered; empty where no job is in cycles.

    Parameters
    ----------
    rows : sequence of Row
    """
    counted = next((row for row in rows if row.cycles_ours is not None), None)
    if counted is None:
        return ""
    return (
        "Cycles that were never answered, in all rounds, and count as infinitely late in every"
        f" percentile: {counted.lost_ours} of {counted.cycles_ours} by bridge and controller,"
        f" {counted.lost_theirs} of {counted.cycles_theirs} by the echo.\n"
    )


def table(folder: Path, result: str) -> str:
    """A table as Markdown, with whether each goal is met.

    Parameters
    ----------
    folder : Path
        Of the results.
    result : str
        One of `RESULTS`.
    """
    found: Sequence[Mapping[str, Any]] | None = published(folder, result)
    if found is None:
        return NOT_PUBLISHED
    head, rule = HEAD.splitlines()
    lines = [f"{head} met |", f"{rule}---|"]
    rows = [Row.of_json(one) for one in found]
    lines += [f"{line(row)} {'yes' if row.met else 'no'} |" for row in rows]
    told = f"{lost_cycles(rows)}{made.sentence(folder, result)}"
    return "\n".join([*lines, "", told])


def with_tables(text: str, folder: Path) -> str:
    """A page with its tables made anew.

    Parameters
    ----------
    text : str
        The page.
    folder : Path
        Of the results.

    Raises
    ------
    IdentError
        The page has no place for one.
    """
    for result, name in RESULTS.items():
        places = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        text = placed(text, table(folder, result), *places)
    return text
