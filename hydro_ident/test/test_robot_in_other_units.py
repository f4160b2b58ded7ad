"""A URDF in degrees, millimetres or inches is recognised as that: one line, before all others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro_ident.robots.robot_check import ERROR, WARNING, Remark, check_robot
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot, shipped_robots


def scaled(robot: Robot, factor: float) -> Robot:
    """The robot with its links in another unit, its pins in metres as they are."""
    joints = tuple(replace(j, translation_m=factor * j.translation_m) for j in robot.joints)
    return replace(robot, joints=joints, tip_offset_m=factor * robot.tip_offset_m)


def errors(robot: Robot) -> list[Remark]:
    return [r for r in check_robot(robot).remarks if r.level == ERROR]


def test_limits_in_degrees_are_one_error_and_not_a_dead_centre_each_half_turn() -> None:
    robot = load_robot("xs031")
    lift, tilt = robot.joints
    degrees = replace(lift, lower=-3.0, upper=97.0)
    check = check_robot(replace(robot, joints=(degrees, tilt)))
    assert check.remarks[0] == Remark(
        ERROR,
        "lift",
        "limits -3 to 97 rad, more than a turn: in degrees? Those are -0.0524 to 1.69 rad",
    )
    assert [r for r in check.remarks if r.level == ERROR] == [check.remarks[0]]


def test_a_slew_drive_of_several_turns_is_worth_a_look() -> None:
    robot = load_robot("xs031")
    lift, tilt = robot.joints
    free = replace(robot, cylinders=robot.cylinders[:1], valves=robot.valves[:1])
    turning = replace(free, joints=(lift, replace(tilt, lower=-180.0, upper=180.0)))
    assert "tilt" not in {r.about for r in errors(turning)}
    assert any(
        r.level == WARNING and r.about == "tilt" and "in degrees? Those are -3.14" in r.text
        for r in check_robot(turning).remarks
    )
    within = replace(free, joints=(lift, replace(tilt, lower=-2.0 * np.pi, upper=2.0 * np.pi)))
    assert not any("in degrees" in r.text for r in check_robot(within).remarks)


@pytest.mark.parametrize("turn", [6.2832, 6.284, 6.3])
def test_a_full_turn_that_was_rounded_up_is_not_in_degrees(turn: float) -> None:
    robot = load_robot("xs031")
    lift, tilt = robot.joints
    slew = replace(tilt, lower=-turn, upper=turn)
    free = replace(robot, cylinders=robot.cylinders[:1], valves=robot.valves[:1])
    remarks = check_robot(replace(free, joints=(lift, slew))).remarks
    assert not any("in degrees" in r.text for r in remarks)


@pytest.mark.parametrize(
    ("factor", "said"),
    [(1e3, "mm are 3.7"), (1e2, "cm are 3.7"), (1.0 / 0.0254, "inches are 3.7")],
)
def test_links_in_another_unit_are_one_error_first(factor: float, said: str) -> None:
    check = check_robot(scaled(load_robot("xs031"), factor))
    first, *rest = [r for r in check.remarks if r.level == ERROR]
    assert first == check.remarks[0]
    assert first.about == "links"
    assert said in first.text
    assert not [r for r in rest if "gravity" in r.text]


@pytest.mark.parametrize("name", sorted(shipped_robots()))
def test_shipped_robots_are_in_metres_and_radians(name: str) -> None:
    assert not [r for r in check_robot(load_robot(name)).remarks if "another unit?" in r.text]
