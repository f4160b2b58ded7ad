"""Mutation testing of gate and watchdogs: the committed run is of these sources and argued."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from hydro_ident.errors import IdentError
from hydro_ident.study.mutants import changes as changes_module
from hydro_ident.study.mutants.__main__ import run
from hydro_ident.study.mutants.changes import changes
from hydro_ident.study.mutants.harmless import HARMLESS
from hydro_ident.study.mutants.listed import TARGETS
from hydro_ident.study.mutants.page import with_table
from hydro_ident.study.sources import differing, digest, digests_of

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "hydro_msgs_docs"
#: In a process of its own, as forks must not find the bridge imported.
TRIALS = """
import sys
from pathlib import Path
from hydro_ident.study.mutants import trial
from hydro_ident.study.mutants.listed import TARGETS
root = Path(sys.argv[1])
(link,) = (target for target in TARGETS if target.name == "link")
source = (root / link.file).read_text()
first = "        sent = self._bus.send(frame)"
assert first in source
trial.prepare()
print(trial.tried(root, link, source))
print(trial.tried(root, link, source.replace("+ 1", "+ 2")))
print(trial.tried(root, link, "raise ImportError"))
trial._MOST_CPU_S, whole = 1, trial._MOST_CPU_S
print(trial.tried(root, link, source.replace(first, "        while True: pass")))
trial._MOST_CPU_S = whole
print(trial.covered(root, link).lines)
(device,) = (target for target in TARGETS if target.name == "device")
print(trial.covered(root, device).lines)
"""
SOURCE = """\
def limit(a: int, b: int) -> int:
    \"\"\"The smaller.\"\"\"
    if a < b:
        return a
    return b + 1
"""


def committed() -> list[dict[str, Any]]:
    found = json.loads((DOCS / "results/mutants.json").read_text(encoding="utf-8"))
    modules: list[dict[str, Any]] = found["modules"]
    return modules


def test_the_page_is_the_list_and_the_committed_run() -> None:
    text = (DOCS / "safety_case.md").read_text(encoding="utf-8")
    assert with_table(text, DOCS / "results") == text


def test_the_committed_run_is_of_these_sources() -> None:
    """Who changes the gate or a watchdog runs `scripts/mutants.sh` for it again."""
    assert {row["file"]: row["sha256"] for row in committed()} == {
        target.file: digest(ROOT / target.file) for target in TARGETS
    }
    assert {row["name"]: row["tests"] for row in committed()} == {
        target.name: list(target.tests) for target in TARGETS
    }


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_the_committed_run_is_of_these_tests(target: Any) -> None:
    """A test that asserts less than it did may notice less: `scripts/mutants.sh` says whether."""
    (row,) = (row for row in committed() if row["name"] == target.name)
    found = digests_of(ROOT, target.test_files(ROOT), ())
    assert len(found) >= len(target.tests)
    changed = differing(row["tests_sha256"], found)
    assert changed == [], f"run: scripts/mutants.sh --json FILE {target.name}"


def test_every_line_and_branch_is_covered() -> None:
    for row in committed():
        found = row["coverage"]
        assert found["lines_covered"] == found["lines"] > 0
        assert found["branches_covered"] == found["branches"]


def test_every_survivor_is_argued_and_every_argument_has_one() -> None:
    survivors = {
        (row["name"], one["where"], one["before"], one["after"])
        for row in committed()
        for one in row["survivors"]
    }
    assert survivors == {(h.target, h.where, h.before, h.after) for h in HARMLESS}
    assert len(HARMLESS) == len(survivors)
    assert all(len(h.why) > 20 for h in HARMLESS)
    for row in committed():
        ends = row["killed"] + row["not_loaded"] + row["timed_out"] + row["survived"]
        assert row["changes"] == ends > 10
        assert row["survived"] == len(row["survivors"]) < 0.1 * ends


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_tests_and_sources_are_there(target: Any) -> None:
    for path in (target.file, *target.tests):
        assert (ROOT / path).exists()


def test_changes_are_other_programs() -> None:
    pytest.importorskip("cosmic_ray")
    found = changes(SOURCE)
    assert {(one.line, one.after) for one in found} == {
        (3, "if a <= b:"),
        (3, "if a >= b:"),
        (3, "if not a < b:"),
        (4, "pass"),
        (5, "pass"),
        (5, "return b - 1"),
        (5, "return b + 2"),
        (5, "return b + 0"),
    }
    assert {one.where for one in found} == {"limit"}
    for one in found:
        compile(one.source, "changed", "exec")


def test_what_is_missing_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(name: str) -> Any:
        raise ImportError(f"no module named {name}")

    monkeypatch.setattr(changes_module.importlib, "import_module", missing)
    with pytest.raises(IdentError, match=r"pip install .*requirements-mutation\.in"):
        changes(SOURCE)
    with pytest.raises(IdentError, match="found 'no_such'"):
        run(["no_such"])
    assert run(["--list"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(TARGETS)


@pytest.mark.thorough
def test_changes_are_tried_in_forks_and_the_sources_stay() -> None:
    (link,) = (target for target in TARGETS if target.name == "link")
    before = (ROOT / link.file).read_bytes()
    said = subprocess.run(
        [sys.executable, "-c", TRIALS, str(ROOT)], capture_output=True, text=True, check=True
    )
    *ends, lines, of_a_function = said.stdout.split()
    assert ends == ["survived", "killed", "not_loaded", "timed_out"]
    assert int(lines) > 10
    assert 1 < int(of_a_function) < 10  # of the function, not of the module
    assert TARGETS[-1].holds("Device.takes")
    assert not TARGETS[-1].holds("Device.run")
    assert (ROOT / link.file).read_bytes() == before
