"""Twelve cases of the concealed-physics study, made, hidden, diagnosed and scored on the fly.

Short recordings of cranes with one joint: a share of the study that a test suite has time for.
What is asserted is how the twelve fare together. Strong effects are picked by their limits of
detection, which are fixed before any diagnosis.
"""

from __future__ import annotations

import itertools
import multiprocessing
import shutil
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.commands import diagnose
from hydro_ident.identify.results import RESULT_FILE
from hydro_ident.study.conceal import CASES, TRUTHS, read_json, write_case
from hydro_ident.study.experiments import Motion
from hydro_ident.study.generate import CaseSpec, make_case
from hydro_ident.study.machines import random_crane
from hydro_ident.study.oracle import oracle_case
from hydro_ident.study.planting import CaseKind
from hydro_ident.study.robots import StudyRobot
from hydro_ident.study.score import CaseScore, score_case
from hydro_ident.study.summary import STRONG, Summary, summarise
from hydro_model.robot import Robot

pytestmark = [pytest.mark.study, pytest.mark.long]

SEED = 20
#: Seeds of cranes that have one joint.
CRANES = (3, 29)
WANTED: tuple[tuple[CaseKind, int], ...] = (("single", 6), ("clean", 4), ("outside", 2))
TRAIN_S, CHECK_S, STEP_S = 17.0, 12.0, 2e-3


def _motion(crane: Robot, duration_s: float, phase: float) -> Motion:
    """Slow and quick sweeps about the middle of the range, with a pause."""
    (joint,) = crane.joints
    t = np.arange(0.0, duration_s, STEP_S)
    ease = np.clip(t / 2.0, 0.0, 1.0)
    fade = (
        ease * ease * (3.0 - 2.0 * ease) * np.where(np.abs(t - 0.6 * duration_s) < 0.6, 0.0, 1.0)
    )
    half = 0.5 * (joint.upper - joint.lower)
    slow = 0.28 * half * 0.9 * np.cos(0.9 * t + phase)
    middle = 0.12 * half * 2.3 * np.cos(2.3 * t + 2.0 * phase)
    quick = 0.02 * half * 6.5 * np.cos(6.5 * t + 3.0 * phase)
    rate = (fade * (slow + middle + quick))[:, None]
    q = 0.5 * (joint.upper + joint.lower) + np.cumsum(rate, axis=0) * STEP_S
    return Motion("excite", q, rate)


def _cranes(out: Path) -> Iterator[StudyRobot]:
    for number, seed in enumerate(CRANES):
        folder = out / "robots" / f"{number:02d}"
        _, robot = random_crane(f"crane_{number:02d}", seed, folder)
        motions = _motion(robot, TRAIN_S, 0.0), _motion(robot, CHECK_S, 1.3)
        yield StudyRobot(folder, robot, motions)


@pytest.fixture(scope="module")
def scores(tmp_path_factory: pytest.TempPathFactory) -> list[CaseScore]:
    out = tmp_path_factory.mktemp("cases")
    robots, hidden, begun = list(_cranes(out)), set[str](), list[Any]()
    # Two processes for all cases: to start one for each takes as long as the diagnoses. They
    # diagnose what is written while the next cases are drawn.
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("hydro_ident.study.experiments.TRAIN_S", TRAIN_S)
            patch.setattr("hydro_ident.study.experiments.CHECK_S", CHECK_S)
            indices = itertools.count()
            for kind, count in WANTED:
                for _ in range(count):
                    name = _strong_case(kind, indices, robots, out, hidden)
                    begun.append(_begin(pool, name, out, tmp_path_factory.mktemp("in")))
        return [_score(*one) for one in begun]


def _begin(pool: Executor, name: str, out: Path, place: Path) -> tuple:
    """Diagnose a copy of a case's recordings where its truth is not, and ask the oracle."""
    case, truth = place / "case", read_json(out / TRUTHS / f"{name}.json")
    shutil.copytree(out / CASES / name, case)
    (robot,) = case.glob("*.hydraulics.yaml")
    train, check = (sorted(map(str, (case / part).iterdir())) for part in ("train", "check"))
    arguments = [*train, "--robot", str(robot), "--validate", *check, "--out", str(place / "out")]
    arguments += ["--processes", "1"]
    oracle = pool.submit(oracle_case, case, truth)
    return truth, pool.submit(diagnose.run, arguments), place / "out" / RESULT_FILE, oracle


def _score(truth: dict, code: Future[int], result: Path, oracle: Future) -> CaseScore:
    answer = {"exit": code.result(), "seconds": 0.0, "result": read_json(result)}
    return score_case(truth, answer, oracle.result())


def _strong_case(
    kind: CaseKind,
    indices: Iterator[int],
    robots: list[StudyRobot],
    out: Path,
    hidden: set[str],
) -> str:
    """Write the next case whose effect, if it has one, is strong and another than before."""
    while True:
        case = make_case(CaseSpec(SEED, next(indices), kind), robots)
        new = {one.hidden.name for one in case.planted}
        if not new & hidden and all(p.size >= STRONG * p.visible.limit for p in case.planted):
            hidden |= new
            write_case(case, out)
            return case.spec.name


@pytest.fixture(scope="module")
def table(scores: list[CaseScore]) -> Summary:
    return summarise(scores)


def test_every_case_is_answered(scores: list[CaseScore]) -> None:
    assert [s.exit for s in scores] == [0] * 12
    assert {s.kind for s in scores} == {"single", "clean", "outside"}


def test_strong_effects_are_found_and_named(table: Summary, scores: list[CaseScore]) -> None:
    assert table.rates["in_set"].of == 6
    assert table.rates["in_set"].hits >= 5, scores
    assert table.rates["detected"].hits >= 5, scores


def test_clean_recordings_are_left_alone(table: Summary, scores: list[CaseScore]) -> None:
    assert table.rates["clean_with_finding"].hits == 0, scores


def test_physics_of_no_catalogue_gets_no_name(table: Summary, scores: list[CaseScore]) -> None:
    assert table.rates["outside_wrong_name"].hits == 0, scores


def test_the_fit_is_about_as_good_as_one_that_was_told(table: Summary) -> None:
    told = table.numbers["median_heldout_ratio"]
    assert told is not None
    assert told < 1.1
