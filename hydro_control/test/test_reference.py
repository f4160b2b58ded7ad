"""References: what is accepted, what is refused and why, and trajectories as quintics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest

from hydro_control.errors import ControlError
from hydro_control.motion.approach import approach_to
from hydro_control.motion.motion_limits import refuse_fast
from hydro_control.motion.reference import ReferencePlayer
from hydro_control.motion.trajectory import Waypoint, segments_through, waypoints_of
from hydro_model.motion.paths import JointPath, Path, TipPath, load_path
from hydro_model.motion.paths_joints import joint_motion
from hydro_model.motion.paths_segments import Quintic
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import FloatArray, Robot
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
TIP = np.asarray(tip_position(ROBOT, POSE))
NONE = np.array([])


def points(*rows: tuple[float, list[float]]) -> list[Waypoint]:
    return [Waypoint(t, np.array(q), NONE, NONE) for t, q in rows]


def ramp(step_s: float) -> list[Waypoint]:
    """Positions alone, as of a log that is played again: 0.2 rad/s on the whole."""
    return points(*((k * step_s, [0.6 + 0.2 * k * step_s]) for k in range(1, 101)))


def beyond(place: FloatArray, step: list[float]) -> list[float]:
    return list(place + np.array(step))


def joint_path(start: list[float], end: list[float], duration_s: float = 2.0) -> JointPath:
    return JointPath((Quintic.at_rest(start, end, duration_s),), joints=("lift", "tilt"))


def test_holds_where_it_starts() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    reference = player.sample(12.3)
    assert reference.space == "joint"
    np.testing.assert_array_equal(reference.position, POSE)
    assert not np.any(reference.velocity)
    assert not player.moving(0.0)


def test_a_path_from_here_plays_after_the_delay() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    path = joint_path(POSE.tolist(), [0.7, -1.4])
    player.play(player.plan_path(path, 3.0, POSE, delay_s=1.0), 3.0)
    np.testing.assert_array_equal(player.sample(3.9).position, POSE)
    np.testing.assert_allclose(player.sample(5.0).position, path.sample(1.0)[0])
    assert player.moving(5.99)
    assert not player.moving(6.01)
    np.testing.assert_allclose(player.sample(100.0).position, [0.7, -1.4])


def test_a_near_start_is_approached_within_the_delay() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    start = TIP + np.array([0.01, 0.0, 0.0])
    path = TipPath.through([start.tolist(), beyond(start, [0.0, 0.0, 0.2])], [3.0])
    player.play(player.plan_path(path, 0.0, POSE, delay_s=1.0), 0.0)
    np.testing.assert_allclose(player.sample(0.0).position, TIP, atol=1e-12)
    np.testing.assert_allclose(player.sample(0.5).position, start, atol=1e-12)
    np.testing.assert_allclose(player.sample(1.0 + 1.2).position, path.sample(1.2)[0])


def test_an_approach_longer_than_the_delay_keeps_its_speed() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    start = POSE + 0.2
    player.play(player.plan_path(joint_path(start.tolist(), [0.7, -1.4]), 0.0, POSE), 0.0)
    speeds = [np.abs(player.sample(t).velocity).max() for t in np.arange(0.0, 3.75, 0.01)]
    assert max(speeds) == pytest.approx(0.1, rel=1e-3)


def slow(limit: float) -> Robot:
    """The crane with a lift joint that is slower than approaches usually are."""
    lift, tilt = ROBOT.joints
    return replace(ROBOT, joints=(replace(lift, velocity_limit=limit), tilt))


@pytest.mark.parametrize("checked", [False, True])
def test_an_approach_is_as_slow_as_the_joints_are(checked: bool) -> None:
    player = ReferencePlayer(slow(0.05), POSE)
    start = [float(POSE[0]) + 0.1, float(POSE[1])]
    path = joint_path(start, [start[0], -1.4])
    plan = player.plan_path(path, 0.0, POSE, path_checked=checked)
    assert plan.path.duration_s == pytest.approx(1.875 * 0.1 / 0.05 + 2.0)
    speeds = [abs(plan.path.sample(t)[1][0]) for t in np.linspace(0.0, 4.0, 401)]
    assert max(speeds) == pytest.approx(0.05, rel=1e-3)


@pytest.mark.parametrize("checked", [False, True])
def test_an_approach_of_the_tip_is_as_slow_as_the_joints_are(checked: bool) -> None:
    robot = slow(0.02)
    player = ReferencePlayer(robot, POSE)
    start = TIP + np.array([0.0, 0.0, 0.1])
    path = TipPath.through([start.tolist(), beyond(start, [0.01, 0.0, 0.0])], [4.0])
    plan = player.plan_path(path, 0.0, POSE, path_checked=checked)
    whole = TipPath(plan.path.segments, tip_link=robot.tip_link)
    times = np.linspace(0.0, whole.duration_s, 200)
    speeds = np.abs(joint_motion(robot, whole, times, POSE)[1])
    assert 0.9 * 0.02 < speeds[:, 0].max() <= 0.02


def test_an_approach_is_as_slow_as_the_tip_has_to_be() -> None:
    """0.1 rad/s of both joints would be beyond 0.2 m/s."""
    start = POSE + 0.05
    path = joint_path(start.tolist(), (start + 0.01).tolist())
    plan = ReferencePlayer(ROBOT, POSE, 0.2).plan_path(path, 0.0, POSE)
    times = np.linspace(0.0, plan.path.duration_s, 801)
    places = np.array([tip_position(ROBOT, plan.path.sample(t)[0]) for t in times])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
    assert 0.18 < speeds.max() <= 0.2


def test_an_approach_that_never_ends_is_refused() -> None:
    player = ReferencePlayer(slow(0.001), POSE)
    path = joint_path([float(POSE[0]) + 0.12, float(POSE[1])], [0.7, -1.5])
    with pytest.raises(ControlError, match=r"would take 225 s, expected at most 60 s"):
        player.plan_path(path, 0.0, POSE)


def test_a_far_start_is_refused() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    with pytest.raises(ControlError, match=r"starts 0\.400 rad or m from where the robot stands"):
        player.plan_path(joint_path([1.0, -1.5], [0.9, -1.5]), 0.0, POSE)
    far = TipPath.through([beyond(TIP, [0.5, 0, 0]), TIP.tolist()], [3.0])
    with pytest.raises(ControlError, match=r"starts 0\.500 m from"):
        player.plan_path(far, 0.0, POSE)


def test_a_path_beyond_the_limits_is_refused_with_the_limit() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    with pytest.raises(ControlError, match="joint 'lift' goes to 2 at"):
        player.plan_path(joint_path(POSE.tolist(), [2.0, -1.5], 9.0), 0.0, POSE)
    with pytest.raises(ControlError, match="'tilt' reaches a speed of"):
        player.plan_path(joint_path(POSE.tolist(), [0.6, -0.5], 0.5), 0.0, POSE)
    out = TipPath.through([TIP.tolist(), beyond(TIP, [9.0, 0, 0])], [60.0])
    with pytest.raises(ControlError, match="cannot put its tip"):
        player.plan_path(out, 0.0, POSE)


def test_one_motion_at_a_time_until_it_is_stopped() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    path = joint_path(POSE.tolist(), [0.9, -1.2], 3.0)
    player.play(player.plan_path(path, 0.0, POSE), 0.0)
    with pytest.raises(ControlError, match=r"another 2\.00 s"):
        player.plan_path(path, 1.0, POSE)
    before = player.sample(1.5)
    player.stop(1.5)
    after = player.sample(1.5)
    np.testing.assert_allclose(after.position, before.position)
    np.testing.assert_allclose(after.velocity, before.velocity)
    np.testing.assert_allclose(after.acceleration, before.acceleration, atol=1e-9)
    assert not np.any(player.sample(2.01).velocity)
    # Always forward, and no further than it would have gone.
    stops = np.array([player.sample(t).velocity for t in np.arange(1.5, 2.0, 0.01)])
    assert np.all(stops >= -1e-9)


def test_spaces_follow_each_other_without_a_jump() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    up = TipPath.through([TIP.tolist(), beyond(TIP, [0.1, 0.0, 0.3])], [3.0])
    player.play(player.plan_path(up, 0.0, POSE), 0.0)
    end = player.sample(3.0).position
    near = POSE + 0.05
    plan = player.plan_trajectory("joint", ["tilt"], points((2.0, [-1.3])), 3.5, near)
    np.testing.assert_allclose(tip_position(ROBOT, plan.path.sample(0.0)[0]), end, atol=1e-6)
    assert plan.path.sample(2.0)[0][1] == pytest.approx(-1.3)
    # The joint that is not named stays.
    assert plan.path.sample(2.0)[0][0] == plan.path.sample(0.0)[0][0]


def test_joint_names_in_any_order() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    names, rows = ["tilt", "lift"], points((2.0, [-1.4, 0.7]))
    plan = player.plan_trajectory("joint", names, rows, 0.0, POSE)
    np.testing.assert_allclose(plan.path.sample(2.0)[0], [0.7, -1.4])


@pytest.mark.parametrize(
    ("space", "names", "rows", "expected"),
    [
        ("joint", ["boom"], points((1.0, [0.0])), "should name lift, tilt.*found boom"),
        ("joint", ["lift", "lift"], points((1.0, [0.6, 0.6])), "each once"),
        ("joint", [], points((1.0, [])), "found no name"),
        ("tip", ["bucket"], points((1.0, [2.0, 0.0, 0.0])), "should name tip_link"),
        ("joint", ["lift"], points((1.0, [0.6, 0.6])), "1 values of position, found 2"),
        ("joint", ["lift"], points((1.0, [0.6]), (1.0, [0.7])), "1 s after 1 s at point 1"),
        ("joint", ["lift"], points((2.0, [0.6]), (1.0, [0.7])), "1 s after 2 s at point 1"),
        ("joint", ["lift"], points((0.0, [0.6]), (1.0, [0.6]), (1.0, [0.7])), "1 s at point 2"),
        ("joint", ["lift"], points((-1.0, [0.6]), (1.0, [0.7])), "should grow from 0 s"),
        ("joint", ["lift"], points((-1.0, [0.6])), "grow from 0 s, found -1 s at point 0"),
        ("tip", ["tip_link"], points((-1.0, TIP.tolist())), "found -1 s at point 0"),
        ("joint", ["lift"], points((1.0, [np.nan])), "not finite"),
        ("joint", ["lift"], points((0.0, [0.6])), "a point after time 0"),
        ("joint", ["lift"], points((0.0, [1.2]), (1.0, [0.7])), "starts 0.600 rad or m"),
        ("joint", ["lift"], points((0.2, [1.2])), "reaches a speed of"),
        # Between two samples of the check both ends of a leg are at rest.
        ("joint", ["lift"], points((0.01, [1.2])), "reaches a speed of"),
        ("joint", ["lift"], points((2.0, [0.7]), (2.004, [0.71])), "speed of .* at 2.00 s"),
        ("joint", ["lift"], ramp(0.01), "acceleration of 11.* at .* s.*give velocities"),
        ("joint", ["lift"], points((9.0, [2.0])), "'lift' goes to 2"),
    ],
)
def test_refusals_of_trajectories(
    space: str, names: list[str], rows: list[Waypoint], expected: str
) -> None:
    player = ReferencePlayer(ROBOT, POSE)
    with pytest.raises(ControlError, match=expected):
        player.plan_trajectory(space, names, rows, 0.0, POSE)  # type: ignore[arg-type]


def test_points_with_velocities_are_as_quick_as_they_like() -> None:
    """The motion whose bare positions would ask for 20 times its acceleration."""
    times = np.linspace(0.0, 3.0, 301)[1:]
    wave = 2.0 * np.pi / 3.0
    q, qd = 0.7 - 0.1 * np.cos(wave * times), 0.1 * wave * np.sin(wave * times)
    qd[-1] = 0.0
    rows = [
        Waypoint(float(t), np.array([at]), np.array([speed]), NONE)
        for t, at, speed in zip(times, q, qd, strict=True)
    ]
    player = ReferencePlayer(ROBOT, POSE)
    plan = player.plan_trajectory("joint", ["lift"], rows, 0.0, POSE)
    assert plan.path.sample(1.5)[0][0] == pytest.approx(0.8)


def test_a_trajectory_has_to_end_at_rest() -> None:
    moving = Waypoint(1.0, np.array([0.7]), np.array([0.1]), NONE)
    with pytest.raises(ControlError, match="end at rest, its last velocity"):
        segments_through(np.array([0.6]), [moving])


def test_waypoints_give_a_path_back(tmp_path: FilePath) -> None:
    """Corners exactly, a 3 Hz chirp and a Fourier series to a hundredth of a milliradian."""
    shipped = load_path("xs031/parallelogram")
    again = Path(segments_through(shipped.sample(0.0)[0], waypoints_of(shipped)))
    times = np.linspace(0.0, shipped.duration_s, 999)
    for a, b in zip(shipped.sample_many(times), again.sample_many(times), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    file = tmp_path / "excite.yaml"
    file.write_text(
        "joints: [lift]\nstart: [0.6]\nstart_delay_s: 0.5\nsegments:\n"
        "  - {kind: chirp, duration_s: 6.0, amplitude: [0.02], from_hz: 0.2, to_hz: 3.0,"
        " ramp_s: 1.0}\n"
        "  - {kind: hold, duration_s: 1.0}\n"
        "  - {kind: fourier, duration_s: 8.0, fundamental_hz: 0.2, ramp_s: 2.0,"
        " sine: [[0.1, 0.05]]}\n"
    )
    path = load_path(file)
    again = Path(segments_through(path.sample(0.0)[0], waypoints_of(path)))
    times = np.linspace(0.0, path.duration_s, 4999)
    found, expected = again.sample_many(times), path.sample_many(times)
    np.testing.assert_allclose(found[0], expected[0], atol=1e-5)
    np.testing.assert_allclose(found[1], expected[1], atol=1e-3)


@pytest.mark.parametrize("space", ["tip", "joint"])
def test_a_start_that_is_no_number_is_refused(space: str) -> None:
    """A distance that is not a number is within no limit."""
    at = TIP if space == "tip" else POSE
    for wrong in (np.nan, np.inf):
        with pytest.raises(ControlError, match="the path starts"):
            approach_to(ROBOT, space, at, at + wrong, POSE)  # type: ignore[arg-type]


def test_a_leg_beyond_the_range_of_numbers_is_refused() -> None:
    turn = Waypoint(1e152, np.array([0.7]), NONE, np.array([1e6]))
    with (
        np.errstate(over="ignore", invalid="ignore"),
        pytest.raises(ControlError, match="leg 1 of the trajectory is beyond the range"),
    ):
        segments_through(np.array([0.6]), [turn, *points((2e152, [0.6]))])


def test_a_path_that_is_no_number_is_refused() -> None:
    """No comparison with it holds, and none of the limits."""
    with np.errstate(invalid="ignore"):
        there = Quintic.at_rest(POSE.tolist(), [0.7, -1.4], 2.0)
        lost = Quintic.at_rest([0.7, -1.4], [np.nan, -1.4], 2.0)
        path = JointPath((there, lost), joints=("lift", "tilt"))
        with pytest.raises(ControlError, match="expected a motion of finite numbers"):
            ReferencePlayer(ROBOT, POSE).plan_path(path, 0.0, POSE)
        with pytest.raises(ControlError, match="the tip reaches nan m/s"):
            refuse_fast(ROBOT, TipPath.through([[2.0, 0.0, 0.0], [np.nan, 0.0, 0.0]], [1.0]), 3.0)


def test_a_trajectory_begins_at_its_stamp() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    plan = player.plan_trajectory("joint", ["lift"], points((2.0, [0.7])), 3.0, POSE, 4.5)
    assert (plan.start_s, plan.path.duration_s) == (4.5, 2.0)


def test_an_approach_ends_at_the_stamp() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    rows = points((0.0, [0.65]), (2.0, [0.7]))
    plan = player.plan_trajectory("joint", ["lift"], rows, 3.0, POSE, 4.5)
    assert plan.start_s == pytest.approx(4.5 - 1.875 * 0.05 / 0.1)
    player.play(plan, plan.start_s or 0.0)
    motion = Quintic.at_rest([0.65], [0.7], 2.0)
    assert player.sample(4.5).position[0] == pytest.approx(0.65)
    assert player.sample(5.1).position[0] == pytest.approx(motion.sample(0.6)[0][0])
    assert player.sample(3.2).position[0] == POSE[0]
    with pytest.raises(ControlError, match=r"start in 0\.900 s, but the approach .* 0\.938 s"):
        ReferencePlayer(ROBOT, POSE).plan_trajectory("joint", ["lift"], rows, 3.6, POSE, 4.5)


def round_a_corner() -> TipPath:
    """Up and out, from rest to rest, each leg in a second."""
    corners = [TIP.tolist(), beyond(TIP, [0.0, 0.0, 0.3]), beyond(TIP, [0.3, 0.0, 0.3])]
    return TipPath.through(corners, [1.0, 1.0])


@pytest.mark.parametrize("at_s", [0.05, 0.5, 0.71, 0.9, 1.0, 1.1, 1.71, 1.99])
def test_a_stop_stays_on_the_path(at_s: float) -> None:
    """What lies beyond its end, or straight on at its corner, has been checked by nobody."""
    path, player = round_a_corner(), ReferencePlayer(ROBOT, POSE)
    player.play(player.plan_path(path, 0.0, POSE), 0.0)
    speed = np.linalg.norm(path.sample_many(np.linspace(0.0, 2.0, 401))[1], axis=1).max()
    player.stop(at_s)
    times = at_s + np.linspace(0.0, 0.5, 501)
    stop = [player.sample(t) for t in times]
    places = np.array([r.position for r in stop])
    out, up = (places - TIP)[:, 0], (places - TIP)[:, 2]
    on_the_path = np.minimum(np.abs(out), np.abs(up - 0.3))
    np.testing.assert_allclose(on_the_path, 0.0, atol=1e-9)
    assert np.all(np.diff(out) >= -1e-12)
    assert np.all(np.diff(up) >= -1e-12)
    assert max(out.max(), up.max()) <= 0.3 + 1e-9
    velocities = np.array([r.velocity for r in stop])
    accelerations = np.array([r.acceleration for r in stop])
    assert np.linalg.norm(velocities, axis=1).max() <= speed
    # Each is the integral of the next, so that none of them leaps.
    for part, rate in ((places, velocities), (velocities, accelerations)):
        np.testing.assert_allclose(np.gradient(part, times, axis=0)[1:-1], rate[1:-1], atol=0.02)
    before = path.sample(at_s)
    for found, expected in zip((places, velocities, accelerations), before, strict=True):
        np.testing.assert_allclose(found[0], expected, atol=1e-9)
    assert not np.any(velocities[-1])
    assert not player.moving(at_s + 0.5)


def test_a_second_stop_puts_nothing_off() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    player.play(player.plan_path(round_a_corner(), 0.0, POSE), 0.0)
    player.stop(0.3)
    there = player.sample(0.9).position
    for t in np.arange(0.31, 0.795, 0.01):
        player.stop(float(t))
    assert not player.moving(0.8)
    np.testing.assert_array_equal(player.sample(0.9).position, there)


def test_what_waits_does_not_set_out_once_stopped() -> None:
    player = ReferencePlayer(ROBOT, POSE)
    plan = player.plan_trajectory("joint", ["lift"], points((2.0, [0.7])), 0.0, POSE, 1.0)
    player.play(plan, 1.0)
    player.stop(0.95)
    for t in np.arange(0.95, 3.0, 0.05):
        np.testing.assert_array_equal(player.sample(t).position, POSE)
    assert not player.moving(0.95)
