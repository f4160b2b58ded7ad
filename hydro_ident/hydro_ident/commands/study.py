"""`hydro_ident study`: the concealed-physics proof: generate, hide, diagnose, score; resumable."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydro_model.command import run_command

if TYPE_CHECKING:
    from hydro_ident.study.score import CaseScore, Summary

RESULTS, SUMMARY, PLAN = "results.jsonl", "summary.json", "plan.json"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser(
        prog="study",
        description="Make recordings of random cranes with concealed physics, diagnose them where"
        " the truth is not, and score the diagnoses. A run that was stopped goes on where it was.",
    )
    p.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the study")
    p.add_argument("--cases", type=_positive, default=750, metavar="N", help="(default: 750)")
    seed = p.add_mutually_exclusive_group()
    seed.add_argument("--seed", type=int, default=0, help="(default: 0)")
    seed.add_argument(
        "--frozen", metavar="HASH", help="derive the seed from the commit that froze thresholds"
    )
    p.add_argument("--jobs", type=_positive, default=2, metavar="N", help="(default: 2)")
    p.add_argument(
        "--generate-only", action="store_true", help="write the cases, diagnose nothing"
    )
    p.add_argument(
        "--keep-recordings", action="store_true", help="keep a case's bags once it is diagnosed"
    )
    return p


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected 1 or more, found {value}")
    return value


def frozen_seed(commit: str) -> int:
    """The seed that a commit's hash gives.

    Parameters
    ----------
    commit : str
        Hexadecimal, 7 digits or more.

    Returns
    -------
    int

    Raises
    ------
    IdentError
        It is no hash.
    """
    from hydro_ident.errors import IdentError

    text = commit.lower()
    if len(text) < 7 or set(text) - set("0123456789abcdef"):
        raise IdentError(f"expected --frozen with a commit's hash, found '{commit}'")
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


def run(arguments: Sequence[str]) -> int:
    """Body of the command; returns its exit code."""
    options = parser().parse_args(arguments)
    from hydro_ident.study.conceal import write_json

    seed = frozen_seed(options.frozen) if options.frozen else options.seed
    plan = {"cases": options.cases, "seed": seed, "frozen": options.frozen}
    _check_plan(options.out, plan)
    write_json(options.out / PLAN, plan)
    _prepare_robots(options.out, seed, options.cases, options.jobs)
    done = _work(options, seed)
    if options.generate_only:
        print(f"{options.out}: {options.cases} cases written")
        return 0
    summary = publish(options.out, done, plan)
    print(summary_text(summary))
    return 0


def _check_plan(out: Path, plan: dict[str, Any]) -> None:
    from hydro_ident.errors import IdentError
    from hydro_ident.study.conceal import read_json

    if not (out / PLAN).is_file():
        return
    before = read_json(out / PLAN)
    if before["seed"] != plan["seed"] or before["cases"] != plan["cases"]:
        raise IdentError(
            f"{out}: holds a study of {before['cases']} cases with seed {before['seed']},"
            f" found {plan['cases']} and {plan['seed']}: give another --out"
        )


def _prepare_robots(out: Path, seed: int, cases: int, jobs: int) -> None:
    from concurrent.futures import ProcessPoolExecutor

    from hydro_ident.study.robots import robot_count

    count = robot_count(cases)
    with ProcessPoolExecutor(jobs) as pool:
        list(pool.map(_robot, [(out, seed, number) for number in range(count)]))


def _robot(what: tuple[Path, int, int]) -> None:
    from hydro_ident.study.robots import study_robot

    out, seed, number = what
    study_robot(out / "robots", seed, number)


def _work(options: argparse.Namespace, seed: int) -> list[dict[str, Any]]:
    """Every case that is not done yet, in any number of processes; all scores in case order."""
    import json
    from concurrent.futures import ProcessPoolExecutor, as_completed

    from hydro_ident.study.generate import CaseSpec, kinds

    specs = [CaseSpec(seed, i, kind) for i, kind in enumerate(kinds(seed, options.cases))]
    results = options.out / RESULTS
    rows: dict[str, dict[str, Any]] = {}
    if results.is_file():
        for line in results.read_text(encoding="utf-8").splitlines():
            try:
                row = json.loads(line)
            except ValueError:
                continue  # the line that a stopped run was writing
            rows[row["case"]] = row
    waiting = [spec for spec in specs if spec.name not in rows]
    flags = (options.generate_only, options.keep_recordings)
    with ProcessPoolExecutor(options.jobs) as pool:
        futures = [pool.submit(one_case, spec, options.out, *flags) for spec in waiting]
        for number, future in enumerate(as_completed(futures), 1):
            row = future.result()
            print(f"{number}/{len(waiting)} {row['case']} {row.get('verdict', '')}", flush=True)
            if options.generate_only:
                continue
            rows[row["case"]] = row
            with results.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")
    return [rows[spec.name] for spec in specs if spec.name in rows]


def one_case(spec: Any, out: Path, generate_only: bool, keep: bool) -> dict[str, Any]:
    """Generate, hide, diagnose and score one case; parts that are there already are kept."""
    import shutil

    from hydro_ident.study.conceal import (
        ANSWERS,
        CASES,
        TRUTHS,
        diagnose_case,
        read_json,
        write_case,
    )
    from hydro_ident.study.generate import make_case
    from hydro_ident.study.robots import robot_count, study_robot
    from hydro_ident.study.score import score_case

    name = spec.name
    truth_file, answer_file = out / TRUTHS / f"{name}.json", out / ANSWERS / f"{name}.json"
    if not truth_file.is_file():
        cases = read_json(out / PLAN)["cases"]
        count = robot_count(cases)
        robots = [study_robot(out / "robots", spec.seed, k) for k in range(count)]
        write_case(make_case(spec, robots), out)
    if generate_only:
        return {"case": name}
    answer = read_json(answer_file) if answer_file.is_file() else diagnose_case(name, out)
    if not keep:
        shutil.rmtree(out / CASES / name, ignore_errors=True)
    return score_case(read_json(truth_file), answer).content()


def publish(out: Path, rows: list[dict[str, Any]], plan: dict[str, Any]) -> dict[str, Any]:
    """Write `summary.json`: the table, that of shuffled labels, and what made them."""
    from hydro_ident.bag.provenance import software_version
    from hydro_ident.study.conceal import ANSWERS, TRUTHS, read_json, write_json
    from hydro_ident.study.score import score_case, shuffled, summarise

    names = [row["case"] for row in rows]
    truths = [read_json(out / TRUTHS / f"{name}.json") for name in names]
    answers = [read_json(out / ANSWERS / f"{name}.json") for name in names]
    scores: list[CaseScore] = [score_case(t, a) for t, a in zip(truths, answers, strict=True)]
    chance = [
        score_case(t, a)
        for t, a in zip(shuffled(truths, int(plan["seed"]) + 1), answers, strict=True)
    ]
    table: Summary = summarise(scores)
    command = f"study --cases {plan['cases']} --seed {plan['seed']}"
    if plan["frozen"]:
        command = f"study --cases {plan['cases']} --frozen {plan['frozen']}"
    content = {
        "schema": "hydro_ident/study/1",
        "command": command,
        "plan": plan,
        "software": software_version(),
        "table": table.content(),
        "shuffled": summarise(chance).content(),
    }
    write_json(out / SUMMARY, content)
    return content


def summary_text(summary: dict[str, Any]) -> str:
    """The table as text: rates with intervals, shuffled labels beside them."""
    table, chance = summary["table"], summary["shuffled"]
    lines = [f"{summary['command']}: {table['cases']}", ""]
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
    for name, value in table["numbers"].items():
        if value is not None:
            lines.append(f"{name:28} {value:.3g}")
    return "\n".join(lines)


def main() -> int:
    """Entry point of the command."""
    # Every worker is a process: its libraries need no threads of their own.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    return run_command("study", run)


if __name__ == "__main__":
    sys.exit(main())
