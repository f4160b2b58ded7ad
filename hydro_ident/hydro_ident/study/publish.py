"""The study's figures: from cases' truths and answers to `summary.json` and to lines of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_ident.bag.provenance import software_version
from hydro_ident.study.conceal import ANSWERS, ORACLES, TRUTHS, read_json, write_json
from hydro_ident.study.goals import GOALS
from hydro_ident.study.intervals import rate
from hydro_ident.study.leaks import leak
from hydro_ident.study.score import score_case
from hydro_ident.study.summary import shuffled, summarise

SUMMARY, SCHEMA = "summary.json", "hydro_ident/study/2"
BASELINES = ("greedy_bic", "always_coulomb")


def command_of(plan: Mapping[str, Any]) -> str:
    """The command that makes a study again.

    `plan` is what plan.json says.
    """
    seed = f"--frozen {plan['frozen']}" if plan["frozen"] else f"--seed {plan['seed']}"
    return f"study --cases {plan['cases']} {seed}"


def publish(out: Path, names: Sequence[str], plan: Mapping[str, Any]) -> dict[str, Any]:
    """Write `summary.json`: the table, those of the baselines and of shuffled labels.

    Parameters
    ----------
    out : Path
        Of the study.
    names : sequence of str
        Of the cases that are done.
    plan : mapping
        `cases`, `seed` and `frozen`.

    Returns
    -------
    dict
        The file's content.

    Raises
    ------
    IdentError
        A case's truth or answer is not there.
    """
    truths = [read_json(out / TRUTHS / f"{name}.json") for name in names]
    answers = [read_json(out / ANSWERS / f"{name}.json") for name in names]
    oracles = [_oracle(out, name) for name in names]
    dealt = shuffled(truths, int(plan["seed"]) + 1)

    def table(given: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        rows = zip(truths, given, oracles, strict=True)
        return summarise([score_case(*row) for row in rows]).content()

    chance = [score_case(t, a) for t, a in zip(dealt, answers, strict=True)]

    content = {
        "schema": SCHEMA,
        "command": command_of(plan),
        "plan": dict(plan),
        "software": software_version(),
        "done": len(names),
        "table": table(answers),
        "baselines": {
            name: table([_answer_of(name, answer) for answer in answers]) for name in BASELINES
        },
        "shuffled": summarise(chance).content(),
        "secluded": rate([bool(answer.get("secluded")) for answer in answers]).content(),
        "outward": leak(truths),
    }
    write_json(out / SUMMARY, content)
    return content


def _oracle(out: Path, name: str) -> dict[str, Any] | None:
    path = out / ORACLES / f"{name}.json"
    return read_json(path) if path.is_file() else None


def _answer_of(baseline: str, answer: Mapping[str, Any]) -> dict[str, Any]:
    """A baseline's answer in the place of the diagnosis'."""
    own = answer.get("baselines", {}).get(baseline)
    seconds = own["seconds"] if own else answer["seconds"]
    return {"exit": answer["exit"], "seconds": seconds, "error": "", "result": own}


def summary_text(summary: Mapping[str, Any]) -> str:
    """The goals, then every figure: with intervals, shuffled labels beside them."""
    table, chance = summary["table"], summary["shuffled"]
    lines = [f"{summary['command']}: {summary['done']} done, {table['cases']}", ""]
    for goal in GOALS:
        met = {True: "met", False: "not met", None: "no data"}[goal.met(table)]
        lines.append(
            f"{goal.text:60} {goal.bound_text:>10} {goal.shown(goal.value(table)):>9} {met}"
        )
    lines.append("")
    for name, row in table["rates"].items():
        if not row["of"]:
            continue
        low, high = row["ci95"]
        other = chance["rates"][name]["share"]
        beside = "" if other is None else f"   shuffled {100 * other:5.1f} %"
        lines.append(
            f"{name:28} {row['hits']:4}/{row['of']:<4} {100 * row['share']:5.1f} %"
            f"  [{100 * low:5.1f}, {100 * high:5.1f}]{beside}"
        )
    for name, row in table["means"].items():
        if row["of"]:
            lines.append(f"{name:28} {row['mean']:.3g} of {row['of']}")
    for name, value in table["numbers"].items():
        if value is not None:
            lines.append(f"{name:28} {value:.3g}")
    return "\n".join(lines)
