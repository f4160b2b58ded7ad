"""What the controller does with a fault of its watch: 0 V until it is begun anew."""

from __future__ import annotations

import numpy as np
import pytest

from hydro_control.core.core import ControllerCore, Sample
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.motion.motion_limits import limits_of
from hydro_control.motion.trajectory import Waypoint
from hydro_model.robot_files import load_robot

ROBOT = load_robot("xs031")
LIMITS = limits_of(ROBOT)
MIDDLE = np.array([0.8, -1.2])


def test_the_fault_is_latched_until_the_controller_begins_anew() -> None:
    core = ControllerCore(ROBOT, Gains())
    pressure = np.full(2, 8e6)
    where = [*[MIDDLE] * 5, *[LIMITS.upper + 0.06] * 5, *[MIDDLE] * 20]
    said = []
    for k, q in enumerate(where):
        answer = core.answer(Sample(10**18 + k * 2_000_000, q, pressure, pressure, 19e6, 1e6))
        assert answer is not None
        said.append(answer.output.fault)
        assert not said[-1] or not np.any(answer.output.voltage_v)
    assert not any(said[:7])
    assert said[7]
    assert set(said[7:]) == {said[7]}
    assert core.counts.faults == len(where) - 7
    point = Waypoint(4.0, MIDDLE + 0.1, np.empty(0), np.empty(0))
    with pytest.raises(ControlError, match="the controller stopped: joint 'lift'"):
        core.requests.trajectory("joint", ROBOT.joint_names, [point])
    core.restart()
    answer = core.answer(Sample(2 * 10**18, MIDDLE, pressure, pressure, 19e6, 1e6))
    assert answer is not None
    assert not answer.output.fault
    core.requests.trajectory("joint", ROBOT.joint_names, [point])
