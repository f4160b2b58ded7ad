"""The safety case names tests that exist, and shows the committed campaign."""

from __future__ import annotations

import ast
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from hydro_hw_bridge.faults.injections import ORDER
from hydro_hw_bridge.faults.naming import SILENT
from hydro_ident.study.faults.__main__ import SCHEMA
from hydro_ident.study.faults.__main__ import run as campaign
from hydro_ident.study.faults.device_time import CONTROLLER_EVERY, LOCKSTEP_EVERY, run, summary
from hydro_ident.study.faults.page import told, with_tables
from hydro_ident.study.faults.sources import BESIDE, changed, digests
from hydro_ident.study.faults.sources import FOLDERS as SOURCES
from hydro_model.robot_files import load_robot

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "hydro_msgs_docs/safety_case.md"
RESULTS = ROOT / "hydro_msgs_docs/results"
FOLDERS = (
    "hydro_hw_bridge/test",
    "hydro_control/test",
    "hydro_ident/test",
    "hydro_msgs_docs/test",
    "ros2_ws/src/hydro_model/test",
    "tests",
)
PROCESSES = (
    "can_bridge",
    "controller",
    "sim_rig",
    "recorder",
    "send_path",
    "identification_node",
)
#: Kinds of faults of the campaign that keep samples away, and those of processes.
STARVING = ("lost", "late", "split")
PROCESS_FAULTS = (
    "bus: foreign (bridge)",
    "bus: frozen (bridge)",
    "machine: bridge_dead",
    "machine: bridge_stopped",
    "machine: controller_stopped",
    "machine: device_silent",
    "publisher: late",
    "publisher: silent",
)
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
    assert never_run(tree, name) == ""
    # The page says so of this file alone.
    assert not only_when_asked(tree, name) or file == "test_wall_faults.py"


def never_run(tree: ast.Module, name: str) -> str:
    """What keeps a test from running, or from turning red, on every computer; empty: nothing."""
    said = [ast.unparse(mark) for mark in marks_of(tree, name) if _unconditional(mark)]
    # What stands under an `if` is another matter: not every computer has what a test needs.
    for line in (*tree.body, *function_of(tree, name).body):
        text = ast.unparse(line)
        if isinstance(line, ast.Expr) and re.match(r"pytest\.(skip|xfail)\(", text):
            said.append(text)
    return "; ".join(said)


def only_when_asked(tree: ast.Module, name: str) -> bool:
    """Whether a test runs only where somebody has set an environment variable for it."""
    return any(
        ast.unparse(mark).startswith("pytest.mark.skipif(") and "environ" in ast.unparse(mark)
        for mark in marks_of(tree, name)
    )


def function_of(tree: ast.Module, name: str) -> ast.FunctionDef:
    [test] = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == name]
    return test


def marks_of(tree: ast.Module, name: str) -> list[ast.expr]:
    """Marks of a test and of its module, those too that have a name of their own there."""
    assigned = {
        ast.unparse(node.targets[0]): node.value
        for node in tree.body
        if isinstance(node, ast.Assign)
    }
    marks: list[ast.expr] = list(function_of(tree, name).decorator_list)
    every = assigned.get("pytestmark")
    if every is not None:
        marks += every.elts if isinstance(every, ast.List | ast.Tuple) else [every]
    return [assigned.get(ast.unparse(mark), mark) for mark in marks]


def _unconditional(mark: ast.expr) -> bool:
    """Whether a mark skips a test, or expects it to fail, whatever the computer is."""
    name = ast.unparse(mark.func if isinstance(mark, ast.Call) else mark)
    given = [a for a in mark.args if not _true(a)] if isinstance(mark, ast.Call) else []
    if name == "pytest.mark.skip":
        return True
    return name in ("pytest.mark.skipif", "pytest.mark.xfail") and not given


def _true(value: ast.expr) -> bool:
    return isinstance(value, ast.Constant) and bool(value.value)


@pytest.mark.parametrize(
    ("text", "runs"),
    [
        ("@pytest.mark.parametrize('a', [1])\ndef test_it(a): assert a", True),
        ("@pytest.mark.skipif(not HERE, reason='none')\ndef test_it(): pass", True),
        ("pytestmark = pytest.mark.ros\ndef test_it():\n  if not HERE: pytest.skip()", True),
        ("@pytest.mark.skip\ndef test_other(): pass\ndef test_it(): pass", True),
        ("@pytest.mark.skip\ndef test_it(): pass", False),
        ("slow = pytest.mark.skip\n@slow\ndef test_it(): pass", False),
        ("slow = pytest.mark.skipif(not HERE, reason='')\n@slow\ndef test_it(): pass", True),
        ("@pytest.mark.skip(reason='slow')\ndef test_it(): pass", False),
        ("@pytest.mark.skipif(True, reason='slow')\ndef test_it(): pass", False),
        ("@pytest.mark.xfail(reason='red')\ndef test_it(): pass", False),
        ("pytestmark = [pytest.mark.ros, pytest.mark.skip]\ndef test_it(): pass", False),
        ("def test_it():\n  pytest.skip('slow')", False),
        ("pytest.skip('slow', allow_module_level=True)\ndef test_it(): pass", False),
    ],
)
def test_a_named_test_that_never_runs_is_told(text: str, runs: bool) -> None:
    assert (never_run(ast.parse(text), "test_it") == "") is runs


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("@pytest.mark.skipif('A' not in os.environ, reason='')\ndef test_it(): pass", True),
        ("q = pytest.mark.skipif(not os.environ.get('A'))\n@q\ndef test_it(): pass", True),
        ("pytestmark = pytest.mark.skipif('A' not in os.environ)\ndef test_it(): pass", True),
        ("@pytest.mark.skipif(not HERE, reason='none')\ndef test_it(): pass", False),
        ("@pytest.mark.parametrize('a', os.environ)\ndef test_it(a): pass", False),
        ("q = pytest.mark.skipif('A' not in os.environ)\ndef test_it(): pass", False),
    ],
)
def test_a_named_test_that_runs_only_when_asked_is_told(text: str, asked: bool) -> None:
    assert only_when_asked(ast.parse(text), "test_it") is asked


def asked_for(row: str) -> list[bool]:
    """Of every test that a row names: whether it runs only when asked."""
    named = re.findall(r"`(test_\w+\.py)::(test_\w+)`", row)
    paths = {file: next(p for f in FOLDERS for p in (ROOT / f).rglob(file)) for file, _ in named}
    return [
        only_when_asked(ast.parse(paths[file].read_text(encoding="utf-8")), name)
        for file, name in named
    ]


def test_every_promise_names_a_test() -> None:
    text = PAGE.read_text(encoding="utf-8")
    promised = text.partition("## What is promised")[2].partition("## What 0 V")[0]
    rows = [line for line in promised.splitlines() if line.startswith("| ")]
    promises = [row for row in rows if not row.startswith("| Promise |")]
    assert len(promises) > 25
    assert [row for row in promises if "::test_" not in row] == []
    # One at least that turns red in every run of the tests, not only where somebody asks for it.
    assert [row for row in promises if all(asked_for(row))] == []


def test_what_is_said_before_the_tables_is_of_the_run_in_them() -> None:
    text = PAGE.read_text(encoding="utf-8")
    [(count, minutes)] = re.findall(
        r"so that (\d+) injections \(the default, (\d+) minutes\) are five of each", text
    )
    assert f"{count} injections in {minutes} minutes" in text
    # A promise names what it depends on beside its number, not only further down.
    [row] = [ln for ln in text.splitlines() if ln.startswith("| A recorder killed at any moment")]
    assert "operating system or the disk" in row
    assert "(#known-limits)" in row


def test_the_tables_are_the_committed_campaign() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert with_tables(text, RESULTS) == text


def test_the_committed_campaign_is_of_these_sources() -> None:
    """Who changes the bridge, the rig or the faults runs `scripts/faults.sh` again.

    What real processes did takes long to run, and may be older: then the page says what changed.
    """
    found = committed()
    assert changed(found["device_time"]["sources"], ROOT) == []
    wall = found["wall_time"]
    assert wall["changed_since"] == changed(wall["sources"], ROOT, wall=True)
    assert len(wall["sources"]) > 50


def test_the_committed_campaign_kept_every_promise_in_device_time() -> None:
    found = committed()["device_time"]
    kinds = found["kinds"]
    assert found["injections"] >= 1200
    assert found["broken"] == []
    assert found["worst_ms"] <= 50.0
    assert sum(row["injections"] for kind, row in kinds.items() if "several:" in kind) >= 100
    for kind in ("babble (device)", "foreign (device)", "stuck (encoder)", "stuck (pressure)"):
        assert kinds[f"bus: {kind}"]["injections"] >= 15
    assert min(row["injections"] for row in kinds.values()) >= 6
    # Of whatever a stop may be promised, some had one.
    for kind in (*(f"bus: {kind} (device)" for kind in STARVING), *PROCESS_FAULTS):
        assert kinds[kind]["stops_promised"] >= 3, kind
    # Whatever else was injected had to be named.
    silent = found["silent"]
    assert set(silent) <= set(SILENT)
    assert sum(row["injections"] for row in silent.values()) < 0.2 * found["injections"]


def test_the_campaign_tried_parameters_and_processes() -> None:
    found = committed()["wall_time"]
    kinds = found["kinds"]
    for process in PROCESSES:
        for number in ("SIGKILL", "SIGSTOP", "SIGTERM"):
            assert f"process: {number} of {process}" in kinds
    assert "parameters changed while driving" in kinds
    assert min(row["injections"] for row in kinds.values()) >= 5
    assert found["broken"] == []
    assert found["timer_late_ms"]["wakes"] > 1000


def test_a_part_that_was_not_run_again_stays_and_says_what_has_changed(tmp_path: Path) -> None:
    (tmp_path / SOURCES[0]).mkdir(parents=True)
    source = tmp_path / SOURCES[0] / "gate.py"
    source.write_text("LIMIT = 1\n")
    then = digests(tmp_path)
    assert changed(then, tmp_path) == []
    source.write_text("LIMIT = 2\n")
    (tmp_path / SOURCES[0] / "new.py").write_text("")
    out = tmp_path / "faults.json"
    wall = committed()["wall_time"] | {"sources": then, "date": "2026-01-01"}
    wall = {"minutes": 3.0, "changed_since": [], **wall}
    out.write_text(json.dumps({"schema": SCHEMA, "wall_time": wall}))
    words = ["--injections", "1", "--processes", "0", "--root", str(tmp_path), "--json", str(out)]
    assert campaign(words) == 0
    found = json.loads(out.read_text())
    assert found["device_time"]["sources"] == digests(tmp_path)
    assert found["device_time"]["changed_since"] == []
    assert found["wall_time"]["changed_since"] == [
        f"{SOURCES[0]}/gate.py",
        f"{SOURCES[0]}/new.py",
    ]
    assert "Run of 2026-01-01, wall time" in told(found)
    assert "Changed since that run: of `hydro_hw_bridge` `gate.py`, `new.py`." in told(found)


def test_a_run_is_of_whatever_runs_in_it() -> None:
    """The real controller's core answers every third injection: a run is of its law, too."""
    device, wall = digests(ROOT), digests(ROOT, wall=True)
    for path in (
        "hydro_control/hydro_control/core/core.py",
        "hydro_control/hydro_control/law/law_kernels.py",
        "hydro_msgs_docs/hydro_msgs_docs/topics.py",
        "ros2_ws/src/hydro_model/hydro_model/multibody/kinematics.py",
        "ros2_ws/src/hydro_model/hydro_model/hydraulics/valve.py",
    ):
        assert path in device
    beside = set(wall) - set(device)
    assert set(BESIDE) < beside
    # Not the files alone that are run, but what does the work in them, wherever it is imported.
    for name in (
        *("identify/identification", "parameters/parameters", "recordings/sources"),
        *("bag/recorder_topics", "bag/writer"),
    ):
        assert f"hydro_ident/hydro_ident/{name}.py" in beside
    assert not [path for path in beside if "/commands/" in path]


def test_changed_sources_are_told_by_folder_and_not_where_none_had_a_digest() -> None:
    paths = [f"hydro_hw_bridge/hydro_hw_bridge/part{k:02d}.py" for k in range(21)]
    paths += [
        "hydro_control/hydro_control/core/core.py",
        "ros2_ws/src/hydro_model/hydro_model/description/urdf.py",
    ]
    wall = committed()["wall_time"] | {"changed_since": paths}
    wall["sources"] = {paths[0]: "", paths[-2]: ""}
    text = told({"wall_time": wall})
    assert "Changed since that run: of `hydro_control/core` `core.py`; 21 sources of" in text
    assert (
        "no digests of `hydro_model/description`: whether these changed since is not known" in text
    )


def test_every_family_meets_both_clocks_and_both_publishers() -> None:
    assert math.gcd(len(ORDER), LOCKSTEP_EVERY * CONTROLLER_EVERY) == 1


def test_the_campaign_gives_the_same_numbers_again() -> None:
    robot = load_robot("xs031")
    first, again = (summary(run(robot, range(7000, 7012)), 0.002) for _ in range(2))
    assert first == again
    assert first["broken"] == []
