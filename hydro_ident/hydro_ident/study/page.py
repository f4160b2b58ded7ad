"""The study's tables in the documentation, made from its committed results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydro_ident.study.goals import GOALS, Goal
from hydro_ident.study.placed import NOT_PUBLISHED, placed, published

BEGIN, END = "<!-- study results: begin -->", "<!-- study results: end -->"
#: Results side by side, by file name: thresholds were chosen on the first, frozen for the second.
RESULTS = {"study_tuning.json": "tuning", "study.json": "fresh"}
_BANDS = {
    "below_limit_": "below the limit",
    "1_to_3_": "1 to 3 limits",
    "": "3 limits and more",
    "excite_": "... in `excite` runs",
    "work_": "... in work cycles",
}
_FIGURES = {
    "detected": "detected",
    "right_channel": "right channel",
    "in_set": "in the set",
    "first": "first name",
}

Summary = Mapping[str, Any]


def tables(folder: Path) -> str:
    """All tables of the page as Markdown.

    Parameters
    ----------
    folder : Path
        Of the results.
    """
    committed = {label: published(folder, name) for name, label in RESULTS.items()}
    found = {label: one for label, one in committed.items() if one is not None}
    if not found:
        return NOT_PUBLISHED
    parts = [_origins(found), _goals(found)]
    last = list(found)[-1]
    parts += [_beside(last, found[last]), _weak(last, found[last])]
    parts += [_outward(last, found[last]), _confusion(last, found[last])]
    return "\n".join(parts)


def _origins(found: Mapping[str, Summary]) -> str:
    lines = []
    for label, one in found.items():
        kinds = ", ".join(
            f"{count} {kind}" for kind, count in sorted(one["table"]["cases"].items())
        )
        lines.append(f"- {label}: `{one['command']}`, {one['done']} cases: {kinds}")
    return "\n".join(lines) + "\n"


def _measured(goal: Goal, table: Summary) -> str:
    value, interval = goal.value(table), goal.interval(table)
    if value is None:
        return "no data"
    text = goal.shown(value)
    if interval is not None:
        text += f" [{goal.shown(interval[0])}, {goal.shown(interval[1])}]"
    if goal.section == "rates":
        row = table["rates"][goal.key]
        text = f"{row['hits']}/{row['of']}, {text}"
    return text


def _goals(found: Mapping[str, Summary]) -> str:
    head = "| | goal |" + "".join(f" {label} | |" for label in found)
    lines = [head, "|---|---|" + "---|---|" * len(found)]
    for goal in GOALS:
        cells = ""
        for one in found.values():
            met = {True: "met", False: "not met", None: ""}[goal.met(one["table"])]
            cells += f" {_measured(goal, one['table'])} | {met} |"
        lines.append(f"| {goal.text} | {goal.bound_text} |{cells}")
    return "\n".join(lines) + "\n"


def _beside(label: str, one: Summary) -> str:
    """The baselines and shuffled labels on the same cases."""
    tables_ = {"diagnosis": one["table"]} | dict(one["baselines"].items())
    tables_["shuffled labels"] = one["shuffled"]
    lines = [f"On the same cases ({label}), the baselines and shuffled labels:", ""]
    lines += ["| |" + "".join(f" {name} |" for name in tables_), "|---|" + "---|" * len(tables_)]
    for goal in GOALS:
        if goal.section == "rates" and goal.key != "size_covered":
            cells = "".join(f" {goal.shown(goal.value(table))} |" for table in tables_.values())
            lines.append(f"| {goal.text} |{cells}")
    return "\n".join(lines) + "\n"


def _weak(label: str, one: Summary) -> str:
    lines = [f"By strength ({label}):", ""]
    lines += ["| |" + "".join(f" {name} |" for name in _FIGURES.values()), "|---" * 5 + "|"]
    for prefix, text in _BANDS.items():
        rows = [one["table"]["rates"][f"{prefix}{figure}"] for figure in _FIGURES]
        lines.append(f"| {text} |" + "".join(f" {r['hits']}/{r['of']} |" for r in rows))
    return "\n".join(lines) + "\n"


def _outward(label: str, one: Summary) -> str:
    apart, seen = one["secluded"], one["outward"]
    text = f"{label}: {apart['hits']} of {apart['of']} diagnoses ran where the system itself kept"
    text += " them out of the study's folder."
    if seen is not None:
        text += (
            f" A classifier of names, stamps, counts and sizes tells clean cases from others with"
            f" balanced accuracy {seen['balanced_accuracy']:.2f} (p = {seen['p_value']:.2f})."
        )
    return text + "\n"


def _confusion(label: str, one: Summary) -> str:
    lines = [f"Strong single effects and what they were called first ({label}):", ""]
    lines += ["| true | answered |", "|---|---|"]
    for name, row in one["table"]["confusion"].items():
        ranked = sorted(row.items(), key=lambda item: (-item[1], item[0]))
        answers = ", ".join(f"{answer} {count}" for answer, count in ranked)
        lines.append(f"| {name} | {answers} |")
    return "\n".join(lines) + "\n"


def with_tables(text: str, folder: Path) -> str:
    """A page with its tables made anew.

    Raises
    ------
    IdentError
        The page has no place for them.
    """
    return placed(text, tables(folder), BEGIN, END)
