"""A robot without cylinders whose joint torques are measured: pinocchio is the machine."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import Recording
from hydro_ident.commands.diagnose import run as diagnose_command
from hydro_ident.identify.results import Provenance
from hydro_ident.mismatch.answer.diagnosis import diagnose
from hydro_ident.mismatch.answer.diagnosis_file import result_dict
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.long

pin = pytest.importorskip("pinocchio")

JOINTS = ("shoulder", "elbow")
STEP_S, TORQUE_NOISE, COUNT_RAD = 0.002, (0.2, 0.1), 2.0 * np.pi / 2**19
ROTOR, COULOMB, SHARE, GAP, FLANK = 0.4, 6.0, 0.12, 0.008, 2.0
VISCOUS = (4.0, 2.5)

_LINK = """
  <link name="{name}"><inertial><origin xyz="{x} 0 {z}"/><mass value="{m}"/>
    <inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
_JOINT = """
  <joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{x} 0 0"/><axis xyz="0 -1 0"/><dynamics damping="{damping}"/>
    <limit lower="-3" upper="3" effort="200" velocity="5"/></joint>
"""
_ROBOT = """
robot: arm
urdf: arm.urdf
tip_link: tip_link
sensors: {rate_hz: 500, encoder: {counts_per_rev: 524288}}
"""


def _urdf(scale: float, damping: tuple[float, float]) -> str:
    """The arm of the datasheet; its bodies scaled."""
    return (
        '<robot name="arm"><link name="base_link"/>'
        + _JOINT.format(
            name="shoulder", parent="base_link", child="upper", x=0.0, damping=damping[0]
        )
        + _LINK.format(name="upper", x=0.3, z=0.02 * scale, m=9.0 * scale, i=0.5 * scale)
        + _JOINT.format(name="elbow", parent="upper", child="fore", x=0.6, damping=damping[1])
        + _LINK.format(name="fore", x=0.25, z=-0.01, m=6.0 / scale, i=0.25 * scale)
        + '<joint name="end" type="fixed"><parent link="fore"/><child link="tip_link"/>'
        '<origin xyz="0.5 0 0"/></joint><link name="tip_link"/></robot>'
    )


@pytest.fixture(scope="module")
def robot_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(_urdf(1.0, (3.0, 3.0)))
    (folder / "arm.hydraulics.yaml").write_text(_ROBOT)
    return folder / "arm.hydraulics.yaml"


def _motion(seconds: float, seed: int, late_s: float = 0.0) -> tuple[np.ndarray, ...]:
    """Positions, velocities and accelerations of sums of sines, (N, 2) each, some time ago."""
    rng = np.random.default_rng(seed)
    time = STEP_S * np.arange(round(seconds / STEP_S)) - late_s
    omega = 2.0 * np.pi * np.array([0.11, 0.23, 0.41, 0.67, 1.03])
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, 5))
    size = rng.uniform(0.5, 1.0, (2, 5)) * np.array([0.5, 0.35, 0.2, 0.12, 0.08])
    angle = omega[:, None] * time + phase[..., None]
    waves = size[..., None] * np.stack(
        [np.sin(angle), omega[:, None] * np.cos(angle), -(omega[:, None] ** 2) * np.sin(angle)]
    )
    q, qd, qdd = waves.sum(axis=2).transpose(0, 2, 1)
    return q + np.array([0.4, -0.8]), qd, qdd


def _torque(
    q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, effects: tuple[str, ...]
) -> np.ndarray:
    """What the drives ask of the joints, (N, 2)."""
    model = pin.buildModelFromXML(_urdf(1.15, VISCOUS))
    data = model.createData()
    torque = np.array([pin.rnea(model, data, *row) for row in zip(q, qd, qdd, strict=True)])
    torque += np.array(VISCOUS) * qd
    if "rotor" in effects:
        torque[:, 1] += ROTOR * qdd[:, 1]
    if "coulomb" in effects:
        torque[:, 0] += COULOMB * qd[:, 0] / np.hypot(qd[:, 0], 2e-3)
    if "gear" in effects:
        # Of the drive's torque a share is lost: it needs to be that much larger, or smaller.
        loss = SHARE * np.sign(qd[:, 0]) * np.sign(torque[:, 0])
        torque[:, 0] /= 1.0 - loss
    return torque


def _seen(q: np.ndarray, torque: np.ndarray, effects: tuple[str, ...]) -> np.ndarray:
    """What encoders on the motors show: across a play they lead the link, (N, 2)."""
    seen = q.copy()
    if "play" in effects:
        # Flanks give evenly until they bear.
        seen[:, 1] += 0.5 * GAP * np.clip(torque[:, 1] / FLANK, -1.0, 1.0)
    return COUNT_RAD * np.round(seen / COUNT_RAD)


def _recorded(late_s: float, effects: tuple[str, ...]) -> dict[str, tuple[np.ndarray, ...]]:
    """Positions and torques of the two recordings of the arm with some effects, by their names."""
    recorded: dict[str, tuple[np.ndarray, ...]] = {}
    for name, seconds, seed in (("train", 25.0, 1), ("check", 24.0, 2)):
        q, qd, qdd = _motion(seconds, seed)
        rng = np.random.default_rng(10 + seed)
        torque = _torque(q, qd, qdd, effects)
        seen = _seen(q, torque, effects)
        if late_s:
            torque = _torque(*_motion(seconds, seed, late_s), effects)
        recorded[name] = (seen, torque + rng.normal(size=q.shape) * TORQUE_NOISE)
    return recorded


def _recording(robot: Robot, name: str, q: np.ndarray, effort: np.ndarray) -> Recording:
    """A recording of positions and torques, and of nothing else."""
    step_ns = round(1e9 * STEP_S)
    absent = (
        "stroke p_a p_b supply tank valve_v command_v spool q_ref qd_ref force_ref tip_ref"
        " temperature_stamp_ns temperature_c"
    )
    left_out: dict[str, Any] = dict.fromkeys(absent.split())
    return Recording(
        path=Path(name), robot=robot, period_s=STEP_S, q=q, effort=effort,
        stamp_ns=10**18 + step_ns * np.arange(len(q)), valve_source="",
        latched=np.zeros(len(q), dtype=bool), losses=(), gaps=(), duplicates={}, notes=(),
        metadata={}, **left_out,
    )  # fmt: skip


@pytest.fixture
def diagnosed(robot_file: Path) -> Callable[..., dict[str, Any]]:
    """What is told of the arm with some effects, by two recordings of it."""

    def run(*effects: str, late_s: float = 0.0) -> dict[str, Any]:
        robot = load_robot(robot_file)
        recorded = _recorded(late_s, effects)
        train, check = (_recording(robot, name, *recorded[name]) for name in ("train", "check"))
        found = diagnose(robot, [train], [check])
        told: dict[str, Any] = result_dict(found, Provenance("diagnose", "1", "arm", {}, {}))
        return told

    return run


@pytest.fixture
def diagnosed_bags(
    robot_file: Path, write_bag: Callable[..., Path], tmp_path: Path
) -> Callable[..., dict[str, Any]]:
    """As `diagnosed`, by the command and two bags."""

    def run(*effects: str) -> dict[str, Any]:
        bags = []
        for name, (q, effort) in _recorded(0.0, effects).items():
            columns = {"/joint_states": (JOINTS, {"position": q, "effort": effort})}
            bags.append(str(write_bag(columns, name=name)))
        out = tmp_path / "out"
        arguments = [bags[0], "--robot", str(robot_file), "--validate", bags[1], "--out", str(out)]
        assert diagnose_command(arguments) == 0
        found: dict[str, Any] = json.loads((out / "result.json").read_text())
        return found

    return run


@pytest.mark.thorough
@pytest.mark.parametrize("late_s", [-1.6e-3, 4.0e-3])
def test_torques_that_are_read_early_or_late_are_no_physics(
    diagnosed: Callable[..., dict[str, Any]], late_s: float
) -> None:
    """A command that is held over its cycle, or currents two cycles old."""
    found = diagnosed("coulomb", late_s=late_s)
    assert _named(found) == {
        ("shoulder/torque", "coulomb_friction"): pytest.approx(COULOMB, rel=0.02)
    }
    when = "before" if late_s < 0.0 else "after"
    [note] = [n for n in found["notes"] if n.startswith("the torques are read")]
    read_ms = float(re.findall(rf"read (\S+) \+- \S+ ms {when} positions", note)[0])
    assert read_ms == pytest.approx(1e3 * abs(late_s), abs=0.1)


def _named(found: dict[str, Any]) -> dict[tuple[str, str], float]:
    """Size of every finding that one name stands for, by channel and name."""
    assert all(len(f["names"]) == 1 for f in found["findings"])
    return {(f["channel"], f["names"][0]): f["parameters"][0]["value"] for f in found["findings"]}


def test_an_arm_that_is_its_description_matches(diagnosed: Callable[..., dict[str, Any]]) -> None:
    """Bodies and viscous friction off the file are no finding; what is left is sensor noise."""
    found = diagnosed()
    assert (found["verdict"], found["findings"], found["unexplained"]) == ("matches", [], [])
    assert set(found["channels"]) == {"shoulder/torque", "elbow/torque"}
    for channel in found["channels"].values():
        assert channel["rmse_before"] == pytest.approx(channel["noise_floor"], rel=0.15)


@pytest.mark.thorough
def test_a_rotor_and_dry_friction_are_found(
    diagnosed_bags: Callable[..., dict[str, Any]],
) -> None:
    """By the command, from bags: the others leave both out."""
    found = diagnosed_bags("rotor", "coulomb")
    assert found["verdict"] == "explained"
    assert _named(found) == {
        ("elbow/torque", "rotor_inertia"): pytest.approx(ROTOR, rel=0.05),
        ("shoulder/torque", "coulomb_friction"): pytest.approx(COULOMB, rel=0.05),
    }
    units = {p["name"]: p["unit"] for f in found["findings"] for p in f["parameters"]}
    assert units["coulomb_friction.force"] == "N m"
    assert units["coulomb_friction.velocity_scale"] == "rad/s"
    assert units["rotor_inertia.inertia"] == "kg m^2"
    where = {f["names"][0]: f["where"] for f in found["findings"]}["coulomb_friction"]
    assert where["variable"] == "piston_velocity"
    assert re.search(r"at a joint velocity of \S+ to \S+ rad/s$", where["text"])
    for channel in found["channels"].values():
        assert channel["rmse_after"] == pytest.approx(channel["noise_floor"], rel=0.3)


@pytest.mark.thorough
def test_a_gear_that_rubs_under_load_is_found(diagnosed: Callable[..., dict[str, Any]]) -> None:
    found = diagnosed("gear")
    assert _named(found) == {
        ("shoulder/torque", "load_dependent_friction"): pytest.approx(SHARE, rel=0.05)
    }


@pytest.mark.thorough
def test_a_gear_with_play_is_found(diagnosed: Callable[..., dict[str, Any]]) -> None:
    found = diagnosed("play")
    assert _named(found) == {("elbow/torque", "backlash"): pytest.approx(GAP, rel=0.15)}
    assert found["verdict"] == "explained"
