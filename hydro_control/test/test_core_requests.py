"""What is asked of a controller: requests that cannot be, that come too late, its own path."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.monitoring.following_error import FollowingLimits
from hydro_control.motion import reference
from hydro_control.motion.path_limits import same_start, start_of_path
from hydro_control.motion.reference import ReferencePlayer
from hydro_control.motion.trajectory import Waypoint
from hydro_model.errors import RobotError
from hydro_model.motion.paths import JointPath, TipPath
from hydro_model.motion.paths_joints import joints_at_tip
from hydro_model.motion.paths_segments import Quintic
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import EffectSpec, FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
STEP_NS = 2_000_000
EMPTY = np.array([])
THERE = [Waypoint(1.0, np.array([0.7]), EMPTY, EMPTY)]


def sample(cycle: int, q: FloatArray = POSE) -> Sample:
    """Of a machine that nothing is driven of: its pressures matter to no reference."""
    air = ROBOT.atmospheric_pressure_pa
    rails = ROBOT.supply_pressure_pa + air, ROBOT.tank_pressure_pa + air
    chambers = np.full(2, 8e6 + air)
    return Sample(10**18 + cycle * STEP_NS, q, chambers, chambers, *rails)


def answered(core: ControllerCore, cycle: int, q: FloatArray = POSE) -> Answer:
    answer = core.answer(sample(cycle, q))
    assert answer is not None
    return answer


def answered_up_to(core: ControllerCore, first: int, last: int, q: FloatArray = POSE) -> Answer:
    return [answered(core, k, q) for k in range(first, last + 1)][-1]


HUGE = float(np.finfo(float).max)


@pytest.mark.parametrize(
    ("space", "names", "end"),
    [
        ("joint", ["lift"], [HUGE]),
        ("joint", ["lift"], [-HUGE]),
        ("joint", ["lift", "tilt"], [0.6, 1e200]),
        ("tip", ["tip_link"], [HUGE, 0.0, 0.0]),
        ("tip", ["tip_link"], [2.0, -HUGE, HUGE]),
    ],
)
def test_finite_numbers_beyond_all_machines_are_refused_as_others(
    space: str, names: list[str], end: list[float]
) -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)
    still = np.zeros(len(end))
    for point in (
        [Waypoint(1.0, np.array(end), EMPTY, EMPTY)],
        [Waypoint(0.0, np.array(end), EMPTY, EMPTY), Waypoint(1.0, still, EMPTY, EMPTY)],
        [Waypoint(1.0, still, np.array(end), EMPTY), Waypoint(2.0, still, EMPTY, EMPTY)],
    ):
        with pytest.raises(ControlError, match=r"refused: point 0 of .* expected at most 1e\+06"):
            core.requests.trajectory(space, names, point)  # type: ignore[arg-type]
    np.testing.assert_array_equal(answered(core, 1).reference.position, POSE)


@pytest.mark.parametrize(
    "error",
    [
        ValueError,
        OverflowError,
        np.linalg.LinAlgError,
        KeyError,
        TypeError,
        IndexError,
        MemoryError,
    ],
)
def test_what_cannot_be_computed_is_refused_and_the_arm_is_held_on(
    error: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)

    def plan(*_: object) -> None:
        raise error("SVD did not converge")

    monkeypatch.setattr("hydro_control.motion.reference.segments_through", plan)
    with pytest.raises(ControlError, match=r"refused: it cannot be computed: '?SVD did not"):
        core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, POSE[:1], EMPTY, EMPTY)])
    assert core.counts.refused == 1
    np.testing.assert_array_equal(answered(core, 1).reference.position, POSE)


def while_checked(monkeypatch: pytest.MonkeyPatch, happens: Callable[[], object]) -> None:
    """What the thread of the samples does while that of a request plans its trajectory."""
    plan = reference.segments_through

    def planned(at: FloatArray, points: list[Waypoint]) -> object:
        legs = plan(at, points)
        monkeypatch.undo()
        happens()
        return legs

    monkeypatch.setattr(reference, "segments_through", planned)


def test_a_trajectory_is_not_played_from_where_the_reference_no_longer_stands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Over a gap the arm has sunk: what was planned before would lift it by a leap."""
    core, sunk = ControllerCore(ROBOT, Gains()), POSE - 0.02
    answered(core, 0)
    while_checked(monkeypatch, lambda: answered(core, 100, sunk))
    with pytest.raises(ControlError, match="refused: the reference was set anew while it was"):
        core.requests.trajectory("joint", ["lift"], THERE)
    np.testing.assert_array_equal(answered_up_to(core, 101, 109, sunk).reference.position, sunk)
    core.requests.trajectory("joint", ["lift"], THERE)
    np.testing.assert_allclose(answered(core, 110, sunk).reference.position, sunk, atol=1e-3)
    assert core.moving


def test_a_trajectory_is_not_played_from_where_another_began(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)
    quick = [Waypoint(0.1, np.array([0.601]), EMPTY, EMPTY)]

    def another() -> None:
        core.requests.trajectory("joint", ["lift"], quick)
        answered_up_to(core, 1, 60)

    while_checked(monkeypatch, another)
    with pytest.raises(ControlError, match="set anew while it was checked: ask again"):
        core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, POSE[:1], EMPTY, EMPTY)])
    np.testing.assert_allclose(answered(core, 61).reference.position, [0.601, -1.5])


@pytest.mark.parametrize("answered_before", [False, True])
def test_what_is_stopped_while_it_is_checked_is_not_played(
    answered_before: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether or not a sample comes between the stop and the end of the check."""
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)

    def stop() -> None:
        core.requests.trajectory("joint", [], [])
        if answered_before:
            answered(core, 1)

    while_checked(monkeypatch, stop)
    with pytest.raises(ControlError, match="refused: a stop was asked for while it was checked"):
        core.requests.trajectory("joint", ["lift"], THERE)
    np.testing.assert_array_equal(answered_up_to(core, 2, 50).reference.position, POSE)
    core.requests.trajectory("joint", ["lift"], THERE)
    answered(core, 51)
    assert core.moving


def test_what_waits_for_its_check_is_of_when_it_was_asked_for() -> None:
    core = ControllerCore(ROBOT, Gains())
    assert core.requests.standing is None
    answered(core, 0)
    before = core.requests.standing
    core.requests.stop()
    answered(core, 1)
    with pytest.raises(ControlError, match="a stop was asked for while it was checked"):
        core.requests.trajectory("joint", ["lift"], THERE, standing=before)
    after = core.requests.standing
    core.restart()
    answered(core, 0)
    with pytest.raises(ControlError, match="the controller began anew while it was checked"):
        core.requests.trajectory("joint", ["lift"], THERE, standing=after)
    assert not answered(core, 1).reference.velocity.any()


def test_what_was_accepted_is_played_and_not_replaced_before_it_begins() -> None:
    core = ControllerCore(ROBOT, Gains())
    answered(core, 0)
    core.requests.trajectory("joint", ["lift"], THERE)
    with pytest.raises(ControlError, match="refused: another motion was accepted and begins"):
        core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, POSE[:1], EMPTY, EMPTY)])
    assert answered_up_to(core, 1, 600).reference.position[0] == pytest.approx(0.7)
    core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, POSE[:1], EMPTY, EMPTY)])
    core.requests.stop()
    core.requests.trajectory("joint", ["lift"], [Waypoint(1.0, np.array([0.65]), EMPTY, EMPTY)])
    assert answered_up_to(core, 601, 1200).reference.position[0] == pytest.approx(0.65)


LOADED = replace(ROBOT, effects=(EffectSpec("payload_change", ROBOT.name, {"mass": 20.0}),))
#: Held with the lift in mid-range; with the lift low the tilt's cylinder cannot.
OUT = JointPath((Quintic.at_rest([-2.2], [-2.4], 4.0),), joints=("tilt",))
LOW = np.array([-0.05, -2.2])
HELD = "path refused, holding: .*'tilt_cylinder' would have to hold"


def test_a_path_is_checked_from_where_the_joints_stand_that_it_does_not_name() -> None:
    core = ControllerCore(LOADED, Gains(), OUT)
    np.testing.assert_array_equal(answered(core, 0, LOW).reference.position, LOW)
    assert re.match(HELD, core.message)
    assert core.counts.refused == 1
    assert not core.moving
    high = np.array([0.6, -2.2])
    core.restart()
    answered(core, 0, high)
    assert core.moving


def test_the_check_of_a_tip_path_holds_for_its_posture_alone() -> None:
    """Two postures of the crane put its tip to one place: the one does not speak for the other."""
    down = np.array([0.6, -0.4])
    corner = np.asarray(tip_position(ROBOT, down))
    path = TipPath.through([corner.tolist(), (corner - np.array([0, 0, 0.1])).tolist()], [3.0])
    up = joints_at_tip(ROBOT, corner, np.array([0.2, 0.5]))
    np.testing.assert_allclose(tip_position(ROBOT, up), corner, atol=1e-6)
    checked = start_of_path(ROBOT, path, 3.0)
    assert checked is not None
    np.testing.assert_allclose(checked, down, atol=1e-6)
    near = np.array([0.05, -0.05])
    assert same_start(ROBOT, path, checked, down + near)
    assert not same_start(ROBOT, path, checked, up + near)


def test_a_tip_path_in_another_frame_is_refused_at_once() -> None:
    place = tip_position(ROBOT, POSE).tolist()
    path = TipPath.through([place, [*place[:2], place[2] + 0.1]], [3.0], frame="truck")
    with pytest.raises(ControlError, match="in the frame 'base_link', found 'truck'"):
        ControllerCore(ROBOT, Gains(), path)


@pytest.mark.parametrize(("lift", "plays"), [(1.5, True), (0.825, False)])
def test_a_path_of_some_joints_is_judged_where_the_others_stand_and_nowhere_else(
    lift: float, plays: bool
) -> None:
    """With the lift in mid-range half a tonne is too heavy for it; steep it is held."""
    effects = (EffectSpec("payload_change", ROBOT.name, {"mass": 500.0}),)
    out = JointPath((Quintic.at_rest([-1.5], [-0.9], 6.0),), joints=("tilt",))
    core = ControllerCore(replace(ROBOT, effects=effects), Gains(), out)
    answered(core, 0, np.array([lift, -1.5]))
    assert core.moving == plays
    assert plays or re.match("path refused, holding: .*'lift_cylinder' would have", core.message)


@pytest.mark.parametrize(
    ("end", "seconds", "joint", "expected"),
    [
        (-0.1, 9.0, "tilt", "joint 'tilt' goes to -0.1 at"),
        (-0.9, 0.5, "tilt", "joint 'tilt' reaches a speed of"),
        (-1.4, 0.05, "tilt", "joint 'tilt' reaches"),
        (-0.9, 6.0, "jib", "no joint 'jib'"),
    ],
)
def test_what_the_named_joints_cannot_do_is_refused_before_any_pose_is_known(
    end: float, seconds: float, joint: str, expected: str
) -> None:
    path = JointPath((Quintic.at_rest([-1.5], [end], seconds),), joints=(joint,))
    with pytest.raises(RobotError, match=expected):
        ControllerCore(ROBOT, Gains(), path)


def test_what_the_cylinders_of_named_joints_cannot_do_is_refused_of_them_alone() -> None:
    """Strokes end before the joints do; that of the lift would in the middle of its range."""
    lift, tilt = ROBOT.cylinders
    short = replace(tilt, stroke_m=0.3)
    path = JointPath((Quintic.at_rest([-1.5], [-0.5], 9.0),), joints=("tilt",))
    with pytest.raises(RobotError, match="cylinder 'tilt_cylinder' goes to"):
        start_of_path(replace(ROBOT, cylinders=(lift, short)), path, 3.0)
    odd = replace(ROBOT, cylinders=(replace(lift, stroke_m=0.01), tilt))
    assert start_of_path(odd, path, 3.0) is None


class Beside:
    """A controller whose own path is checked beside the samples."""

    def __init__(self, q: FloatArray) -> None:
        # It stands, whatever is played.
        following = FollowingLimits(time_s=60.0)
        self.core = ControllerCore(LOADED, Gains(), OUT, following=following, checks_beside=True)
        self.q, self.cycle = q, -1
        self.run()

    def run(self, cycles: int = 1, *, lost: int = 0) -> FloatArray:
        self.cycle += lost
        for _ in range(cycles):
            self.cycle += 1
            position = answered(self.core, self.cycle, self.q).reference.position
        return position


@pytest.mark.parametrize(("lift", "plays"), [(0.6, True), (-0.05, False)])
def test_a_path_that_is_checked_beside_is_held_for_and_then_played_or_refused(
    lift: float, plays: bool
) -> None:
    beside = Beside(np.array([lift, -2.2]))
    np.testing.assert_array_equal(beside.run(100), beside.q)
    assert beside.core.path_waits
    with pytest.raises(ControlError, match="own path is being checked"):
        beside.core.requests.trajectory("joint", ["tilt"], [Waypoint(1.0, LOW[1:], EMPTY, EMPTY)])
    beside.core.requests.message = ""
    beside.core.requests.check_waiting_path()
    beside.run()
    assert not beside.core.path_waits
    assert beside.core.moving == plays
    assert plays == (beside.core.message == "")
    assert plays or re.match(HELD, beside.core.message)
    if plays:
        np.testing.assert_allclose(beside.run(3000), [lift, -2.4])


@pytest.mark.parametrize("error", [ValueError("no"), TypeError("no"), MemoryError()])
def test_a_path_whose_check_fails_for_whatever_reason_is_refused_once(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And not checked for ever, while the machine seems to hold until that is done."""
    beside = Beside(np.array([0.6, -2.2]))

    def fails(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(ReferencePlayer, "plan_path", fails)
    beside.core.requests.check_waiting_path()
    assert not beside.core.path_waits
    assert beside.core.message == f"path refused, holding: {str(error) or 'MemoryError'}"
    np.testing.assert_array_equal(beside.run(10), beside.q)


def test_a_path_that_waits_is_stopped_and_outlives_a_gap() -> None:
    beside = Beside(np.array([0.6, -2.2]))
    beside.run(50, lost=1000)
    assert beside.core.path_waits  # nothing of it was driven: it may start anew
    beside.core.requests.trajectory("joint", [], [])
    beside.run()
    beside.core.requests.check_waiting_path()
    beside.run(100)
    assert not beside.core.moving
    assert not beside.core.path_waits


def test_a_path_checked_before_a_gap_is_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lift has sunk meanwhile, and the load is too heavy for the tilt there."""
    beside = Beside(np.array([0.6, -2.2]))
    plan = ReferencePlayer.plan_path

    def planned(*arguments: object, **options: object) -> object:
        found = plan(*arguments, **options)  # type: ignore[arg-type]
        monkeypatch.undo()
        beside.q = LOW
        beside.run(lost=1000)
        return found

    monkeypatch.setattr(ReferencePlayer, "plan_path", planned)
    beside.core.requests.check_waiting_path()
    np.testing.assert_array_equal(beside.run(100), LOW)
    assert beside.core.path_waits
    beside.core.requests.check_waiting_path()
    np.testing.assert_array_equal(beside.run(100), LOW)
    assert re.match(HELD, beside.core.message)


@pytest.mark.parametrize("cycles", [50, 100, 101, 150])
def test_a_start_is_kept_however_long_the_check_takes(
    cycles: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Several machines that begin together do not begin apart by how long each one checked."""
    core, motion = ControllerCore(ROBOT, Gains()), Quintic.at_rest([0.6], [0.7], 1.0)
    answered(core, 0)
    while_checked(monkeypatch, lambda: answered_up_to(core, 1, cycles))
    if cycles > 100:
        with pytest.raises(ControlError, match=r"should have begun 0\.\d+ s ago, as it took so"):
            core.requests.trajectory("joint", ["lift"], THERE, sample(100).stamp_ns)
        assert not answered(core, cycles + 1).reference.velocity.any()
        return
    core.requests.trajectory("joint", ["lift"], THERE, sample(100).stamp_ns)
    for k in range(cycles + 1, 300):
        expected = motion.sample(max(0.0, (k - 100) * 0.002))[0][0]
        assert answered(core, k).reference.position[0] == pytest.approx(expected, abs=1e-12)
