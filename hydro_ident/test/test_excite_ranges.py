"""Experiments for joints with next to no range, and for joints without an end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_ident.commands.excite import main
from hydro_ident.design import poses
from hydro_model.motion.paths import load_path
from hydro_model.robot_files import shipped_robots

pytestmark = pytest.mark.long

SLIDE = """<robot name="slide">
  <link name="base"/>
  <joint name="slide" type="prismatic">
    <parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
    <limit lower="0.0" upper="{stroke}" effort="20000" velocity="0.3"/>
  </joint>
  <link name="cart"><inertial><mass value="200"/><origin xyz="0 0 0"/>
    <inertia ixx="3" iyy="3" izz="3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="end" type="fixed"><parent link="cart"/><child link="tip"/></joint>
  <link name="tip"/>
</robot>
"""
SLEW = """<link name="base_link"/>
  <joint name="slew" type="continuous">
    <parent link="base_link"/><child link="post"/><axis xyz="0 0 1"/>{limit}
  </joint>
  <link name="post"><inertial><mass value="100"/><origin xyz="0 0 0"/>
    <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
LIMIT = '<limit effort="20000" velocity="0.6"/>'


def sliding(folder: Path, stroke_m: float) -> Path:
    """A cart on a cylinder of some stroke."""
    (folder / "slide.urdf").write_text(SLIDE.format(stroke=stroke_m), encoding="utf-8")
    edges = dict.fromkeys(("c_pa", "c_at", "c_pb", "c_bt"), 3e-07)
    cylinder = {"name": "push", "joint": "slide", "bore_m": 0.05, "rod_m": 0.03}
    content = {
        "robot": "slide",
        "urdf": "slide.urdf",
        "tip_link": "tip",
        "cylinders": [cylinder | {"stroke_m": stroke_m}],
        "valves": [{"name": "valve", "cylinder": "push"} | edges],
        "supply": {"pressure_pa": 18e6},
    }
    file = folder / "slide.hydraulics.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


def slewing(folder: Path, limit: str) -> Path:
    """The reference crane on a post that turns without an end."""
    source = shipped_robots()["xs031"]
    urdf = source.with_name("xs031.urdf").read_text(encoding="utf-8")
    urdf = urdf.replace('<parent link="base_link"/>', '<parent link="post"/>')
    urdf = urdf.replace('<link name="base_link"/>', SLEW.format(limit=limit))
    (folder / "xs031.urdf").write_text(urdf, encoding="utf-8")
    file = folder / source.name
    file.write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    return file


def excite(robot: Path, *words: str, monkeypatch: pytest.MonkeyPatch) -> int:
    out = str(robot.parent / "out")
    arguments = ["excite", "--robot", str(robot), "--out", out, "--duration", "30", *words]
    monkeypatch.setattr("sys.argv", arguments)
    return main()


def test_a_slide_with_a_short_stroke_has_an_experiment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert excite(sliding(tmp_path, 0.08), monkeypatch=monkeypatch) == 0
    path = load_path(tmp_path / "out" / "excitation.yaml")
    q = path.sample_many(np.arange(0.0, path.duration_s, 0.01))[0]
    assert q.max() - q.min() > 0.02
    assert q.min() > 0.008
    assert q.max() < 0.072


def test_no_pose_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The start fits, and of all candidates for poses none does."""
    monkeypatch.setattr(poses, "_NEAR", 0.0)
    assert excite(sliding(tmp_path, 0.5), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "no motion fits the limits of robot slide: of 400 poses none" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.thorough
@pytest.mark.parametrize(
    "start",
    [(), pytest.param(("--start-joints", "0.5", "0.8", "-1.2"), marks=pytest.mark.thorough)],
)
def test_a_slew_without_an_end_has_an_experiment(
    start: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code = excite(slewing(tmp_path, LIMIT), *start, monkeypatch=monkeypatch)
    said = capsys.readouterr()
    assert "nan" not in said.out + said.err
    assert code == 0, said.err


def test_a_joint_without_a_speed_limit_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert excite(slewing(tmp_path, ""), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "expected a velocity in the URDF's <limit> of every joint, found none of slew" in error
