"""The mutants in the safety case, made from a committed run and the list of harmless ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hydro_ident.study.mutants.changes import Change
from hydro_ident.study.mutants.harmless import HARMLESS
from hydro_ident.study.mutants.listed import TARGETS, Target
from hydro_ident.study.mutants.trial import (
    KILLED,
    NOT_LOADED,
    SURVIVED,
    TIMED_OUT,
    Coverage,
)
from hydro_ident.study.placed import NOT_PUBLISHED, placed, published

SCHEMA = "hydro_ident/mutants/1"
#: Of the results folder, and the page beside it.
RESULT, PAGE = "mutants.json", "safety_case.md"
BEGIN, END = "<!-- mutants: begin -->", "<!-- mutants: end -->"


@dataclass(frozen=True, slots=True)
class Run:
    """What became of all changes of one module.

    Attributes
    ----------
    target : Target
    sha256 : str
        Of the module's file.
    tests_sha256 : mapping of str to str
        Of its tests' files: one that asserts less may notice less.
    coverage : Coverage
    ends : tuple of (Change, str)
        Each change with what its tests said.
    earlier : Counter of str
        Ends of the changes that an earlier run of the same source had noticed.
    """

    target: Target
    sha256: str
    tests_sha256: Mapping[str, str]
    coverage: Coverage
    ends: tuple[tuple[Change, str], ...]
    earlier: Counter[str] = field(default_factory=Counter)

    @property
    def tally(self) -> Counter[str]:
        """How many changes ended how."""
        return self.earlier + Counter(end for _, end in self.ends)

    @property
    def count(self) -> int:
        """All changes."""
        return sum(self.tally.values())

    @property
    def survivors(self) -> list[Change]:
        """Those that nothing noticed."""
        return [change for change, end in self.ends if end == SURVIVED]


def left_over(
    all_changes: Sequence[Change], row: Mapping[str, Any]
) -> tuple[list[Change], Counter[str]]:
    """What an earlier run of the same source did not notice, and how the others had ended.

    Parameters
    ----------
    all_changes : sequence of Change
    row : mapping
        The module in the earlier result.
    """
    keys = {(one["where"], one["before"], one["after"]) for one in row["survivors"]}
    left = [one for one in all_changes if one.key in keys]
    earlier = Counter({end: row[end] for end in (KILLED, NOT_LOADED, TIMED_OUT)})
    # Of lines that are alike, those that were noticed are tried once more.
    earlier[KILLED] -= len(left) - row[SURVIVED]
    return left, earlier


def unargued(runs: Sequence[Run]) -> list[str]:
    """Survivors without an argument, and arguments without a survivor, in words.

    Parameters
    ----------
    runs : sequence of Run
    """
    names = {run.target.name for run in runs}
    found = {(run.target.name, *one.key) for run in runs for one in run.survivors}
    known = {(h.target, h.where, h.before, h.after) for h in HARMLESS if h.target in names}
    lines = [f"not argued: {' | '.join(key)}" for key in sorted(found - known)]
    return lines + [f"does not survive: {' | '.join(key)}" for key in sorted(known - found)]


def result_of(
    date: str, tool: str, runs: Sequence[Run], before: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Runs as they are written.

    Parameters
    ----------
    date, tool : str
    runs : sequence of Run
    before : mapping, optional
        An earlier result, of which modules that were not run again are kept.
    """
    rows = {row["name"]: row for row in (before or {"modules": ()})["modules"]}
    rows |= {run.target.name: {"date": date, "tool": tool, **_row(run)} for run in runs}
    order = [target.name for target in TARGETS if target.name in rows]
    return {"schema": SCHEMA, "modules": [rows[name] for name in order]}


def _row(run: Run) -> dict[str, Any]:
    tally = run.tally
    return {
        "name": run.target.name,
        "file": run.target.file,
        "sha256": run.sha256,
        "tests": list(run.target.tests),
        "tests_sha256": dict(run.tests_sha256),
        "coverage": asdict(run.coverage),
        "changes": run.count,
        **{end: tally[end] for end in (KILLED, NOT_LOADED, TIMED_OUT, SURVIVED)},
        "survivors": [
            {"where": one.where, "before": one.before, "after": one.after} for one in run.survivors
        ],
    }


def table(folder: Path) -> str:
    """The numbers and the survivors as Markdown.

    Parameters
    ----------
    folder : Path
        Of the results.
    """
    run: Mapping[str, Any] | None = published(folder, RESULT)
    if run is None:
        return NOT_PUBLISHED
    modules: Sequence[Mapping[str, Any]] = run["modules"]
    total = sum(m["changes"] for m in modules)
    survived = sum(m[SURVIVED] for m in modules)
    lines = [
        f"{total} changed programs ({', '.join(sorted({m['tool'] for m in modules}))}),"
        f" {total - survived} noticed, {survived} not.",
        "",
        "| module | run of | lines covered | branches covered | changes | a test fails"
        " | does not load | never ends | not noticed |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for m in modules:
        c = m["coverage"]
        lines.append(
            f"| `{Path(m['file']).name}` | {m['date']} | {c['lines_covered']} of {c['lines']}"
            f" | {c['branches_covered']} of {c['branches']} | {m['changes']} | {m[KILLED]}"
            f" | {m[NOT_LOADED]} | {m[TIMED_OUT]} | {m[SURVIVED]} |"
        )
    lines += ["", "Not noticed, and why that is no gap:", ""]
    lines += ["| module | where | source | changed to | why |", "|---|---|---|---|---|"]
    for h in HARMLESS:
        before, after = (text.replace("|", "\\|") for text in (h.before, h.after))
        where = f"`{h.where}`" if h.where else "the module"
        lines.append(f"| {h.target} | {where} | `{before}` | `{after}` | {h.why} |")
    return "\n".join(lines) + "\n"


def with_table(text: str, folder: Path) -> str:
    """The page with its table made anew.

    Raises
    ------
    IdentError
        The page has no place for it.
    """
    return placed(text, table(folder), BEGIN, END)
