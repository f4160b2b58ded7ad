"""Studies behind figures of the pages, and the demo, at their least: as a user runs them.

Minutes each, so thorough. What they rest on has tests of its own; here it is that each runs, and
that what it prints has the physics that the pages say of it.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hydro_ident.study.conceal import write_case
from hydro_ident.study.generate import CaseSpec, make_case
from hydro_ident.study.robots import study_robot

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "hydro_msgs_docs/results"

pytestmark = pytest.mark.thorough


def said_by(folder: Path, *words: str) -> str:
    """What a command prints that ends well, within an hour."""
    one_core = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        words,
        cwd=folder,
        env=os.environ | one_core,
        capture_output=True,
        text=True,
        timeout=3600,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def study(folder: Path, name: str, *words: str) -> str:
    return said_by(folder, sys.executable, "-m", f"hydro_ident.study.{name}", *words)


def rows(said: str) -> list[list[str]]:
    """Cells of the Markdown tables in it, without their headings' rules."""
    lines = [line for line in said.splitlines() if line.startswith("|")]
    cells = [[one.strip() for one in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if not re.fullmatch("-+", row[0])]


def numbers(text: str) -> list[float]:
    return [float(one) for one in re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", text)]


def test_the_demo_gives_the_table_of_the_readme(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    said = said_by(tmp_path, f"{ROOT}/scripts/demo.sh", "--out", str(out))
    found = json.loads((out / "tracking.json").read_text(encoding="utf-8"))
    published = json.loads((RESULTS / "demo_tracking.json").read_text(encoding="utf-8"))
    for row in ("nominal_70bar", "nominal_35bar", "identified", "discovered"):
        # In lockstep: other linear algebra may differ in the last digits, and no more.
        assert found[row] == pytest.approx(published[row], rel=0.02)
    assert str(out / "discovered") in said


def test_a_soak_of_a_second_counts_its_cycles(tmp_path: Path) -> None:
    file = tmp_path / "soak.json"
    script = f"{ROOT}/scripts/soak.sh"
    said = said_by(ROOT, script, "--minutes", "0.02", "--json", str(file))
    assert "bridge" in said
    assert json.loads(file.read_text(encoding="utf-8"))["cycles"] == 600


def test_adaptation_weighs_a_payload(tmp_path: Path) -> None:
    said = study(tmp_path, "adaptation", "--seeds", "101", "--models", "exact")
    off, weighed, whole = (row for row in rows(said) if row[0] == "101")
    assert (off[2], weighed[2]) == ("off", "payload")
    for row in (weighed, whole):
        before, after = numbers(row[6].replace("->", " "))
        assert abs(before) < 2.0
        assert abs(after - 50.0) < 2.0
    assert numbers(whole[4])[0] < numbers(weighed[4])[0] < numbers(off[4])[0]


def test_intervals_hold_where_those_of_independent_rows_do_not(tmp_path: Path) -> None:
    said = study(tmp_path, "coverage", "--count", "2")
    covered = [row for row in rows(said) if "." in row[0]]
    assert len(covered) >= 20
    shares = [numbers(cell) for row in covered for cell in row[1:]]
    assert sum(own for own, *_ in shares) / len(shares) > 85.0
    assert sum(iid for _, iid, _ in shares) / len(shares) < 70.0
    assert all(width > 1.2 for _, _, width in shares)


def test_the_designed_excitation_beats_the_parallelogram(tmp_path: Path) -> None:
    said = study(tmp_path, "excitation", "--duration", "30", "--truth", "realistic")
    condition = next(row for row in rows(said) if row[0] == "condition")
    assert float(condition[3]) > 3.0
    mean, least = numbers(re.search(r"geometric mean of the gains.*", said)[0])  # type: ignore[index]
    assert mean > 2.0
    assert least > 0.9
    ratios = [float(row[3]) for row in rows(said.split("stated by the fit")[1])]
    assert len(ratios) == 8
    assert all(0.7 < ratio < 1.5 for ratio in ratios)


def test_known_friction_and_overlap_are_what_the_tip_feels(tmp_path: Path) -> None:
    said = study(tmp_path, "known_effects", "--seeds", "101")
    shipped = next(row for row in rows(said) if row[1:2] == ["shipped"])
    base, known, wrong = (numbers(cell)[0] for cell in shipped[2:5])
    assert known < 0.25 * base
    assert known < wrong < base
    left_out = {row[0]: numbers(row[1])[0] for row in rows(said) if len(row) == 2}
    assert left_out.pop("left out") == 101
    worst = sorted(left_out, key=lambda name: -left_out[name])[:2]
    assert set(worst) == {"coulomb_friction", "valve_deadband"}
    assert left_out["nothing"] == known


def test_intervals_hold_where_pressures_are_noisy(tmp_path: Path) -> None:
    said = study(tmp_path, "pressure_coverage", "--count", "1")
    cases = [row for row in rows(said) if row[0] != "Readings"]
    assert len(cases) == 10
    assert all(row[6] == "0" for row in cases)
    assert all(abs(float(row[5])) < 2.0 for row in cases)
    shares = [float(cell) for row in cases for cell in row[2:5]]
    assert sum(shares) / len(shares) > 85.0


def test_memory_does_not_grow_with_a_bag(tmp_path: Path) -> None:
    said = study(tmp_path, "long_bag", "--minutes", "1", "4", "--folder", str(tmp_path))
    (_, short_mb, short, _), (_, long_mb, long, _) = (
        [float(cell) for cell in row] for row in rows(said) if row[0] != "minutes"
    )
    assert long_mb > 2.0 * short_mb
    assert long < 1.3 * short
    assert not list(tmp_path.iterdir())


def test_forms_of_a_hidden_law_stand_beside_its_truth(tmp_path: Path) -> None:
    robot = study_robot(tmp_path / "robots", 7, 0)
    case = make_case(CaseSpec(7, 0, "outside"), [robot])
    write_case(case, tmp_path)
    said = study(tmp_path, "forms", str(tmp_path))
    first, *found = said.splitlines()
    hidden = case.planted[0].hidden
    assert first.startswith(f"{case.spec.name}: {hidden.name} of ")
    assert "times its limit" in first
    assert found
    assert all(line.startswith("    ") for line in found)


def test_discovered_physics_is_worth_its_while_on_one_machine(tmp_path: Path) -> None:
    file = tmp_path / "one.json"
    words = ("--plants", "1", "--seed", "2", "--no-ablation", "--out", str(file))
    said = study(tmp_path, "discovered", *words)
    assert "machine 2" in said
    (plant,) = json.loads(file.read_text(encoding="utf-8"))["plants"]
    rho = {name: row["rho_s"] for name, row in plant["rows"].items()}
    assert rho["discovered"] < rho["identified"] < rho["nominal"]
