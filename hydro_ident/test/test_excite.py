"""Designed experiments: inside the limits, informative, and the same every time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hydro_control.errors import ControlError
from hydro_control.motion.motion_limits import refuse_fast
from hydro_ident.commands.excite import main, run
from hydro_ident.design import experiment
from hydro_ident.design.experiment import (
    LIMITS,
    Design,
    design_excitation,
    design_validation,
    start_pose,
)
from hydro_ident.design.information import ForceInformation, Residual
from hydro_ident.design.limits import limit_ratios
from hydro_ident.design.poses import static_poses
from hydro_ident.design.prediction import predict
from hydro_ident.errors import IdentError
from hydro_ident.study.excitation import least_at_rest, repeated
from hydro_model.motion.paths import JointPath, load_path
from hydro_model.motion.paths_check import check_path
from hydro_model.motion.paths_joints import joint_motion
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import EffectSpec, Robot

pytestmark = pytest.mark.long

LISTED = (
    EffectSpec("coulomb_friction", "xs031", {"force": 2500.0}),
    EffectSpec("internal_leakage", "xs031", {"coefficient": 5e-13}),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "out"
    assert run(["--robot", "xs031", "--out", str(out)]) == 0
    return out


START = (0.8, -1.2)


@pytest.fixture(scope="module")
def listing(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Design:
    """A design of 30 s whose robot lists effects."""
    listing = replace(robot, effects=LISTED)
    return design_excitation(listing, np.array(START), 30.0, tmp_path_factory.mktemp("listing"))


def _path(file: Path) -> JointPath:
    path = load_path(file)
    assert isinstance(path, JointPath)
    return path


@pytest.mark.parametrize("name", ["excitation.yaml", "validation.yaml"])
def test_runs_stay_inside_every_limit(robot: Robot, folder: Path, name: str) -> None:
    path = _path(folder / name)
    check = check_path(
        robot, path, margin=LIMITS.margin, flow_limit=LIMITS.flow * 1.01, step_s=0.005
    )
    assert np.all(check.upper - check.lower > 0.4)
    # Between the samples that the design checked, too.
    motion = joint_motion(robot, path, np.arange(0.0, path.duration_s, 0.004))
    assert limit_ratios(robot, LIMITS, *motion).max() < 1.01


def test_the_run_is_about_as_long_as_asked(folder: Path) -> None:
    assert _path(folder / "excitation.yaml").duration_s == pytest.approx(64.0, rel=0.05)


@pytest.mark.parametrize("name", ["excitation.yaml", "validation.yaml"])
def test_runs_start_and_end_at_rest_in_the_first_corner(
    robot: Robot, folder: Path, name: str
) -> None:
    path = _path(folder / name)
    for time in (0.0, path.duration_s - 1e-9):
        q, qd, _ = path.sample(time)
        assert tip_position(robot, q) == pytest.approx([2.0, 0.0, -1.2], abs=1e-4)
        assert np.abs(qd).max() < 1e-6


def test_beats_the_parallelogram_of_equal_duration(robot: Robot, folder: Path) -> None:
    told = json.loads((folder / "predicted.json").read_text())
    motion = repeated(robot, "xs031/parallelogram", told["duration_s"])
    plain = predict(robot, motion, Residual(), 0.002)
    assert told["condition_number"] < plain.condition / 3.0
    assert told["condition_number_unit_columns"] < plain.condition_scaled
    gains = [
        p.std / entry["std"] for p, entry in zip(plain.parameters, told["parameters"], strict=True)
    ]
    assert [p.name for p in plain.parameters] == [e["name"] for e in told["parameters"]]
    assert np.exp(np.log(gains).mean()) > 3.0
    assert min(gains) > 1.0


def test_no_stay_in_poses_tells_first_moments_three_times_better(
    robot: Robot, folder: Path
) -> None:
    """The best that rest alone could do, with no way between the poses and nothing else asked."""
    told = json.loads((folder / "predicted.json").read_text())
    motion = repeated(robot, "xs031/parallelogram", told["duration_s"])
    plain = {p.name: p.std for p in predict(robot, motion, Residual(), 0.002).parameters}
    least = least_at_rest(robot, Residual(), told["duration_s"])
    assert set(least) == {f"{link}_link.{m}" for link in ("lift", "tilt") for m in ("mcx", "mcz")}
    for name, error in least.items():
        assert 1.5 < plain[name] / error < 3.0


def test_least_errors_at_rest_are_below_those_of_any_choice_of_poses(robot: Robot) -> None:
    information = ForceInformation(robot, Residual())
    least = least_at_rest(robot, Residual(), 64.0)
    names = list(information.model.base.names)
    columns = [names.index(name) for name in least]
    rng = np.random.default_rng(1)
    for count in (6, 12, 40):
        poses = static_poses(information, LIMITS, count, int(rng.integers(1000)))
        still = np.zeros_like(poses)
        x = information.columns(poses, still, still)[..., columns]
        each = 64.0 / (2.0 * Residual().correlation_s * count)
        covariance = np.linalg.inv(each * np.einsum("tkp,tkq->pq", x, x))
        assert np.all(np.sqrt(np.diag(covariance)) > 0.99 * np.array(list(least.values())))


def test_validation_is_a_different_motion(folder: Path) -> None:
    times = np.linspace(5.0, 30.0, 400)
    one, two = (
        _path(folder / name).sample_many(times)[0]
        for name in ("excitation.yaml", "validation.yaml")
    )
    for joint in range(2):
        assert abs(np.corrcoef(one[:, joint], two[:, joint])[0, 1]) < 0.7


@pytest.mark.thorough
def test_a_start_of_ones_own_and_the_same_design_every_time(
    listing: Design, tmp_path: Path
) -> None:
    arguments = ["--robot", "xs031", "--duration", "30", "--start-joints", *map(str, START)]
    assert run([*arguments, "--out", str(tmp_path / "out")]) == 0
    path = _path(tmp_path / "out" / "excitation.yaml")
    for time in (0.0, path.duration_s):
        assert path.sample(time)[0] == pytest.approx(START, abs=1e-6)
    # Listed effects are predicted, and change nothing of the motion.
    assert listing.content == yaml.safe_load((tmp_path / "out" / "excitation.yaml").read_text())
    assert len(listing.prediction.parameters) == 18 + 4


def test_listed_effects_are_predicted_beside_the_rest(robot: Robot, folder: Path) -> None:
    path = _path(folder / "excitation.yaml")
    motion = joint_motion(robot, path, np.arange(0.0, path.duration_s, 0.002))
    prediction = predict(replace(robot, effects=LISTED), motion, Residual(), 0.002)
    plain = json.loads((folder / "predicted.json").read_text())["parameters"]
    told = {p.name: p.std for p in prediction.parameters}
    assert set(told) - {entry["name"] for entry in plain} == {
        f"{cylinder}.{name}"
        for cylinder in ("lift_cylinder", "tilt_cylinder")
        for name in ("coulomb_friction.force", "internal_leakage.coefficient")
    }
    # More unknowns, and nothing is told better for it. Pressures under leaks are others, and with
    # them what a motion tells of edges.
    others = [entry for entry in plain if not entry["name"].rpartition(".")[2].startswith("c_")]
    assert len(others) > 8
    assert all(told[entry["name"]] > 0.99 * entry["std"] for entry in others)
    for cylinder in ("lift_cylinder", "tilt_cylinder"):
        name = f"{cylinder}.viscous_friction"
        before = next(entry["std"] for entry in plain if entry["name"] == name)
        assert told[name] > 1.2 * before


def test_an_axis_without_hydraulics(tmp_path: Path) -> None:
    arguments = ["--robot", "emps", "--duration", "30", "--out", str(tmp_path / "out")]
    assert run(arguments) == 0
    told = json.loads((tmp_path / "out" / "predicted.json").read_text())
    assert [(entry["name"], entry["unit"]) for entry in told["parameters"]] == [
        ("carriage_link.mass", "kg"),
        ("carriage.viscous_friction", "N s/m"),
        ("carriage.coulomb_friction.force", "N"),
        ("carriage.constant_force_offset.force", "N"),
    ]
    assert all(entry["identifiable"] for entry in told["parameters"])


def test_start_poses(robot: Robot) -> None:
    for tip in ([2.6, 0.0, 0.1], [2.0, 0.0, -1.2]):
        assert tip_position(robot, start_pose(robot, np.array(tip))) == pytest.approx(tip)
    assert tip_position(robot, start_pose(robot)) == pytest.approx([2.0, 0.0, -1.2])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--start-joints", "0.8"], "expected 2 joint positions, found 1"),
        (["--start-tip", "9", "0", "0"], "cannot put its tip at"),
        (["--duration", "5"], "expected a duration of 30 s or more, found 5"),
        (
            ["--start-joints", "1.69", "-1.2"],
            "no motion fits the limits of robot xs031: at",
        ),
        (
            ["--start-joints", "9", "9"],
            "at the start joint 'lift': expected 0 to 1.65 rad (its limits less 0.05), found 9;"
            " try the middle, --start-joints 0.825 -1.27",
        ),
        (["--start-joints", "1.2", "-0.2"], "at the start piston of 'tilt_cylinder': expected 0."),
    ],
)
def test_what_cannot_be_done_is_one_line_and_writes_nothing(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr("sys.argv", ["excite", "--robot", "xs031", "--out", str(out), *arguments])
    assert main() == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("option", ["--force-residual", "--flow-residual", "--correlation"])
def test_residuals_are_checked(option: str, tmp_path: Path) -> None:
    with pytest.raises(IdentError, match=f"expected {option} above 0, found 0"):
        run(["--robot", "xs031", "--out", str(tmp_path), option, "0"])


@pytest.mark.thorough
def test_a_weak_valve_slows_the_motion(robot: Robot, folder: Path, tmp_path: Path) -> None:
    weak = replace(
        robot,
        valves=tuple(
            replace(v, c_pa=0.6 * v.c_pa, c_at=0.6 * v.c_at, c_pb=0.6 * v.c_pb, c_bt=0.6 * v.c_bt)
            for v in robot.valves
        ),
    )
    small = design_excitation(weak, start_pose(robot), 30.0, tmp_path)
    full = check_path(robot, _path(folder / "excitation.yaml"))
    assert np.all(small.check.peak_piston_velocity_m_s < full.peak_piston_velocity_m_s)
    assert np.all(small.check.flow_share <= LIMITS.flow)


@pytest.mark.thorough
def test_a_path_that_peaks_between_samples_is_made_to_less(
    robot: Robot, listing: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crane of three joints was refused: its chirps came 3 % over what they had been made to."""
    before = listing.check.flow_share.max()
    allowed = float(before / LIMITS.flow) - 0.01
    monkeypatch.setattr(experiment, "_BETWEEN", allowed)
    after = design_excitation(robot, np.array(START), 30.0, tmp_path).check.flow_share.max()
    assert 0.9 * before < after <= allowed * LIMITS.flow


def test_a_joint_without_cylinder_needs_an_effort_limit(robot: Robot, tmp_path: Path) -> None:
    """Exporters write effort="0", which is no limit: nothing says how hard it may be driven."""
    lift, tilt = robot.joints
    mixed = replace(
        robot,
        joints=(lift, replace(tilt, effort_limit=np.inf)),
        cylinders=robot.cylinders[:1],
        valves=robot.valves[:1],
    )
    with pytest.raises(IdentError, match=r"effort above 0 in the URDF's <limit>.* of tilt$"):
        design_excitation(mixed, start_pose(mixed), 64.0, tmp_path)


def test_a_robot_that_cannot_carry_itself_has_no_experiment(robot: Robot, tmp_path: Path) -> None:
    starved = replace(robot, supply_pressure_pa=4.0e6)
    with pytest.raises(IdentError, match="no motion fits"):
        design_excitation(starved, start_pose(robot), 64.0, tmp_path)


def test_the_tip_keeps_to_what_the_controller_lets_through(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A path on which it is faster is refused there, and slowed it would be another motion."""
    path = design_validation(robot, np.array(START), 32.0, tmp_path).path
    usual = fastest_tip(robot, path)
    monkeypatch.setattr(
        "hydro_ident.design.experiment.LIMITS", replace(LIMITS, tip_speed_m_s=0.5 * usual)
    )
    slow = design_validation(robot, np.array(START), 32.0, tmp_path).path
    assert 0.2 * usual < fastest_tip(robot, slow) <= 0.5 * usual
    refuse_fast(robot, slow, 0.5 * usual)
    with pytest.raises(ControlError, match="the tip reaches"):
        refuse_fast(robot, path, 0.5 * usual)


def fastest_tip(robot: Robot, path: JointPath) -> float:
    """By differences of positions."""
    times = np.arange(0.0, path.duration_s, 0.005)
    places = tip_position(robot, joint_motion(robot, path, times)[0])
    return float(np.linalg.norm(np.gradient(places, times, axis=0), axis=1).max())
