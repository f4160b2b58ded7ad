"""Long commands of the pages at their least: through the scripts, the same work, a few of each.

What they find is tested where docs_commands.yaml and the pages say; here it is that they run.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hydro_ident.bench.limits import EMPTY, HELP, INSPECTED
from hydro_ident.study.fuzz.targets import TARGETS

ROOT = Path(__file__).resolve().parents[1]


def said_by(folder: Path, *words: str) -> str:
    """What a command prints that ends well in a folder of its own."""
    done = subprocess.run(
        words, cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert {one.suffix for one in folder.iterdir()} <= {".json"}
    return done.stdout


def test_faults_are_injected_and_no_promise_is_broken(tmp_path: Path) -> None:
    script = f"{ROOT}/scripts/faults.sh"
    count = ("--injections", "2", "--processes", "0")
    said = said_by(tmp_path, script, *count, "--json", "faults.json")
    assert re.search(r"device time: 2 injections \(\d of them in lockstep\).* 0 broken", said)
    found = json.loads((tmp_path / "faults.json").read_text(encoding="utf-8"))
    assert found["device_time"]["injections"] == 2
    assert "wall_time" not in found


@pytest.mark.thorough
def test_the_benchmark_times_a_group_and_writes_it_down(tmp_path: Path) -> None:
    script = f"{ROOT}/scripts/bench.sh"
    said = said_by(tmp_path, script, "--only", "start", "--rounds", "1", "--json", "bench.json")
    rows = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    assert [row["job"] for row in rows] == [EMPTY, HELP, INSPECTED]
    assert all(row["ours"] > 0.0 and f"| {row['job']} | 0.5 s" in said for row in rows)


def test_every_loader_is_fuzzed(tmp_path: Path) -> None:
    script = f"{ROOT}/scripts/fuzz.sh"
    said = said_by(tmp_path, script, "--minutes", "0.001", "--json", "fuzz.json")
    found = json.loads((tmp_path / "fuzz.json").read_text(encoding="utf-8"))
    assert set(found["targets"]) == {target.name for target in TARGETS}
    for name, tally in found["targets"].items():
        assert tally["read"] + tally["refused"] >= 1
        assert re.search(rf"^{name} .* 0 findings", said, re.M)


@pytest.mark.thorough
def test_a_sabotage_is_caught(tmp_path: Path) -> None:
    said = said_by(tmp_path, f"{ROOT}/scripts/sabotage.sh", "gaps_bridged")
    assert said.startswith("caught gaps_bridged: AssertionError")
    assert said.endswith("1 of 1 sabotages were caught\n")


def test_the_study_of_consistent_bodies_finds_them(tmp_path: Path) -> None:
    module = "hydro_ident.study.consistency"
    said = said_by(tmp_path, sys.executable, "-m", module, "--count", "1")
    rows = [
        line.split() for line in said.splitlines() if " / " in line and line.split()[0].isdigit()
    ]
    assert {row[0] for row in rows} >= {"1", "2", "7"}
    assert all(float(row[5]) < 1e-10 for row in rows)
    # What noise of a hundredth leaves may be of no bodies.
    assert all(row[2:5] == ["1", "/", "1"] for row in rows if float(row[1]) < 1e-2)
