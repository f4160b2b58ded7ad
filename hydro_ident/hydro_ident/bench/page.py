"""The table of the performance page, made from the committed results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_ident.bench.job import Row
from hydro_ident.study.placed import NOT_PUBLISHED, placed, published

#: Of the results folder, each with its place's name on the page beside it.
RESULTS, PAGE = {"bench.json": "bench", "growth.json": "growth"}, "performance.md"
HEAD = "| job | against | ours | theirs | ratio | goal |\n|---|---|---|---|---|---|"
#: Within so much a goal is met: it is a rounded number itself.
_CLOSE = 0.995


def line(row: Row) -> str:
    """A row of the table."""
    return (
        f"| {row.job} | {row.peer} | {row.ours:.3g} | {row.theirs:.3g} | {row.ratio:.2f}"
        f" | {row.goal:.3g} |"
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
    for one in found:
        row = Row(**one)
        met = "yes" if row.ratio >= _CLOSE * row.goal else "no"
        lines.append(f"{line(row)} {met} |")
    return "\n".join(lines) + "\n"


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
