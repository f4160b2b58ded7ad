"""Messages of the right type that no planner sends: each is refused, and the arm is held on."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.errors import names_in_short
from hydro_control.gains import Gains
from hydro_control.motion.asking import MOST_POINTS
from hydro_model.multibody.kinematics import tip_position
from hydro_model.robot_files import load_robot

rclpy = pytest.importorskip("rclpy")

from builtin_interfaces.msg import Duration, Time  # noqa: E402
from geometry_msgs.msg import Transform, Twist, Vector3  # noqa: E402
from rclpy.logging import get_logger  # noqa: E402
from trajectory_msgs.msg import (  # noqa: E402
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

from hydro_control.node.trajectory_intake import TrajectoryIntake  # noqa: E402

pytestmark = pytest.mark.ros

ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
X, Y, Z = np.asarray(tip_position(ROBOT, POSE)).tolist()
INF, NAN = float("inf"), float("nan")
LARGEST = float(np.finfo(float).max)
LEAST, MOST = -(2**31), 2**31 - 1


class Asked:
    """The node's own way from a message to its core, without a process around it."""

    def __init__(self, log: Any = None) -> None:
        self.said: list[str] = []
        self.core = ControllerCore(ROBOT, Gains())
        own = SimpleNamespace(error=self.said.append, info=self.said.append)
        self.intake = TrajectoryIntake(self.core, lambda: True, log or own)
        self.answer(0)

    def __call__(self, message: Any) -> str:
        before = len(self.said)
        self.intake.take("joint" if isinstance(message, JointTrajectory) else "tip", message)
        while self.intake.busy:
            time.sleep(1e-4)
        assert len(self.said) == before + 1
        return self.said[-1]

    def answer(self, cycle: int) -> Any:
        air = ROBOT.atmospheric_pressure_pa
        rails = ROBOT.supply_pressure_pa + air, ROBOT.tank_pressure_pa + air
        chambers = np.full(2, 8e6 + air)
        answer = self.core.answer(
            Sample(10**18 + cycle * 2_000_000, POSE, chambers, chambers, *rails)
        )
        assert answer is not None
        return answer


def joints(
    *points: tuple[tuple[int, int], list[float]],
    names: tuple[str, ...] = ("lift", "tilt"),
    velocities: tuple[float, ...] = (),
    stamp: tuple[int, int] = (0, 0),
) -> JointTrajectory:
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = Time(sec=stamp[0], nanosec=stamp[1])
    for (sec, nanosec), at in points:
        after = Duration(sec=sec, nanosec=nanosec)
        message.points.append(
            JointTrajectoryPoint(positions=at, velocities=list(velocities), time_from_start=after)
        )
    return message


def tip(
    *points: tuple[int, list[float]],
    names: tuple[str, ...] = ("tip_link",),
    transforms: int = 1,
    twists: int = 0,
    accelerations: int = 0,
    frame: str = "",
) -> MultiDOFJointTrajectory:
    message = MultiDOFJointTrajectory(joint_names=list(names))
    message.header.frame_id = frame
    for sec, (x, y, z) in points:
        at = Transform(translation=Vector3(x=x, y=y, z=z))
        message.points.append(
            MultiDOFJointTrajectoryPoint(
                transforms=[at] * transforms,
                velocities=[Twist()] * twists,
                accelerations=[Twist()] * accelerations,
                time_from_start=Duration(sec=sec),
            )
        )
    return message


NEAR, TIP = [0.6, -1.45], [X, Y, Z + 0.05]
IN_2_S = (2, 0)

HOSTILE = {
    "no name": (joints((IN_2_S, NEAR), names=()), "found no name"),
    "empty name": (joints((IN_2_S, NEAR), names=("", "")), "each once, found , "),
    "twice the same": (joints((IN_2_S, NEAR), names=("tilt", "tilt")), "each once"),
    "name of a terminal": (
        joints((IN_2_S, NEAR), names=("lift\x1b[2J\n[INFO] accepted", "tilt")),
        r"found lift\x1b[2J\n[INFO] accepted, tilt",
    ),
    "long name": (joints((IN_2_S, NEAR), names=("l" * 10**6, "tilt")), "lll..., tilt"),
    "many names": (
        joints((IN_2_S, NEAR), names=("lift", "tilt", "x") * 10_000),
        "x, lift, and 29984 more",
    ),
    "fewer positions": (joints((IN_2_S, NEAR[:1])), "should have 2 values of position, found 1"),
    "no positions": (joints((IN_2_S, [])), "should have 2 values of position, found 0"),
    "many positions": (joints((IN_2_S, [0.6] * 10**6)), "of position, found 1000000"),
    "fewer velocities": (joints((IN_2_S, NEAR), velocities=(0.0,)), "2 values of velocity"),
    "no number": (joints((IN_2_S, [NAN, -1.5])), "not finite"),
    "infinity": (joints((IN_2_S, [0.6, -INF])), "not finite"),
    "largest number": (joints((IN_2_S, [0.6, LARGEST])), "expected at most 1e+06"),
    "fast points": (joints((IN_2_S, NEAR), velocities=(NAN, 0.0)), "velocity that is not"),
    "negative time": (joints(((-1, 0), NEAR)), "grow from 0 s, found -1 s at point 0"),
    "least time": (joints(((LEAST, 0), NEAR)), "grow from 0 s, found -2.14748e+09 s"),
    "last time": (joints(((MOST, 2**32 - 1), NEAR)), "points over 600 s, found 1 over 2.14"),
    "a late point before the last": (
        joints(((MOST, 0), NEAR), (IN_2_S, NEAR)),
        "grow from 0 s, found 2 s after 2.14748e+09 s",
    ),
    "time 0 alone": (joints(((0, 0), NEAR)), "a point after time 0"),
    "a nanosecond": (joints(((0, 1), NEAR)), "reaches a speed of"),
    "times that stand": (joints((IN_2_S, NEAR), (IN_2_S, NEAR)), "2 s after 2 s at point 1"),
    "stamp of the past": (joints((IN_2_S, NEAR), stamp=(1, 0)), "now or later, found 999999999"),
    "least stamp": (joints((IN_2_S, NEAR), stamp=(LEAST, 0)), "now or later"),
    "last stamp": (joints((IN_2_S, NEAR), stamp=(MOST, 2**32 - 1)), "within 10 s of the newest"),
    "many points": (
        joints(*(((k // 100, k % 100 * 10**7), NEAR) for k in range(MOST_POINTS + 1))),
        "expected at most 5000 points, found 5001",
    ),
    "tip before time 0": (tip((-1, TIP)), "grow from 0 s, found -1 s at point 0"),
    "tip of another link": (tip((2, TIP), names=("lift_link",)), "should name tip_link"),
    "tip twice": (tip((2, TIP), names=("tip_link", "tip_link")), "each once"),
    "tip nowhere": (tip((2, TIP), transforms=0), "should have 3 values of position, found 0"),
    "two bodies": (tip((2, TIP), transforms=2), "at most one entry of transforms, the tip's"),
    "two twists": (tip((2, TIP), twists=2), "one entry of velocities, the tip's, found 2"),
    "two changes": (tip((2, TIP), accelerations=3), "of accelerations, the tip's, found 3"),
    "another frame": (tip((2, TIP), frame="truck"), "in the frame 'base_link', found 'truck'"),
    "tip no number": (tip((2, [X, NAN, Z])), "not finite"),
    "tip far out": (tip((9, [1e6, 0.0, 0.0])), "cannot put its tip at"),
    "tip out of the plane": (tip((2, [X, 0.1, Z])), "cannot put its tip at"),
    "tip at the base": (tip((9, [0.0, 0.0, 0.0])), "refused"),
}


@pytest.fixture(scope="module")
def asked() -> Asked:
    return Asked()


@pytest.mark.parametrize("name", HOSTILE)
def test_it_is_refused_with_its_reason_and_the_arm_held_on(asked: Asked, name: str) -> None:
    message, expected = HOSTILE[name]
    before = asked.core.counts.refused
    said = asked(message)
    assert said.startswith("trajectory refused: ")
    assert expected in said
    assert said == asked.core.message
    assert asked.core.counts.refused == before + 1
    # What is published each second and stands in logs is a short line that commands nothing.
    assert len(said) < 500
    assert said.isprintable()
    assert not asked.core.moving
    last = asked.core.last
    assert last is not None
    answer = asked.answer((last.stamp_ns - 10**18) // 2_000_000 + 1)
    np.testing.assert_array_equal(answer.reference.position, POSE)
    assert not answer.reference.velocity.any()


def test_the_same_messages_without_what_is_wrong_are_played() -> None:
    based = tip((2, TIP), twists=1, frame="base_link")
    for message in (joints((IN_2_S, NEAR)), tip((2, TIP)), based):
        one = Asked()
        assert one(message).endswith("trajectory with 1 points accepted")
        one.answer(1)
        assert one.core.moving


def test_a_stop_is_one_whatever_else_the_message_holds() -> None:
    one = Asked()
    one(joints((IN_2_S, NEAR)))
    one.answer(1)
    assert one.core.moving
    assert one(tip(frame="truck", names=("", "hook"))) == "tip trajectory to stop accepted"
    for cycle in range(2, 300):
        answer = one.answer(cycle)
    assert not answer.reference.velocity.any()
    assert not one.core.moving


def test_what_is_checked_when_the_controller_is_deactivated_is_not_called_accepted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = Asked()
    monkeypatch.setattr(one.intake, "_active", iter([True, False]).__next__)
    assert one(joints((IN_2_S, NEAR))) == "trajectory refused: the controller is not active"


def test_so_many_names_are_shown_as_fit_into_a_line() -> None:
    assert names_in_short([]) == ""
    assert names_in_short(["lift", "tilt"]) == "lift, tilt"
    many = [f"{k}{'x' * 1000}\n" for k in range(1000)]
    assert names_in_short(many).endswith("xxx..., and 984 more")
    assert len(names_in_short(many)) < 1000


def test_what_is_accepted_and_what_is_refused_is_all_written_down(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """By rclpy's logger, which takes what a line of ours writes for one severity alone."""
    asked = Asked(get_logger("asked"))
    far, near = joints(((2, 0), [9.0, -1.5])), joints(((2, 0), [0.7, -1.5]))
    for message in (far, near, far):
        asked.intake.take("joint", message)
        assert asked.intake._check is not None
        asked.intake._check.join()
    written = capfd.readouterr().err
    assert written.count("trajectory refused") == 2
    assert written.count("joint trajectory with 1 points accepted") == 1
