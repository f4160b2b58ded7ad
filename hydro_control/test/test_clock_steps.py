"""What steps of the ROS clock do to a motion: nothing begins late, sooner or again by itself."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_control.core.answer import Answer
from hydro_control.core.core import ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.monitoring.stamps import LONGEST_GAP_S
from hydro_control.motion.asking import MOST_AHEAD_S
from hydro_control.motion.trajectory import Waypoint
from hydro_hw_bridge.protocol.sample_clock import SampleClock
from hydro_model.motion.paths import JointPath
from hydro_model.motion.paths_segments import Quintic
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
SUNK = POSE - 0.03
PERIOD_NS = 2_000_000
SECOND_NS = 1_000_000_000
HOUR_NS = 3600 * SECOND_NS
NOW_NS = 1_700_000_000 * SECOND_NS
GAP = round(LONGEST_GAP_S * SECOND_NS / PERIOD_NS)
PATH = JointPath((Quintic.at_rest([0.6], [0.8], 2.0),), joints=("lift",))
EMPTY = np.array([])
THERE = [Waypoint(2.0, np.array([0.8]), EMPTY, EMPTY)]


class Loop:
    """A controller at a machine that stands still, under the bridge's sample clock."""

    def __init__(self, path: JointPath | None = None, delay_s: float = 0.0) -> None:
        self.core = ControllerCore(ROBOT, Gains(), path, delay_s)
        self.q = POSE
        self.begin(NOW_NS)

    def begin(self, ros_ns: int) -> None:
        """A bridge begins, and maps its counter by the ROS clock."""
        self.clock = SampleClock(PERIOD_NS)
        self.restart_machine(ros_ns)

    def restart_machine(self, ros_ns: int) -> None:
        """The machine begins anew under the same bridge."""
        self.clock.start(0, ros_ns)
        self.counter = 0

    @property
    def stamp_ns(self) -> int:
        """Of the next sample."""
        assert self.clock.zero_stamp_ns is not None
        return self.clock.zero_stamp_ns + self.counter * PERIOD_NS

    def run(self, cycles: int = 1) -> Answer | None:
        """Samples on; the last answer."""
        answer = None
        for _ in range(cycles):
            stamp = self.clock.stamp_ns(self.clock.extend(self.counter))
            chambers = np.full(2, 8e6)
            answer = self.core.answer(Sample(stamp, self.q, chambers, chambers, None, None))
            self.counter += 1
        return answer

    def reference(self, cycles: int = 1) -> tuple[FloatArray, FloatArray]:
        """Position and velocity of the last answer's reference."""
        answer = self.run(cycles)
        assert answer is not None
        return answer.reference.position, answer.reference.velocity

    def stands(self, q: FloatArray, cycles: int) -> bool:
        """Every reference from now on is at rest there."""
        for _ in range(cycles):
            position, velocity = self.reference()
            if not np.array_equal(position, q) or np.any(velocity):
                return False
        return True


@pytest.mark.parametrize("space", ["joint", "tip"])
def test_a_start_too_far_ahead_is_refused(space: str) -> None:
    loop = Loop()
    newest_ns = loop.stamp_ns
    loop.run()
    names, points = ["lift"], THERE
    if space == "tip":
        there = np.asarray(tip_position(ROBOT, POSE + 0.02))
        names, points = [ROBOT.tip_link], [Waypoint(2.0, there, EMPTY, EMPTY)]
    most_ns = int(MOST_AHEAD_S * SECOND_NS)
    for ahead_ns in (HOUR_NS, most_ns + PERIOD_NS):
        expected = f"within 10 s of the newest sample, found {ahead_ns / SECOND_NS:.3f} s ahead"
        with pytest.raises(ControlError, match=f"trajectory refused: .*{expected}"):
            loop.core.requests.trajectory(space, names, points, newest_ns + ahead_ns)  # type: ignore[arg-type]
        assert expected in loop.core.message
    assert loop.core.counts.refused == 2
    assert loop.stands(POSE, 100)
    loop.core.requests.trajectory(space, names, points, newest_ns + most_ns)  # type: ignore[arg-type]
    loop.run()
    assert loop.core.moving


@pytest.mark.parametrize(("count", "last_s"), [(2, 600.1), (5001, 30.0)])
def test_a_trajectory_too_long_to_be_checked_soon_is_refused(count: int, last_s: float) -> None:
    """Nobody is heard meanwhile; who gave milliseconds for seconds would wait for minutes."""
    loop = Loop()
    loop.run()
    times = np.linspace(0.0, last_s, count + 1)[1:]
    points = [Waypoint(t, np.array([0.62]), EMPTY, EMPTY) for t in times.tolist()]
    expected = f"at most 5000 points over 600 s, found {count} over {last_s:g} s"
    with pytest.raises(ControlError, match=f"trajectory refused: .*{expected}"):
        loop.core.requests.trajectory("joint", ["lift"], points)
    assert loop.stands(POSE, 10)


@pytest.mark.parametrize("away_ns", [60_000_000, 5 * SECOND_NS, HOUR_NS])
@pytest.mark.parametrize("played", ["waits", "runs", "is asked for"])
def test_a_machine_that_begins_anew_carries_no_motion_on(played: str, away_ns: int) -> None:
    """It was away, or the ROS clock went forward meanwhile: by either much of a path is over."""
    loop = Loop()
    start_ns = loop.stamp_ns + SECOND_NS // 2
    loop.run()
    loop.core.requests.trajectory("joint", ["lift"], THERE, start_ns)
    if played != "is asked for":
        assert np.any(loop.reference(200 if played == "waits" else 600)[1]) == (played == "runs")
    loop.restart_machine(loop.stamp_ns + away_ns)
    loop.q = SUNK
    assert loop.stands(SUNK, 1500)
    assert not loop.core.moving
    assert "the motion was dropped, as no usable sample came for" in loop.core.message
    loop.core.requests.trajectory("joint", ["lift"], THERE)
    assert np.any(loop.reference(100)[1])
    assert loop.core.message == ""


def test_a_hold_is_held_where_the_robot_is_after_a_gap() -> None:
    loop = Loop()
    loop.run(10)
    with pytest.raises(ControlError, match="trajectory refused"):
        loop.core.requests.trajectory("joint", ["boom"], THERE)
    said = loop.core.message
    loop.counter += 1000
    loop.q = SUNK
    assert loop.stands(SUNK, 100)
    assert loop.core.message == said


def test_a_motion_goes_on_over_a_short_gap_and_over_no_longer_one() -> None:
    """What comes and is no number: `test_bad_samples.py`."""
    for cycles, goes_on in ((GAP, True), (GAP + 1, False)):
        loop = Loop(PATH)
        loop.run(300)
        loop.counter += cycles - 1
        assert np.any(loop.reference()[1]) == goes_on
        assert loop.core.moving == goes_on


def test_a_path_that_has_not_moved_yet_waits_anew_and_in_full() -> None:
    loop = Loop(PATH, 0.5)
    loop.run(200)
    loop.restart_machine(loop.stamp_ns + HOUR_NS)
    for k in range(500):
        expected = PATH.sample(k * 0.002 - 0.5)[0][0]
        np.testing.assert_allclose(loop.reference()[0], [expected, -1.5], atol=1e-12)


def test_a_path_that_has_moved_does_not_begin_again() -> None:
    loop = Loop(PATH, 0.1)
    loop.run(300)
    loop.restart_machine(loop.stamp_ns + HOUR_NS)
    assert loop.stands(POSE, 1500)


def test_no_path_takes_the_place_of_a_trajectory_that_waited() -> None:
    far = JointPath((Quintic.at_rest([1.0], [1.1], 2.0),), joints=("lift",))
    loop = Loop(far)
    loop.run()
    assert "path refused" in loop.core.message
    loop.core.requests.trajectory("joint", ["lift"], THERE, loop.stamp_ns + SECOND_NS)
    loop.run(10)
    loop.counter += 1000
    loop.q = np.array([0.9, -1.5])  # near enough to the path's start by now
    assert loop.stands(loop.q, 1500)


@pytest.mark.parametrize("back_ns", [60_000_000, HOUR_NS])
def test_stamps_that_went_back_are_answered_no_more_until_activated_anew(back_ns: int) -> None:
    """Else the motion went on by itself once the stamps had come to where it was."""
    loop = Loop(PATH)
    loop.run(300)
    went_on_ns = loop.stamp_ns
    loop.begin(went_on_ns - PERIOD_NS - back_ns)
    assert loop.run() is None
    told = loop.core.silent
    assert f"went back by {back_ns / SECOND_NS:.3f} s" in told
    assert "activate the controller anew" in told
    with pytest.raises(ControlError, match="the controller stopped: stamps went back"):
        loop.core.requests.trajectory("joint", ["lift"], THERE)
    loop.begin(went_on_ns)
    assert loop.run(100) is None
    assert loop.core.silent == told
    assert not loop.core.moving
    loop.core.restart()
    assert loop.core.silent == ""
    assert loop.run() is not None


def test_a_sample_that_is_a_little_late_changes_nothing() -> None:
    loop = Loop(PATH)
    loop.run(300)
    loop.counter -= GAP + 1
    assert loop.run() is None
    loop.counter += GAP
    assert np.any(loop.reference()[1])
    assert loop.core.silent == ""
    assert loop.core.counts.old == 1


def test_stamps_that_seconds_cannot_tell_apart_are_one_sample() -> None:
    """A clock that is set from 1970 to today leaves seconds as good as a quarter microsecond."""
    core, chambers = ControllerCore(ROBOT, Gains()), np.full(2, 8e6)
    stamps = [k * PERIOD_NS for k in range(20)]
    stamps += [NOW_NS + k * PERIOD_NS + more for k in range(20) for more in (0, 1)]
    answers = [core.answer(Sample(s, POSE, chambers, chambers, None, None)) for s in stamps]
    late = answers[20:]
    assert all(one is not None for one in late)
    for first, again in zip(late[::2], late[1::2], strict=True):
        assert again is first
    assert core.counts.repeated == 20
    assert not core.silent
