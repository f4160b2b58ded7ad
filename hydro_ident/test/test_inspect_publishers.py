"""Inspections of bags in which others publish on `/joint_states`, too: cycles are the robot's."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_ident.bag.recording import read_recording
from hydro_ident.bag.writer import BagWriter
from hydro_ident.inspecting.inspection import ranges_of
from hydro_ident.inspecting.inspection_reading import inspect_bag
from hydro_model.robot import Robot
from hydro_msgs_docs.cdr import JOINT_STATE
from hydro_msgs_docs.topics import JOINT_STATES

N = 600
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 2_000_000


def written(path: Path, robot: Robot, order: Iterable[tuple[bool, int]]) -> Path:
    """Messages of the robot (True) and of a gripper, each at a cycle's stamp, in this order."""
    q = np.array([0.8, -1.2]) + 0.1 * np.random.default_rng(1).normal(size=(N, 2))
    with BagWriter(path, {"robot": robot.name}) as bag:
        bag.add_topic(JOINT_STATES, JOINT_STATE)
        for arm, k in order:
            names, position = (robot.joint_names, q[k]) if arm else (("gripper",), [1e-3 * k])
            stamp_ns = START_NS + PERIOD_NS * k
            bag.write_stamped(JOINT_STATES, stamp_ns, {"position": position}, names=names)
    return path


def _gripper_first() -> list[tuple[bool, int]]:
    return [one for k in range(N) for one in ((False, k), (True, k))]


def _gripper_ahead() -> list[tuple[bool, int]]:
    """By ten cycles: it is in another stretch."""
    pairs = ([(False, k + 10)] * (k + 10 < N) + [(True, k)] for k in range(N))
    return [one for pair in pairs for one in pair]


def _arm_pauses() -> list[tuple[bool, int]]:
    """While the gripper goes on, for longer than a stretch."""
    return [one for one in _gripper_first() if not (one[0] and 200 <= one[1] < 400)]


def _arm_begins_late() -> list[tuple[bool, int]]:
    return [one for one in _gripper_first() if not (one[0] and one[1] < 300)]


@pytest.mark.parametrize("cut", [(1 << 16, 1 << 40, 2.0), (20, 40, 0.03)])
@pytest.mark.parametrize(
    ("order", "cycles", "again", "disordered"),
    [
        (_gripper_first, N, 0, 0),
        (_gripper_ahead, N, 0, 10),
        (_arm_pauses, N - 200, 0, 0),
        (_arm_begins_late, N - 300, 0, 0),
    ],
)
def test_a_gripper_with_the_arms_stamps_costs_no_cycle_and_makes_none(
    tmp_path: Path, robot, small_blocks, known, order: Any, cycles: int, again: int,
    disordered: int, cut: tuple[int, int, float],
) -> None:  # fmt: skip
    path = written(tmp_path / "bag", robot, order())
    block, rows, late_s = cut
    small_blocks(block)
    said = inspect_bag(path, robot, rows=rows, late_s=late_s)
    assert not any(one.whole for one in known)
    read = read_recording(path, robot)
    assert said.cycles == len(read) == cycles
    assert said.ranges == ranges_of(read)
    assert (said.duration_s, said.rate_hz) == (read.duration_s, 1.0 / read.period_s)
    [topic] = said.topics
    assert (topic.duplicates, topic.disordered) == (again, disordered)


def test_a_bag_of_a_gripper_alone_is_no_recording_of_the_robot(tmp_path: Path, robot) -> None:
    path = written(tmp_path / "bag", robot, [(False, k) for k in range(N)])
    assert inspect_bag(path, robot).cycles == 0
