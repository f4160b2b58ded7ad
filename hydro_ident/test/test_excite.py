"""Designed experiments: inside the limits, informative, and the same every time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hydro_ident.commands.excite import main, run
from hydro_ident.errors import IdentError
from hydro_ident.experiment import (
    FLOW_LIMIT,
    MARGIN,
    condition_number,
    design_excitation,
    start_pose,
)
from hydro_model.kinematics import tip_position
from hydro_model.paths import JointPath, load_path
from hydro_model.paths_check import check_path
from hydro_model.robot import Robot


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "out"
    assert run(["--robot", "xs031", "--out", str(out)]) == 0
    return out


def _path(file: Path) -> JointPath:
    path = load_path(file)
    assert isinstance(path, JointPath)
    return path


@pytest.mark.parametrize("name", ["excitation.yaml", "validation.yaml"])
def test_runs_stay_inside_every_limit(robot: Robot, folder: Path, name: str) -> None:
    check = check_path(
        robot, _path(folder / name), margin=MARGIN, flow_limit=FLOW_LIMIT, step_s=0.005
    )
    assert np.all(check.upper - check.lower > 0.4)


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


def test_the_excitation_is_better_conditioned_than_a_slow_sine(
    robot: Robot, folder: Path, tmp_path: Path
) -> None:
    slow = tmp_path / "slow.yaml"
    slow.write_text(
        "joints: [lift, tilt]\nstart: [0.825, -1.275]\nsegments:\n"
        "  - {kind: fourier, duration_s: 60.0, fundamental_hz: 0.05, ramp_s: 5.0,"
        " sine: [[0.4], [0.5]]}\n"
    )
    condition = condition_number(robot, _path(folder / "excitation.yaml"))
    assert condition < 8.0
    assert condition < 0.75 * condition_number(robot, _path(slow))


def test_validation_is_a_different_motion(folder: Path) -> None:
    times = np.linspace(5.0, 30.0, 400)
    one, two = (
        _path(folder / name).sample_many(times)[0]
        for name in ("excitation.yaml", "validation.yaml")
    )
    for joint in range(2):
        assert abs(np.corrcoef(one[:, joint], two[:, joint])[0, 1]) < 0.7


def test_the_design_is_the_same_every_time(folder: Path, tmp_path: Path) -> None:
    assert run(["--robot", "xs031", "--out", str(tmp_path)]) == 0
    for name in ("excitation.yaml", "validation.yaml"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_a_start_of_ones_own(robot: Robot, tmp_path: Path) -> None:
    arguments = ["--robot", "xs031", "--out", str(tmp_path), "--duration", "40"]
    assert run([*arguments, "--start-joints", "0.8", "-1.2"]) == 0
    assert _path(tmp_path / "excitation.yaml").sample(0.0)[0] == pytest.approx([0.8, -1.2])
    assert run([*arguments, "--start-tip", "2.6", "0", "0.1"]) == 0
    q = _path(tmp_path / "excitation.yaml").sample(0.0)[0]
    assert tip_position(robot, q) == pytest.approx([2.6, 0.0, 0.1], abs=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--start-joints", "0.8"], "expected 2 joint positions, found 1"),
        (["--start-tip", "9", "0", "0"], "cannot put its tip at"),
        (["--duration", "5"], "expected a duration of 30 s or more, found 5"),
        (["--start-joints", "1.69", "-1.2"], "no motion fits the limits of robot xs031"),
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


def test_a_weak_valve_shrinks_the_motion(robot: Robot, tmp_path: Path) -> None:
    weak = replace(
        robot,
        valves=tuple(
            replace(v, c_pa=0.6 * v.c_pa, c_at=0.6 * v.c_at, c_pb=0.6 * v.c_pb, c_bt=0.6 * v.c_bt)
            for v in robot.valves
        ),
    )
    start = start_pose(robot)
    full = design_excitation(robot, start, 64.0, tmp_path)
    small = design_excitation(weak, start, 64.0, tmp_path)
    assert small.scale < full.scale
    assert np.all(small.check.flow_share <= FLOW_LIMIT)


def test_a_robot_that_cannot_carry_itself_has_no_experiment(robot: Robot, tmp_path: Path) -> None:
    starved = replace(robot, supply_pressure_pa=4.0e6)
    with pytest.raises(IdentError, match="no motion fits"):
        design_excitation(starved, start_pose(robot), 64.0, tmp_path)
