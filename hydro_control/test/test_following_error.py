"""From when on an arm is taken for one that does not follow: sizes, times, headway, its latch."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.monitoring.following_error import HEADWAY_SHARE, FollowingLimits, FollowingWatch
from hydro_control.motion.trajectory import Waypoint
from hydro_model.robot import FloatArray
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
DT, EMPTY = 0.002, np.array([])
RANGE = np.array([joint.upper - joint.lower for joint in ROBOT.joints])
SPEED = np.array([joint.velocity_limit for joint in ROBOT.joints])
TIME_S, SHARE = FollowingLimits().time_s, FollowingLimits().error_share
#: Samples from the first that is too far behind to the one that says so.
LASTS = round(TIME_S / DT)


def watch(**limits: float) -> FollowingWatch:
    return FollowingWatch(ROBOT, FollowingLimits(**limits))


def judged(
    one: FollowingWatch, rows: FloatArray, behind: FloatArray, *, epoch: int = 1, first: int = 0
) -> list[str]:
    return [
        one.judge((first + k) * DT, q, q + far, epoch, held=False)
        for k, (q, far) in enumerate(zip(rows, np.broadcast_to(behind, rows.shape), strict=True))
    ]


def only(joint: int, value: float) -> FloatArray:
    one = np.zeros(2)
    one[joint] = value
    return one


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("joint", [0, 1])
def test_a_joint_that_stands_too_far_behind_for_the_time_does_not_follow(
    joint: int, sign: float
) -> None:
    rows = np.tile(POSE, (LASTS + 20, 1))
    near = only(joint, 0.99 * sign * SHARE * RANGE[joint])
    assert not any(judged(watch(), rows, near))
    said = judged(watch(), rows, near / 0.98)
    assert [bool(text) for text in said] == [k >= LASTS for k in range(LASTS + 20)]
    far, most = abs(near[joint]) / 0.98, SHARE * RANGE[joint]
    assert said[LASTS] == (
        f"joint '{ROBOT.joint_names[joint]}' is {far:.3f} rad from where it shall be, expected at"
        f" most {most:.3f} rad, and came nearer by 0.000 rad in {TIME_S:.2f} s"
    )


@pytest.mark.parametrize(("share", "told"), [(1.05, False), (0.95, True)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("joint", [0, 1])
def test_who_comes_after_slowly_follows(joint: int, sign: float, share: float, told: bool) -> None:
    speed = share * sign * HEADWAY_SHARE * SPEED[joint]
    steps = np.arange(4 * LASTS)[:, None]
    rows = POSE + steps * DT * only(joint, speed)
    said = judged(watch(), rows, only(joint, sign * 2.0 * SHARE * RANGE[joint]))
    assert any(said) == told
    if told:
        assert f"nearer by {abs(speed) * TIME_S:.3f} rad" in next(filter(None, said))


def test_who_is_behind_by_the_limit_itself_is_not_too_far() -> None:
    most = SHARE * RANGE
    said = judged(watch(), np.zeros((LASTS + 20, 2)), most)
    assert said == [""] * (LASTS + 20)
    assert any(judged(watch(), np.zeros((LASTS + 20, 2)), np.nextafter(most, np.inf)))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_headway_of_just_enough_at_the_last_moment_is_some(sign: float) -> None:
    """From then on it counts anew."""
    least = HEADWAY_SHARE * TIME_S * SPEED[1]
    stood = np.arange(2 * LASTS + 1)[:, None] < LASTS
    rows = np.where(stood, 0.0, only(1, sign * least))
    said = judged(watch(), rows, only(1, sign * 2.0 * SHARE * RANGE[1]))
    assert said[:-1] == [""] * (2 * LASTS)
    assert "nearer by 0.000 rad" in said[-1]


def test_who_goes_away_makes_no_headway() -> None:
    steps = np.arange(LASTS + 1)[:, None]
    rows = POSE + steps * DT * only(0, -0.5)
    assert "nearer by -0.250 rad" in judged(watch(), rows, only(0, 2 * SHARE * RANGE[0]))[-1]


def test_it_is_told_the_time_after_the_last_headway() -> None:
    """And not up to twice that, as it would be by windows that follow each other."""
    moving = LASTS // 2
    steps = np.minimum(np.arange(3 * LASTS), moving)[:, None]
    rows = POSE + steps * DT * only(1, SPEED[1])
    said = judged(watch(), rows, only(1, 2.0 * SHARE * RANGE[1]))
    first = next(k for k, text in enumerate(said) if text)
    assert moving < first <= moving + LASTS


@pytest.mark.parametrize("pause", ["near", "other side", "other reference"])
def test_the_time_begins_anew(pause: str) -> None:
    one, rows = watch(), np.tile(POSE, (LASTS, 1))
    far = only(0, 1.01 * SHARE * RANGE[0])
    assert not any(judged(one, rows, far))
    after, epoch = far, 1
    if pause == "near":
        assert not any(judged(one, rows[:1], 0.5 * far, first=LASTS))
    elif pause == "other side":
        after = -far
    else:
        epoch = 2
    said = judged(one, np.tile(POSE, (LASTS + 1, 1)), after, epoch=epoch, first=LASTS + 1)
    assert [bool(text) for text in said] == [False] * LASTS + [True]


def test_the_joints_count_each_for_itself() -> None:
    """One that comes after is no headway of the other."""
    steps = np.arange(LASTS + 1)[:, None]
    rows = POSE + steps * DT * only(0, SPEED[0])
    said = judged(watch(), rows, 2.0 * SHARE * RANGE)
    assert "joint 'tilt'" in said[-1]


def test_a_joint_that_slides_is_behind_by_metres() -> None:
    slide = replace(ROBOT.joints[1], prismatic=True)
    robot = replace(ROBOT, joints=(ROBOT.joints[0], slide))
    one, rows = FollowingWatch(robot, FollowingLimits()), np.tile(POSE, (LASTS + 1, 1))
    assert "is 0.300 m from" in judged(one, rows, only(1, 0.3))[-1]


def test_what_is_only_held_and_goes_away_is_a_fault_until_it_is_forgotten() -> None:
    one = watch(time_s=0.1)
    far = POSE + only(0, 0.2)
    said = [one.judge(k * DT, POSE, far, 0, held=True) for k in range(51)]
    assert one.fault == f"{said[-1]}: latched until the controller is activated anew"
    one.forget()
    assert not one.fault
    assert not one.judge(51 * DT, POSE, far, 0, held=True)


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        ({"error_share": 0.0}, "following_error_share"),
        ({"error_share": 1.01}, "following_error_share"),
        ({"time_s": 0.0}, "following_error_s"),
        ({"time_s": float("inf")}, "following_error_s"),
        ({"time_s": float("nan")}, "following_error_s"),
    ],
)
def test_limits_that_are_none_are_refused(limits: dict[str, float], name: str) -> None:
    with pytest.raises(ControlError, match=f"{name} should be above 0"):
        FollowingLimits(**limits)


def test_limits_are_fixed_and_a_whole_range_is_one() -> None:
    limits = FollowingLimits(error_share=1.0)
    with pytest.raises(FrozenInstanceError):
        limits.time_s = 9.0  # type: ignore[misc]
    assert not hasattr(limits, "__dict__")


class Stuck:
    """A controller whose machine stands where it stands, whatever is commanded."""

    def __init__(self) -> None:
        self.core, self.cycle, self.q = ControllerCore(ROBOT, Gains()), -1, POSE
        self.applied: FloatArray | None = None

    def run(self, seconds: float, drift: FloatArray | None = None) -> Answer:
        chambers = np.full(2, 8e6)
        for _ in range(round(seconds / DT)):
            self.cycle += 1
            self.q = self.q if drift is None else self.q + DT * drift
            stamp_ns = 10**18 + self.cycle * 2_000_000
            answer = self.core.answer(Sample(stamp_ns, self.q, chambers, chambers, 19e6, 1e6))
            if self.applied is not None:
                self.core.applied(stamp_ns, self.applied)
        assert answer is not None
        return answer

    def go(self, *to: float) -> None:
        point = Waypoint(2.0, np.array(to), EMPTY, EMPTY)
        self.core.requests.trajectory("joint", ROBOT.joint_names, [point])


def test_a_motion_that_is_not_followed_is_dropped_and_the_arm_held_where_it_is() -> None:
    stuck = Stuck()
    stuck.run(0.1)
    stuck.go(0.9, -1.5)
    answer = stuck.run(2.5)
    assert not stuck.core.moving
    assert not answer.output.fault
    np.testing.assert_array_equal(answer.reference.position, POSE)
    assert stuck.core.message.startswith(
        "holding: the motion was dropped, as joint 'lift' is 0.22"
    )
    assert stuck.core.counts.not_followed == 1
    # It is no stop for good: what is asked for next is played.
    stuck.go(0.6, -1.45)
    assert stuck.core.message == ""
    assert np.any(stuck.run(1.0).reference.velocity)


def test_an_end_that_was_not_reached_is_no_hold_that_was_lost() -> None:
    """Whatever stands still by then is the reference, and not where the arm was."""
    stuck = Stuck()
    stuck.run(0.1)
    stuck.go(0.6 + 1.1 * SHARE * RANGE[0], -1.5)
    answer = stuck.run(4.0)
    assert stuck.core.counts.not_followed == 1
    assert not answer.output.fault


def test_a_hold_that_is_lost_ends_at_0_v_until_the_controller_begins_anew() -> None:
    stuck = Stuck()
    assert not stuck.run(0.1).output.fault
    # Away by the limit after 0.56 s, and from then on for half a second.
    assert not stuck.run(1.05, only(1, -0.2)).output.fault
    answer = stuck.run(0.05, only(1, -0.2))
    assert "joint 'tilt' is 0.21" in answer.output.fault
    assert "latched" in answer.output.fault
    assert not np.any(answer.output.voltage_v)
    stuck.q = POSE
    assert stuck.run(1.0).output.fault == answer.output.fault
    with pytest.raises(ControlError, match=r"the controller stopped: joint 'tilt' is 0\.21"):
        stuck.go(0.7, -1.5)
    assert stuck.core.counts.not_followed == 0
    stuck.core.restart()
    assert not stuck.run(1.0).output.fault


def test_what_the_valves_do_not_get_nobody_can_follow() -> None:
    stuck = Stuck()
    stuck.run(0.1)
    stuck.go(0.9, -1.5)
    stuck.applied = np.zeros(2)
    stuck.run(2.5)
    assert stuck.core.counts.not_followed == 0
    assert "the valves do not get the commands" in stuck.core.message
