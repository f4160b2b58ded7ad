"""Real-time options of the bridge: asked for, refused, and what it says about time."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.ros

ACTIVATE = 3


def test_without_the_rights_it_warns_and_drives(
    ros: Any, device: Any, processes: Any, can_name: str, without_rights: list[str]
) -> None:
    options = ("rt_priority:=40", "lock_memory:=true", "cpu_affinity:='4000'")
    ros.bring_up(processes, can_name, "clock:=lockstep", *options, before=without_rights)
    device.lockstep = True
    stamp = ros.first_sample(device, 50)
    ros.transition(ACTIVATE)
    assert ros.answer_to(device, stamp, 1.5, -0.5).voltages == (1.5, -0.5)
    ros.until(lambda: int(ros.diagnosis()["answer_worst_us"]) > 0)
    said = ros.diagnosis()
    refused = {"memory lock", "SCHED_FIFO 40", "core 4000"}
    assert set(said["real_time_refused"].split("; ")) == refused
    assert said["real_time"] == "off"
    log = [processes.until_said(f"{name} refused") for name in refused][-1]
    for name in refused:
        assert log.count(f"{name} refused, going on without: ") == 1
    # Machine time stands still in lockstep: nothing is late.
    assert "late_cycles" not in said
    assert int(said["loop_worst_us"]) > 0


def test_samples_that_come_a_while_after_they_are_due_are_late(
    ros: Any, device: Any, processes: Any, can_name: str
) -> None:
    ros.bring_up(processes, can_name)
    ros.first_sample(device, 50)
    # The counter says 2 ms, the wall clock says at least 20 ms.
    for counter in range(51, 61):
        heard = len(ros.heard["/joint_states"])
        time.sleep(0.02)
        device.send(counter)
        ros.until(lambda count=heard: len(ros.heard["/joint_states"]) > count)
    ros.until(lambda: int(ros.diagnosis()["late_cycles"]) > 0)
    assert int(ros.diagnosis()["lateness_worst_us"]) > 2000


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        ("rt_priority:=99", "rt_priority"),
        ("lock_memory:=2", "lock_memory"),
        ("cpu_affinity:='2 to 4'", "parameter 'cpu_affinity' should be cores such as '2 4-5'"),
    ],
)
def test_values_that_cannot_be_are_refused_at_start(
    within: Callable[..., subprocess.CompletedProcess[str]],
    can_name: str,
    parameter: str,
    text: str,
) -> None:
    ended = within(can_name, parameter)
    assert ended.returncode == 2
    assert text in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1
