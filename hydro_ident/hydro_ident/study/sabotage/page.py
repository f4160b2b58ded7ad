"""The table of the sabotages in the documentation, made from the list and a committed run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_ident.study.placed import NOT_PUBLISHED, placed, published
from hydro_ident.study.sabotage.listed import SABOTAGES
from hydro_ident.study.sabotage.trial import Outcome

SCHEMA = "hydro_ident/sabotage/1"
#: Of the results folder, and the page beside it.
RESULT, PAGE = "sabotage.json", "sabotage.md"
BEGIN, END = "<!-- sabotages: begin -->", "<!-- sabotages: end -->"


def result_of(date: str, found: Sequence[Outcome]) -> dict[str, Any]:
    """A run as it is written.

    Parameters
    ----------
    date : str
    found : sequence of Outcome
    """
    return {
        "schema": SCHEMA,
        "date": date,
        "caught": sum(one.caught for one in found),
        "of": len(found),
        "sabotages": [
            {
                "name": one.sabotage.name,
                "file": f"hydro_ident/{one.sabotage.file}",
                "test": one.sabotage.test,
                "before": one.before.end,
                "after": one.after.end if one.after else "not run",
                "message": one.after.message if one.after else one.before.message,
                "caught": one.caught,
            }
            for one in found
        ],
    }


def table(folder: Path) -> str:
    """The table as Markdown.

    Parameters
    ----------
    folder : Path
        Of the results.
    """
    run: Mapping[str, Any] | None = published(folder, RESULT)
    lines: list[str] = [NOT_PUBLISHED]
    rows: Sequence[Mapping[str, Any]] = ()
    if run is not None:
        said = f"Run of {run['date']}: {run['caught']} of {run['of']} turned their test red."
        lines, rows = [said, ""], run["sabotages"]
    caught = {row["name"]: "red" if row["caught"] else "missed" for row in rows}
    lines += ["| sabotage | what is wrong then | file | test | |", "|---|---|---|---|---|"]
    for one in SABOTAGES:
        test = one.test.rpartition("::")[2].replace("_", " ")
        test = f"[{test}](../{one.test.partition('::')[0]})"
        verdict = caught.get(one.name, "not run")
        lines.append(f"| {one.name} | {one.breaks} | `{one.file}` | {test} | {verdict} |")
    return "\n".join(lines) + "\n"


def with_table(text: str, folder: Path) -> str:
    """The page with its table made anew.

    Raises
    ------
    IdentError
        The page has no place for it.
    """
    return placed(text, table(folder), BEGIN, END)
