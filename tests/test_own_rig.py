"""A robot of one's own on the simulated rig: nothing is shipped for it but what its files say."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_hw_bridge.rig.truth_log import read_truth_log
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import RECORDING_TOPICS, recording_of
from hydro_model.robot_files import load_robot, shipped_robots

pytestmark = pytest.mark.ros
ROOT = Path(__file__).parents[1]
DOMAIN = 10 + (os.getpid() + 31) % 90
PATIENCE_S = 480.0
BOOM = """<joint name="extend" type="prismatic">
    <parent link="tilt_link"/><child link="boom"/>
    <origin xyz="1.4 0 0" rpy="0 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0.1" upper="1.2" effort="20000" velocity="0.4"/>
  </joint>
  <link name="boom"><inertial><mass value="80"/><origin xyz="0.3 0 0"/>
    <inertia ixx="1" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="tip" type="fixed">
    <parent link="boom"/>"""
OLD = """<joint name="tip" type="fixed">
    <parent link="tilt_link"/>"""
PATH = """\
joints: [extend, lift]
start: [0.5, 0.6]
segments: [{kind: move, to: [0.7, 0.65], duration_s: 1.5}]
"""


@pytest.fixture
def crane(tmp_path: Path) -> Path:
    """A crane with a telescope that no package knows."""
    source = shipped_robots()["xs031"]
    data = yaml.safe_load(source.read_text(encoding="utf-8")) | {"robot": "mycrane"}
    push = {"name": "push", "joint": "extend", "bore_m": 0.06, "rod_m": 0.04}
    data["cylinders"].append(push | {"x0_m": 0.1, "stroke_m": 1.1})
    edges = dict.fromkeys(("c_pa", "c_at", "c_pb", "c_bt"), 3e-7)
    data["valves"].append({"name": "push_valve", "cylinder": "push"} | edges)
    file = tmp_path / "mycrane.hydraulics.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    urdf = source.with_name("xs031.urdf").read_text(encoding="utf-8")
    (tmp_path / "xs031.urdf").write_text(urdf.replace(OLD, BOOM), encoding="utf-8")
    (tmp_path / "path.yaml").write_text(PATH, encoding="utf-8")
    return file


def run(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    named = ["--name", "own", "--out", str(folder / "out"), "--path", str(folder / "path.yaml")]
    return subprocess.run(
        ["bash", str(ROOT / "scripts/rig_run.sh"), *named, *options],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)},
        timeout=PATIENCE_S,
        check=False,
    )


@pytest.mark.thorough
def test_it_is_driven_along_a_path_on_a_bus_that_is_made_for_it(crane: Path) -> None:
    folder = crane.parent
    done = run(
        folder, "--rig", str(crane), "--joints", "0.6 -1.5 0.5", "--duration", "3.5", "--seed", "2"
    )
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (folder / "out/bus").iterdir()}
    assert names == {"mycrane.dbc", "mycrane.mapping.yaml"}
    robot = load_robot(crane)
    truth = read_truth_log(folder / "out/truth/own.npz")
    q = truth.columns("position")
    assert np.abs(q[0] - [0.6, -1.5, 0.5]).max() < 1e-9
    assert np.abs(q[-1] - [0.65, -1.5, 0.7]).max() < 5e-3
    (bag,) = (folder / "out/bags").glob("*_own")
    recording = recording_of(read_bag(bag, RECORDING_TOPICS), robot)
    assert len(recording) == len(truth.rows)
    step = [2.0 * np.pi / 2**20, 2.0 * np.pi / 2**20, 1.0 / 2**20]
    assert np.all(np.abs(recording.q - q).max(axis=0) < 6.0 * np.array(step))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--tip", "2 0 -1", "--joints", "0.6 -1.5 0.5"], "--tip and --joints exclude each other"),
        (
            ["--mapping", "nowhere.yaml"],
            "--mapping: expected a file, found none at 'nowhere.yaml'",
        ),
        (["--dbc", "nowhere.dbc"], "--dbc: expected a file, found none at 'nowhere.dbc'"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_starts(
    crane: Path, options: list[str], expected: str
) -> None:
    done = run(crane.parent, "--rig", str(crane), *options)
    assert done.returncode == 2
    assert done.stderr == f"rig_run: {expected}\n"
    assert not (crane.parent / "out").exists()


def test_a_mapping_of_ones_own_is_taken_as_it_is(crane: Path) -> None:
    """Here one of another robot: it lacks the telescope, and the rig says so."""
    other = ROOT / "hydro_msgs_docs/can/xs031.mapping.yaml"
    shutil.copy(other, crane.parent / "mine.mapping.yaml")
    done = run(
        crane.parent, "--rig", str(crane), "--mapping", str(crane.parent / "mine.mapping.yaml")
    )
    assert done.returncode != 0
    assert "'extend' of the robot is missing" in done.stderr
    assert not (crane.parent / "out/bus").exists()
