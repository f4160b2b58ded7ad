"""Joints without limits, and URDFs without velocity or effort: identified, written and told."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml

from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.streaming import stream_recordings
from hydro_ident.bag.turns import without_turns
from hydro_ident.commands.identify import run
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

STEP_S = 0.002

_ARM = """<robot name="arm"><link name="base_link"/>
  <joint name="slew" type="continuous"><parent link="base_link"/><child link="pillar"/>
    <axis xyz="0 0 1"/></joint>
  <link name="pillar"><inertial><origin xyz="0.1 0 0.2"/><mass value="9"/>
    <inertia ixx="0.5" iyy="0.5" izz="0.7" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="boom" type="revolute"><parent link="pillar"/><child link="fore"/>
    <origin xyz="0.2 0 0.4"/><axis xyz="0 -1 0"/>
    <limit lower="-1.5" upper="1.5" effort="200" velocity="0"/></joint>
  <link name="fore"><inertial><origin xyz="0.3 0 0.02"/><mass value="6"/>
    <inertia ixx="0.1" iyy="0.3" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="end" type="fixed"><parent link="fore"/><child link="tip_link"/>
    <origin xyz="0.6 0 0"/></joint>
  <link name="tip_link"/></robot>
"""
_FILE = """
robot: arm
urdf: arm.urdf
tip_link: tip_link
sensors: {rate_hz: 500, encoder: {counts_per_rev: 524288}}
"""
FRICTION = np.array([4.0, 2.5])


def _arm_run(robot: Robot) -> dict[str, tuple[tuple[str, ...], dict[str, np.ndarray]]]:
    """The arm slews on and on while its boom swings; torques with noise."""
    time = STEP_S * np.arange(round(20.0 / STEP_S))[:, None]
    omega, size = (
        2 * np.pi * np.array([[0.2, 0.3], [0.9, 1.1]]),
        np.array([[1.5, 0.5], [0.2, 0.1]]),
    )
    turn = [omega[k] * time for k in (0, 1)]
    q = sum(size[k] * np.sin(turn[k]) for k in (0, 1)) + time * [0.6, 0.0]
    qd = sum(size[k] * omega[k] * np.cos(turn[k]) for k in (0, 1)) + np.array([0.6, 0.0])
    qdd = -sum(size[k] * omega[k] ** 2 * np.sin(turn[k]) for k in (0, 1))
    torque = np.asarray(inverse_dynamics(robot, q, qd, qdd)) + FRICTION * qd
    torque += np.random.default_rng(1).normal(size=q.shape) * [0.2, 0.1]
    count = 2.0 * np.pi / 2**19
    position = count * np.round(q / count)
    return {"/joint_states": (robot.joint_names, {"position": position, "effort": torque})}


def _within_a_turn(angles: np.ndarray) -> np.ndarray:
    return np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi


@pytest.mark.needs("clarabel", "plotly")
def test_an_endless_joint_that_is_read_within_a_turn_runs_on(
    write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    (tmp_path / "arm.urdf").write_text(_ARM)
    file = tmp_path / "arm.hydraulics.yaml"
    file.write_text(_FILE)
    robot = load_robot(str(file))
    columns = _arm_run(robot)
    names, fields = columns["/joint_states"]
    angles = fields["position"].copy()
    fields["position"] = _within_a_turn(angles)
    # The reference is a degree ahead, and passes the end of the turn before the joint.
    reference = {"/joint_reference": (names, {"position": _within_a_turn(angles + 0.017)})}
    # A piece knows what stands in the file before its cycles.
    bag, out = write_bag(reference | columns), tmp_path / "out"
    whole = read_recording(bag, robot)
    np.testing.assert_allclose(whole.q, angles, atol=1e-9)
    assert whole.q_ref is not None
    np.testing.assert_allclose(whole.q_ref - whole.q, 0.017, atol=1e-9)
    [note] = [n for n in whole.notes if "within a turn" in n]
    assert note == f"slew was recorded within a turn: {len(whole.turns['slew'])} leaps by 2 pi" + (
        " taken out"
    )
    for piece in stream_recordings(bag, robot, piece_s=3.0, overlap_s=0.5):
        rows = np.searchsorted(whole.stamp_ns, piece.recording.stamp_ns)
        np.testing.assert_array_equal(piece.recording.q, whole.q[rows])
        np.testing.assert_array_equal(piece.recording.q_ref, whole.q_ref[rows])
    assert note in piece.recording.notes
    assert run([str(bag), "--robot", str(file), "--out", str(out)]) == 0
    result = json.loads((out / "result.json").read_text())
    found = {p["name"]: p["value"] for p in result["parameters"]}
    for joint, truth in zip(("slew", "boom"), FRICTION, strict=True):
        assert found[f"{joint}.viscous_friction"] == pytest.approx(truth, rel=0.05)


def test_a_turn_that_nobody_saw_is_not_undone(robot: Robot) -> None:
    """Neither is a leap of a slide, or of half a turn."""
    lift, tilt = robot.joints
    stamps = 2_000_000 * np.arange(600)
    stamps[400:] += 1_000_000_000
    angles = 2.0 + 0.01 * np.arange(600)
    q = np.stack([_within_a_turn(angles), angles], axis=1)
    q[400:, 0] -= np.pi
    q[300:, 1] += 2.0 * np.pi
    slide = replace(robot, joints=(lift, replace(tilt, prismatic=True)))
    known, turns = without_turns(slide, stamps, q, {})
    assert list(turns) == ["lift"]
    assert turns["lift"].tolist() == [[int(stamps[115]), 1]]
    np.testing.assert_allclose(known[:400, 0], angles[:400], atol=1e-12)
    np.testing.assert_array_equal(known[:, 1], q[:, 1])
    # Across the hole it stays as read, by the turns before it.
    np.testing.assert_allclose(known[400:, 0], q[400:, 0] + 2.0 * np.pi)


@pytest.mark.needs("clarabel", "plotly")
def test_an_endless_joint_and_one_without_a_speed_are_identified(
    write_bag: Callable[..., Path], tmp_path: Path
) -> None:
    (tmp_path / "arm.urdf").write_text(_ARM)
    file = tmp_path / "arm.hydraulics.yaml"
    file.write_text(_FILE)
    bag, out = write_bag(_arm_run(load_robot(str(file)))), tmp_path / "out"
    assert run([str(bag), "--robot", str(file), "--out", str(out)]) == 0
    result = json.loads((out / "result.json").read_text())
    slew, boom = result["recordings"][0]["motion"]
    assert (slew["lower"], slew["upper"], slew["speed_limit"]) == (None, None, 0.0)
    assert (boom["lower"], boom["upper"], boom["speed_limit"]) == (-1.5, 1.5, 0.0)
    found = {p["name"]: p for p in result["parameters"]}
    for joint, truth in zip(("slew", "boom"), FRICTION, strict=True):
        assert found[f"{joint}.viscous_friction"]["identifiable"]
        assert found[f"{joint}.viscous_friction"]["value"] == pytest.approx(truth, rel=0.05)
    report = (out / "report.html").read_text()
    excited = report[report.index('<section id="excitation">') :]
    assert "<td>–</td><td>" in excited[: excited.index("</table>")]


@pytest.mark.needs("clarabel", "plotly")
def test_a_crane_without_a_rated_speed_is_identified(
    crane_run, write_bag: Callable[..., Path], tmp_path: Path, robot: Robot
) -> None:
    assert robot.source is not None
    assert robot.urdf is not None
    tree = ElementTree.parse(robot.urdf)
    for limit in tree.getroot().iter("limit"):
        limit.attrib |= {"velocity": "0", "effort": "0"}
    tree.write(tmp_path / "slow.urdf")
    data = yaml.safe_load(robot.source.read_text()) | {"robot": "slow", "urdf": "slow.urdf"}
    (tmp_path / "slow.hydraulics.yaml").write_text(yaml.safe_dump(data))
    bag, out = write_bag(crane_run.columns()), tmp_path / "out"
    file = str(tmp_path / "slow.hydraulics.yaml")
    assert run([str(bag), "--robot", file, "--out", str(out)]) == 0
    result = json.loads((out / "result.json").read_text())
    assert result["verdict"] == "identified", result["problems"]
    found = {p["name"]: p for p in result["parameters"]}
    assert found["tilt_cylinder.viscous_friction"]["value"] == pytest.approx(4.1e4, rel=0.05)


def test_zeros_of_an_endless_joints_torque_are_not_measured(
    write_bag: Callable[..., Path], run_columns: Callable[[int], dict], robot: Robot
) -> None:
    lift, tilt = robot.joints
    endless = replace(robot, joints=(lift, replace(tilt, lower=-np.inf, upper=np.inf)))
    names, fields = run_columns(1000)["/joint_states"]
    effort = 1e3 * fields["position"]
    effort[:, 1] = 0.0
    columns = {"/joint_states": (names, fields | {"effort": effort})}
    recording = read_recording(write_bag(columns), endless)
    lost = {loss.channel: loss.reason for loss in recording.losses}
    assert lost["tilt/torque"] == "effort of tilt reads 0 throughout while the robot moves"
    assert "lift/torque" not in lost
