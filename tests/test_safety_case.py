"""The safety case names tests that exist, and shows the committed campaign."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path
from typing import Any

import pytest

from hydro_ident.study.faults.device_time import run, summary
from hydro_ident.study.faults.page import with_tables
from hydro_model.robot_files import load_robot

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "hydro_msgs_docs/safety_case.md"
RESULTS = ROOT / "hydro_msgs_docs/results"
FOLDERS = ("hydro_hw_bridge/test", "hydro_control/test", "hydro_ident/test", "tests")
NAMED = sorted(set(re.findall(r"`(test_\w+\.py)::(test_\w+)`", PAGE.read_text(encoding="utf-8"))))


def committed() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((RESULTS / "faults.json").read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize(("file", "name"), NAMED, ids=["::".join(one) for one in NAMED])
def test_every_named_test_exists(file: str, name: str) -> None:
    paths = [path for folder in FOLDERS for path in (ROOT / folder).rglob(file)]
    assert len(paths) == 1, file
    tree = ast.parse(paths[0].read_text(encoding="utf-8"))
    assert name in {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}


def test_every_promise_names_a_test() -> None:
    text = PAGE.read_text(encoding="utf-8")
    promised = text.partition("## What is promised")[2].partition("## What 0 V")[0]
    rows = [line for line in promised.splitlines() if line.startswith("| ")]
    promises = [row for row in rows if not row.startswith("| Promise |")]
    assert len(promises) > 25
    assert [row for row in promises if "::test_" not in row] == []


def test_the_tables_are_the_committed_campaign() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert with_tables(text, RESULTS) == text


def test_the_committed_campaign_kept_every_promise_in_device_time() -> None:
    found = committed()["device_time"]
    assert found["injections"] >= 1000
    assert found["broken"] == []
    assert found["worst_ms"] <= 50.0


def test_the_campaign_tried_parameters_and_processes() -> None:
    found = committed()["wall_time"]
    kinds = found["kinds"]
    for process in ("can_bridge", "controller"):
        for number in ("SIGKILL", "SIGSTOP", "SIGTERM"):
            assert f"process: {number} of {process}" in kinds
    assert "parameters changed while driving" in kinds
    assert found["broken"] == []
    assert found["timer_late_ms"]["wakes"] > 1000


def test_the_campaign_gives_the_same_numbers_again() -> None:
    robot = load_robot("xs031")
    first, again = (summary(run(robot, range(7000, 7012)), 0.002) for _ in range(2))
    assert first == again
    assert first["broken"] == []
