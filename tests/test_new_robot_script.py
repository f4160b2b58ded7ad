"""`scripts/new_robot.sh`: an error of the check is its exit code, and can be corrected."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
URDF = """<robot name="crane">
  <link name="base"/>
  <joint name="lift" type="revolute">
    <parent link="base"/><child link="boom"/><axis xyz="0 -1 0"/>
    <limit lower="-0.2" upper="1.0" effort="40000" velocity="0.8"/>
  </joint>
  <link name="boom"><inertial><mass value="180"/><origin xyz="1.2 0 0"/>
    <inertia ixx="3" iyy="95" izz="95" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="end" type="fixed"><parent link="boom"/><child link="tip"/>
    <origin xyz="2 0 0"/></joint>
  <link name="tip"/>
</robot>
"""
REST = ["--tip", "tip", "--valve", "60", "35", "--supply", "180", "--cylinder", "lift"]
PINS, SIZES = ["0.30", "-0.95", "0.80", "-0.08"], ["0.800", "0.830"]


def run(urdf: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    script = ["bash", str(ROOT / "scripts/new_robot.sh"), str(urdf), *REST, *arguments]
    return subprocess.run(script, capture_output=True, text=True, check=False, cwd=urdf.parent)


def test_a_unit_that_was_mistaken_is_corrected_by_force(tmp_path: Path) -> None:
    urdf = tmp_path / "crane.urdf"
    urdf.write_text(URDF, encoding="utf-8")
    wrong = run(urdf, *PINS, "80", "45", *SIZES)
    assert wrong.returncode == 1
    assert "80 mm are 0.08 m" in wrong.stdout
    assert "--force writes both anew" in wrong.stderr
    right = [*PINS, "0.080", "0.045", *SIZES]
    refused = run(urdf, *right)
    assert refused.returncode == 2
    assert "replace it with --force" in refused.stderr
    done = run(urdf, *right, "--force")
    assert done.returncode == 0, done.stderr
    assert "crane: 1 joint, 1 cylinder (" in done.stdout
    assert "ERROR" not in done.stdout


def test_what_was_not_given_is_asked_for(tmp_path: Path) -> None:
    urdf = tmp_path / "crane.urdf"
    urdf.write_text(URDF, encoding="utf-8")
    right = [*PINS, "0.080", "0.045", *SIZES]
    said = run(urdf, *right).stdout
    assert "no rated_voltage_v: 10 V is taken" in said
    assert "no rate_hz: 500 Hz is taken" in said
    given = ["--rated-voltage", "5", "--rate", "1000", "--force"]
    said = run(urdf, *right, *given).stdout
    assert "rated_voltage_v" not in said
    assert "rate_hz" not in said


def test_programs_get_the_check_and_nothing_else(tmp_path: Path) -> None:
    urdf = tmp_path / "crane.urdf"
    urdf.write_text(URDF, encoding="utf-8")
    right = [*PINS, "0.080", "0.045", *SIZES]
    done = run(urdf, *right, "--json", "-")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["schema"] == "hydro_ident/robot_check/1"
    assert [one["name"] for one in found["cylinders"]] == ["lift_cylinder"]
    file = tmp_path / "its check.json"
    wrong = run(urdf, *PINS, "80", "45", *SIZES, "--force", f"--json={file}")
    assert wrong.returncode == 1
    assert json.loads(file.read_text())["schema"] == found["schema"]
    assert "crane: 1 joint, 1 cylinder (" in wrong.stdout
    page = (tmp_path / "crane.html").read_text(encoding="utf-8")
    assert str(tmp_path) not in page


def test_json_without_a_file_is_bad_usage(tmp_path: Path) -> None:
    urdf = tmp_path / "crane.urdf"
    urdf.write_text(URDF, encoding="utf-8")
    done = run(urdf, *PINS, "0.080", "0.045", *SIZES, "--json")
    assert done.returncode == 2
    assert "--json" in done.stderr
    assert not urdf.with_suffix(".hydraulics.yaml").exists()
