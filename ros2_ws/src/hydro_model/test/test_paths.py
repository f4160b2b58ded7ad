"""Paths: boundary conditions, derivatives, files, and what a robot can follow."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro_model.errors import RobotError
from hydro_model.hydraulics.cylinder import stroke
from hydro_model.motion.paths import JointPath, TipPath, load_path, shipped_paths
from hydro_model.motion.paths_check import check_path
from hydro_model.motion.paths_joints import joint_motion, joints_at_tip
from hydro_model.motion.paths_segments import Quintic, smooth_step
from hydro_model.motion.row_pieces import ROWS, in_pieces
from hydro_model.multibody.kinematics import tip_position
from hydro_model.multibody.rigid_body import inverse_dynamics, potential_energy
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")

EVERY_KIND = """
joints: [lift, tilt]
start: [0.6, -1.5]
start_delay_s: 0.5
segments:
  - {kind: move, to: [0.7, -1.4], duration_s: 2.0}
  - {kind: hold, duration_s: 0.5}
  - {kind: cruise, to: [0.8, -1.4], duration_s: 3.0, ramp_s: 0.5}
  - {kind: staircase, levels: [[0.75, -1.4], [0.7, -1.45]], move_s: 1.0, hold_s: 0.25}
  - {kind: ladder, travel: [0.05, 0.1], speeds: [0.05, 0.1], ramp_s: 0.3, hold_s: 0.2}
  - {kind: fourier, duration_s: 10.0, fundamental_hz: 0.2, ramp_s: 2.0,
     sine: [[0.05, 0.01], [0.02, 0.03]], cosine: [[0.0, 0.02], [0.01, 0.0]]}
  - {kind: chirp, duration_s: 6.0, amplitude: [0.02, -0.03], from_hz: 0.2, to_hz: 2.0, ramp_s: 1.0}
"""


@pytest.fixture(scope="module")
def every_kind(tmp_path_factory: pytest.TempPathFactory) -> JointPath:
    file = tmp_path_factory.mktemp("paths") / "every.yaml"
    file.write_text(EVERY_KIND)
    path = load_path(file)
    assert isinstance(path, JointPath)
    return path


def test_smooth_step_has_flat_ends_and_unit_area() -> None:
    for end in (0.0, 1.0):
        assert smooth_step(end) == (end, 0.0, 0.0)
    s = np.linspace(0.0, 1.0, 1001)
    assert np.trapezoid([smooth_step(x)[1] for x in s], s) == pytest.approx(1.0, abs=1e-5)


finite = st.floats(-3.0, 3.0)


@given(st.lists(finite, min_size=6, max_size=6), st.floats(0.2, 20.0))
@settings(max_examples=50, deadline=None)
def test_quintic_meets_both_ends(values: list[float], duration: float) -> None:
    p0, v0, a0, p1, v1, a1 = np.array(values).reshape(6, 1)
    quintic = Quintic.between((p0, v0, a0), (p1, v1, a1), duration)
    for t, ends in ((0.0, (p0, v0, a0)), (duration, (p1, v1, a1))):
        for found, expected in zip(quintic.sample(t), ends, strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-6)


def test_rest_to_rest_is_the_minimum_jerk_polynomial() -> None:
    quintic = Quintic.at_rest([1.0], [3.0], 4.0)
    position, velocity, _ = quintic.sample(2.0)
    assert position[0] == pytest.approx(2.0, rel=1e-6)
    assert velocity[0] == pytest.approx(1.875 * 2.0 / 4.0)


def test_every_segment_is_at_rest_at_its_ends_and_continuous(every_kind: JointPath) -> None:
    assert np.all(every_kind.sample(0.0)[0] == [0.6, -1.5])
    for at in every_kind.breaks_s:
        for before, after in zip(
            every_kind.sample(at - 1e-9), every_kind.sample(at + 1e-9), strict=True
        ):
            np.testing.assert_allclose(before, after, atol=1e-6)
        np.testing.assert_allclose(every_kind.sample(at)[1], 0.0, atol=1e-9)
        np.testing.assert_allclose(every_kind.sample(at)[2], 0.0, atol=1e-8)


def test_velocity_and_acceleration_are_the_derivatives(every_kind: JointPath) -> None:
    step = 1e-4
    times = np.linspace(0.05, every_kind.duration_s - 0.05, 1777)
    before, after = every_kind.sample_many(times - step), every_kind.sample_many(times + step)
    _, velocity, acceleration = every_kind.sample_many(times)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * step), velocity, atol=2e-5)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * step), acceleration, atol=2e-3)


def test_many_times_are_sampled_as_one_is(every_kind: JointPath) -> None:
    """At joins, on flanks and between, before and after; to the last digits."""
    inside = np.linspace(-0.1, every_kind.duration_s + 0.1, 1234)
    times = np.concatenate([inside, every_kind.breaks_s])
    together = every_kind.sample_many(times)
    alone = zip(*(every_kind.sample(float(t)) for t in times), strict=True)
    for many, rows in zip(together, alone, strict=True):
        np.testing.assert_allclose(many, np.array(rows), rtol=1e-12, atol=1e-12)


def test_outside_its_time_a_path_rests_at_its_ends(every_kind: JointPath) -> None:
    start, end = every_kind.sample(-5.0), every_kind.sample(1e6)
    np.testing.assert_array_equal(start[0], [0.6, -1.5])
    np.testing.assert_allclose(end[0], every_kind.sample(every_kind.duration_s - 1e-9)[0])
    assert not np.any([start[1:], end[1:]])


def test_a_ladder_reaches_each_speed_and_returns(tmp_path: FilePath) -> None:
    file = tmp_path / "ladder.yaml"
    file.write_text(
        "joints: [lift]\nstart: [0.5]\nsegments:\n"
        "  - {kind: ladder, travel: [-0.4], speeds: [0.05, 0.2], ramp_s: 0.5, hold_s: 0.1}\n"
    )
    path = load_path(file)
    _, velocity, _ = path.sample_many(np.arange(0.0, path.duration_s, 0.001))
    assert set(np.unique(np.round(np.abs(velocity), 6))) >= {0.05, 0.2}
    assert np.abs(velocity).max() == pytest.approx(0.2)
    np.testing.assert_allclose(path.sample(path.duration_s)[0], [0.5])


def test_the_shipped_parallelogram_is_the_papers() -> None:
    assert list(shipped_paths()) == ["xs031/parallelogram"]
    path = load_path("xs031/parallelogram")
    assert isinstance(path, TipPath)
    assert path.duration_s == pytest.approx(16.8)
    position, velocity, _ = path.sample_many(np.arange(0.0, 16.8, 0.002))
    assert np.linalg.norm(velocity, axis=1).max() == pytest.approx(0.716, abs=1e-3)
    np.testing.assert_allclose(position[0], [2.0, 0.0, -1.2])
    check = check_path(ROBOT, path, margin=0.2, flow_limit=0.8)
    # Corners as the inverse kinematics found them lie where the path says.
    np.testing.assert_allclose(tip_position(ROBOT, check.start_position), position[0], atol=1e-6)


def test_joint_motion_follows_the_tip_with_its_derivatives() -> None:
    path = load_path("xs031/parallelogram")
    times = np.arange(0.0, 3.0, 0.01)
    q, qd, qdd = joint_motion(ROBOT, path, times)
    np.testing.assert_allclose(tip_position(ROBOT, q), path.sample_many(times)[0], atol=1e-6)
    np.testing.assert_allclose(np.gradient(q, times, axis=0)[2:-2], qd[2:-2], atol=2e-4)
    np.testing.assert_allclose(np.gradient(qd, times, axis=0)[2:-2], qdd[2:-2], atol=2e-3)


def test_inverse_kinematics_stays_inside_the_limits_and_says_what_is_out_of_reach() -> None:
    q = joints_at_tip(ROBOT, np.array([3.0, 0.0, -0.5]))
    for joint, value in zip(ROBOT.joints, q, strict=True):
        assert joint.lower <= value <= joint.upper
    with pytest.raises(RobotError, match=r"cannot put its tip at \[9.000, .* missed by 5\."):
        joints_at_tip(ROBOT, np.array([9.0, 0.0, 0.0]))
    with pytest.raises(RobotError, match="cannot put its tip"):
        joints_at_tip(ROBOT, np.array([3.0, 0.5, 0.0]))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{kind: move, to: [1.8, -1.5], duration_s: 5.0}", "joint 'lift' goes to 1.8 at 5.00 s"),
        ("{kind: move, to: [0.6, -2.5], duration_s: 5.0}", "expected at least -2.4"),
        ("{kind: move, to: [1.6, -1.5], duration_s: 0.5}", "'lift' reaches a speed of 3.7"),
    ],
)
def test_check_names_what_is_exceeded(tmp_path: FilePath, text: str, expected: str) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(f"joints: [lift, tilt]\nstart: [0.6, -1.5]\nsegments: [{text}]\n")
    with pytest.raises(RobotError, match=expected):
        check_path(ROBOT, load_path(file))


def test_what_is_no_number_is_not_within_a_limit(tmp_path: FilePath) -> None:
    """Of a start that was never measured: the other joint stays there."""
    file = tmp_path / "p.yaml"
    file.write_text("joints: [tilt]\nstart: [-1.5]\nsegments: [{kind: hold, duration_s: 1.0}]\n")
    with pytest.raises(RobotError, match="expected a motion of finite numbers"):
        check_path(ROBOT, load_path(file), near=np.array([np.nan, -1.5]))
    assert check_path(replace(ROBOT, valves=()), load_path(file)).flow_share.tolist() == [0.0, 0.0]


def test_check_knows_what_the_valves_can_pass(tmp_path: FilePath) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(
        "joints: [tilt]\nstart: [-2.0]\n"
        "segments: [{kind: cruise, to: [-0.6], duration_s: 1.5, ramp_s: 0.3}]\n"
    )
    path = load_path(file)
    share = check_path(ROBOT, path, near=np.array([0.6, -2.0])).flow_share
    assert share[0] == 0.0
    assert 0.2 < share[1] < 1.5
    with pytest.raises(RobotError, match="'tilt_cylinder' needs a share of its valve's flow"):
        check_path(ROBOT, path, near=np.array([0.6, -2.0]), flow_limit=0.2)


def _held_share(robot: Robot, q: list[float]) -> float:
    """Of what the lift cylinder can hold, by the slope of the potential energy over its stroke."""
    cylinder, step = robot.cylinders[0], 1e-5
    ends = [np.array([q[0] + d, q[1]]) for d in (-step, step)]
    energy = np.diff([potential_energy(robot, at) for at in ends])
    force = float(energy.item() / np.diff([stroke(cylinder, at[0]) for at in ends]).item())
    p_s, p_t = robot.supply_pressure_pa, robot.tank_pressure_pa
    area_a, area_b = cylinder.area_a_m2, cylinder.area_b_m2
    can = p_s * area_a - p_t * area_b if force >= 0.0 else p_s * area_b - p_t * area_a
    return abs(force) / can


def test_a_pose_that_a_cylinder_cannot_hold_is_refused_and_left(tmp_path: FilePath) -> None:
    weak, light, heavy = replace(ROBOT, tank_pressure_pa=0.0), [1.45, -0.15], [1.45, -1.2]
    # Half of what the heavy pose asks for, and more than the light one does.
    pressure = 0.5 * ROBOT.supply_pressure_pa * _held_share(weak, heavy)
    weak = replace(weak, supply_pressure_pa=pressure)
    assert _held_share(weak, heavy) == pytest.approx(2.0, rel=1e-6)
    assert _held_share(weak, light) < 0.9
    file = tmp_path / "p.yaml"
    for start, end in ((light, heavy), (heavy, light)):
        file.write_text(
            f"joints: [lift, tilt]\nstart: {start}\n"
            f"segments: [{{kind: move, to: {end}, duration_s: 60.0}}]\n"
        )
        path = load_path(file)
        check_path(ROBOT, path)
        if start is heavy:
            check_path(weak, path)
            continue
        with pytest.raises(RobotError, match=r"'lift_cylinder' would have to hold, .* 2 at 60.00"):
            check_path(weak, path)


def test_a_path_of_other_joints_or_another_tip_is_refused(tmp_path: FilePath) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("joints: [boom]\nstart: [0]\nsegments: [{kind: hold, duration_s: 1}]\n")
    with pytest.raises(RobotError, match="no joint 'boom'"):
        check_path(ROBOT, load_path(file))
    other = TipPath.through([[2, 0, -1], [3, 0, -1]], [3.0], tip_link="bucket")
    with pytest.raises(RobotError, match=r"'bucket'.*'tip_link'"):
        check_path(ROBOT, other)


BAD_FILES = {
    "empty": ("{}", "found the keys none"),
    "one corner": ("corners_m: [[1, 0, 0]]\ndurations_s: []", "2 corners or more"),
    "a corner of two": ("corners_m: [[1, 0], [2, 0, 0]]\ndurations_s: [1]", "3 numbers, found 2"),
    "durations": ("corners_m: [[1, 0, 0], [2, 0, 0]]\ndurations_s: [1, 2]", "1 numbers"),
    "no time": ("corners_m: [[1, 0, 0], [2, 0, 0]]\ndurations_s: [0]", "above 0 s"),
    "nan": ("corners_m: [[1, 0, 0], [.nan, 0, 0]]\ndurations_s: [1]", "finite"),
    "delay": (
        "start_delay_s: -1\ncorners_m: [[1, 0, 0], [2, 0, 0]]\ndurations_s: [1]",
        "0 s or more",
    ),
    "no joints": ("joints: []\nstart: []\nsegments: []", "distinct names"),
    "twice": ("joints: [a, a]\nstart: [0, 0]\nsegments: []", "distinct names"),
    "no segments": ("joints: [a]\nstart: [0]\nsegments: []", "one segment or more"),
    "kind": ("joints: [a]\nstart: [0]\nsegments: [{kind: leap}]", "one of move, hold"),
    "ramp": (
        "joints: [a]\nstart: [0]\n"
        "segments: [{kind: cruise, to: [1], duration_s: 1.0, ramp_s: 0.6}]",
        "at most half",
    ),
    "ladder": (
        "joints: [a]\nstart: [0]\n"
        "segments: [{kind: ladder, travel: [0.1], speeds: [1.0], ramp_s: 1.0, hold_s: 1.0}]",
        "reached within the travel",
    ),
    "fourier": (
        "joints: [a]\nstart: [0]\nsegments: [{kind: fourier, duration_s: 9, ramp_s: 1,"
        " fundamental_hz: 0.1, sine: [[1, 2], [3]]}]",
        "2 numbers, found 1",
    ),
    "too long": ("joints: [a]\nstart: [0]\nsegments: [{kind: hold, duration_s: 1e9}]", "at most"),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_files_are_one_line(tmp_path: FilePath, case: str) -> None:
    text, expected = BAD_FILES[case]
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    with pytest.raises(RobotError, match=expected) as caught:
        load_path(file)
    assert "\n" not in str(caught.value)
    assert str(file) in str(caught.value)


def test_a_missing_file_names_the_shipped_ones() -> None:
    with pytest.raises(RobotError, match=r"no path file 'nowhere'.*xs031/parallelogram"):
        load_path("nowhere")


@pytest.mark.parametrize("count", [1, ROWS, ROWS + 1, 3 * ROWS + 7])
def test_rows_in_pieces_are_the_rows_of_one_call(count: int) -> None:
    rng, turns = np.random.default_rng(count), list[int]()
    q, qd, qdd = rng.uniform(-1.0, 1.0, (3, count, ROBOT.dof))

    def of_rows(*rows: FloatArray) -> FloatArray:
        turns.append(len(rows[0]))
        return np.asarray(inverse_dynamics(ROBOT, *rows))

    went_on = list[int]()
    found = in_pieces(of_rows, q, qd, qdd, go_on=lambda: went_on.append(len(turns)))
    np.testing.assert_array_equal(found, inverse_dynamics(ROBOT, q, qd, qdd))
    assert max(turns) <= ROWS
    assert went_on == list(range(len(turns)))
