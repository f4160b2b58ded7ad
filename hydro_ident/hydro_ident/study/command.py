"""`hydro_ident study`: the concealed-physics proof: generate, hide, diagnose, score; resumable."""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import STDOUT, add_json, report
from hydro_model.command_line.terminal import advance, progress_bar, say

if TYPE_CHECKING:
    from hydro_ident.study.generate import CaseSpec

RESULTS, PLAN = "results.jsonl", "plan.json"
#: Of the documentation, beside the folder of its results.
PAGE = "study.md"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser(
        prog="study",
        description="Make recordings of random cranes with concealed physics, diagnose them where"
        " the truth is not, and score the diagnoses. A run that was stopped goes on where it was.",
    )
    p.add_argument("--out", required=True, type=Path, metavar="DIR", help="folder of the study")
    p.add_argument(
        "--cases", type=_positive, default=750, metavar="N", help="how many cranes (default: 750)"
    )
    seed = p.add_mutually_exclusive_group()
    seed.add_argument(
        "--seed", type=_whole, default=0, metavar="S", help="of the cases (default: 0)"
    )
    seed.add_argument(
        "--frozen", metavar="HASH", help="derive the seed from the commit that froze thresholds"
    )
    p.add_argument(
        "--jobs",
        type=_positive,
        default=2,
        metavar="N",
        help="processes side by side (default: 2)",
    )
    p.add_argument(
        "--generate-only", action="store_true", help="write the cases, diagnose nothing"
    )
    p.add_argument(
        "--keep-recordings", action="store_true", help="keep a case's bags once it is diagnosed"
    )
    p.add_argument(
        "--publish",
        type=Path,
        metavar="FILE",
        help="write the figures to FILE, too, and anew into the tables of study.md in the folder"
        " above it, where there is one",
    )
    p.add_argument(
        "--done-only", action="store_true", help="begin no case: score those that are done"
    )
    p.add_argument(
        "--archive",
        type=Path,
        metavar="FILE",
        help="take the cases that are in FILE, where it is there, for done, and write all that are"
        " done to it: for going on with a study elsewhere",
    )
    add_json(p, "the summary")
    return p


def _positive(text: str) -> int:
    return _whole(text, 1)


def _whole(text: str, least: int = 0) -> int:
    if not text.isdecimal() or int(text) < least:
        why = f"expected a whole number of {least} or more"
        raise argparse.ArgumentTypeError(f"{why}, found '{text}'")
    return int(text)


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
    from hydro_ident.study.publish import publish, summary_text

    seed = frozen_seed(options.frozen) if options.frozen else options.seed
    plan = {"cases": options.cases, "seed": seed, "frozen": options.frozen}
    _check_plan(options.out, plan)
    write_json(options.out / PLAN, plan)
    if options.archive and options.archive.is_file():
        _from_archive(options.archive, options.out, plan)
    _say_if_not_secluded()
    if not options.done_only:
        _prepare_robots(options.out, seed, options.cases, options.jobs)
    with progress_bar():
        advance("cases", 0, options.cases)
        done = _work(options, seed)
    if options.generate_only:
        print(f"{options.out}: {options.cases} cases written")
        return 0
    if options.archive:
        from hydro_ident.study.archive import pack
        from hydro_ident.study.done_cases import done_scores

        pack(options.archive, options.out, plan, done_scores(options.out / RESULTS))
    summary = publish(options.out, done, plan)
    if options.publish:
        _into_docs(options.publish, summary)
    report(options.json, summary, summary_text(summary))
    return 0


def _from_archive(file: Path, out: Path, plan: dict[str, Any]) -> None:
    from hydro_ident.study.archive import unpack
    from hydro_ident.study.done_cases import append_score, done_scores

    known = {score["case"] for score in done_scores(out / RESULTS)}
    for score in unpack(file, out, plan):
        if score["case"] not in known:
            append_score(out / RESULTS, score)


def _say_if_not_secluded() -> None:
    from hydro_ident.study.seclusion import can_seclude

    if not can_seclude():
        print(
            "study: this system cannot keep a process out of a folder: the diagnosis is kept from"
            " the truth only by not being told where it is",
            file=sys.stderr,
        )


def _into_docs(file: Path, summary: dict[str, Any]) -> None:
    from hydro_ident.study.conceal import write_json
    from hydro_ident.study.page import with_tables
    from hydro_ident.study.placed import renewed

    write_json(file, summary)
    page = renewed(file, PAGE, with_tables)
    if page is not None:
        print(f"written: {page}")


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


def _work(options: argparse.Namespace, seed: int) -> list[str]:
    """Every case that is not done yet, in any number of processes; names in case order."""
    from concurrent.futures import ProcessPoolExecutor, as_completed

    from hydro_ident.study.done_cases import append_score, done_scores
    from hydro_ident.study.generate import CaseSpec, kinds

    specs = [CaseSpec(seed, i, kind) for i, kind in enumerate(kinds(seed, options.cases))]
    results = options.out / RESULTS
    done = {str(score["case"]) for score in done_scores(results)}
    waiting = [spec for spec in specs if spec.name not in done and not options.done_only]
    flags = (options.generate_only, options.keep_recordings)
    with ProcessPoolExecutor(options.jobs) as pool:
        futures = [pool.submit(one_case, spec, options.out, *flags) for spec in waiting]
        for number, future in enumerate(as_completed(futures), 1):
            row = future.result()
            said = row.get("failed") or row.get("verdict", "")
            line = f"{number}/{len(waiting)} {row['case']} {said}"
            if options.json != STDOUT:
                say(line)
            advance("cases", number, len(waiting))
            if options.generate_only or "failed" in row:
                continue
            done.add(row["case"])
            append_score(results, row)
    return [spec.name for spec in specs if spec.name in done]


def one_case(spec: CaseSpec, out: Path, generate_only: bool, keep: bool) -> dict[str, Any]:
    """Generate, hide, diagnose and score one case; parts that are there already are kept.

    Parameters
    ----------
    spec : CaseSpec
    out : Path
        Of the study; holds its plan and its cranes.
    generate_only : bool
    keep : bool
        Keep the recordings.

    Returns
    -------
    dict
        The case's score, or `case` and `failed` where no machine could be drawn.
    """
    import shutil

    from hydro_ident.study.conceal import ANSWERS, CASES, ORACLES, TRUTHS, diagnose_case, read_json
    from hydro_ident.study.score import score_case

    name = spec.name
    truth_file, answer_file, oracle_file = (
        out / folder / f"{name}.json" for folder in (TRUTHS, ANSWERS, ORACLES)
    )
    there = truth_file.is_file() and (out / CASES / name).is_dir()
    if not there and not (answer_file.is_file() and oracle_file.is_file()):
        failure = _generate(spec, out)
        if failure:
            return {"case": name, "failed": failure}
    if generate_only:
        return {"case": name}
    truth = read_json(truth_file)
    answer = read_json(answer_file) if answer_file.is_file() else diagnose_case(name, out)
    oracle = read_json(oracle_file) if oracle_file.is_file() else _oracle(out, truth)
    if not keep:
        shutil.rmtree(out / CASES / name, ignore_errors=True)
    return score_case(truth, answer, oracle).content()


def _generate(spec: CaseSpec, out: Path) -> str:
    """Write a case; why it could not be drawn, or empty."""
    from hydro_ident.errors import IdentError
    from hydro_ident.study.conceal import read_json, write_case
    from hydro_ident.study.generate import make_case
    from hydro_ident.study.robots import robot_count, study_robot

    count = robot_count(read_json(out / PLAN)["cases"])
    robots = [study_robot(out / "robots", spec.seed, k) for k in range(count)]
    try:
        write_case(make_case(spec, robots), out)
    except IdentError as error:
        return str(error)
    return ""


def _oracle(out: Path, truth: dict[str, Any]) -> dict[str, Any]:
    """What the oracle says of a case, after the diagnosis; an empty mapping where it cannot."""
    import numpy as np

    from hydro_ident.errors import IdentError
    from hydro_ident.study.conceal import CASES, ORACLES, write_json
    from hydro_ident.study.oracle import oracle_case

    try:
        found = oracle_case(out / CASES / truth["case"], truth) or {}
    except (IdentError, np.linalg.LinAlgError) as error:
        found = {"error": str(error)}
    write_json(out / ORACLES / f"{truth['case']}.json", found)
    return found


def main() -> int:
    """Entry point of the command."""
    # Every worker is a process: its libraries need no threads of their own.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    return run_command("study", run)


if __name__ == "__main__":
    sys.exit(main())
