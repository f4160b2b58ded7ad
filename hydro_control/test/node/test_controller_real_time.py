"""Real-time options of the controller: asked for, refused, and what the loop says about time."""

from __future__ import annotations

import gc
import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.core.motion_requests import MotionRequests
from hydro_control.gains import Gains
from hydro_msgs_docs import topics

rclpy = pytest.importorskip("rclpy")
from trajectory_msgs.msg import JointTrajectory  # noqa: E402
from trajectory_msgs.msg import JointTrajectoryPoint as Point  # noqa: E402

from hydro_control.core import winding_down  # noqa: E402
from hydro_control.node.hot_path import HotPath  # noqa: E402
from hydro_control.node.trajectory_intake import TrajectoryIntake  # noqa: E402
from hydro_msgs_docs.real_time import RealTime, RealTimeOptions  # noqa: E402

pytestmark = pytest.mark.ros
DOMAIN = 10 + (os.getpid() + 30) % 90


def values_of(machine: Any) -> dict[str, str]:
    heard = machine.heard[topics.DIAGNOSTICS]
    return {v.key: v.value for v in heard[-1].status[0].values} if heard else {}


def test_without_the_rights_it_warns_and_answers(
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    wait_for: Callable[..., bool],
    without_rights: list[str],
) -> None:
    process = controller(
        "rt_priority:=40", "lock_memory:=true", "cpu_affinity:='4000'", before=without_rights
    )
    for k in range(20):
        machine.answer(k)
    refused = {"memory lock", "SCHED_FIFO 40", "core 4000"}
    assert wait_for(
        lambda: set(values_of(machine).get("real_time_refused", "").split("; ")) == refused
    )
    assert values_of(machine)["real_time"] == "off"
    process.terminate()
    out, error = process.communicate(timeout=60.0)
    for name in refused:
        assert (out + error).count(f"{name} refused, going on without: ") == 1
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        ("rt_priority:=99", "parameter rt_priority should be an integer from 0 to 98, found 99"),
        ("lock_memory:=2", "parameter lock_memory should be true or false, found 2"),
        ("cpu_affinity:='2 to 4'", "parameter 'cpu_affinity' should be cores such as '2 4-5'"),
    ],
)
def test_values_that_cannot_be_are_refused_at_start(
    within: Callable[..., subprocess.CompletedProcess[str]], parameter: str, text: str
) -> None:
    ended = within("-p", parameter)
    assert ended.returncode == 2
    assert text in ended.stderr


@pytest.fixture
def fifo() -> Iterator[None]:
    """The test's thread before all ordinary programs, as the node's are by `rt_priority`."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except OSError as error:
        pytest.skip(f"no right to SCHED_FIFO here: {error.strerror}")
    yield
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def test_a_trajectory_is_checked_behind_all_that_has_a_priority(
    fifo: None, wait_for: Callable[..., bool]
) -> None:
    seen: list[int] = []
    requests = SimpleNamespace(
        standing=SimpleNamespace(overtaken=False),
        trajectory=lambda *_: seen.append(os.sched_getscheduler(0)),
    )
    core: Any = SimpleNamespace(requests=requests)
    log: Any = SimpleNamespace(info=print, error=print)
    TrajectoryIntake(core, lambda: True, log).take("joint", JointTrajectory(points=[Point()]))
    assert wait_for(lambda: seen == [os.SCHED_OTHER])


def test_so_is_the_path_that_waits(
    node: Any, monkeypatch: pytest.MonkeyPatch, fifo: None, wait_for: Callable[..., bool]
) -> None:
    seen: list[int] = []
    monkeypatch.setattr(ControllerCore, "path_waits", True)
    monkeypatch.setattr(
        MotionRequests,
        "check_waiting_path",
        lambda _: seen.append(os.sched_getscheduler(0)),
    )
    monkeypatch.setattr(node, "_active", True)
    node._check_waiting_path()
    assert wait_for(lambda: seen == [os.SCHED_OTHER])


class BlockedCore(ControllerCore):
    """A controller whose law takes until it is let go, at the sixth sample."""

    go: threading.Event
    collecting: list[bool]

    def answer(self, sample: Sample) -> Answer | None:
        self.collecting.append(gc.isenabled())
        if self.counts.answered == 5:
            assert self.go.wait(60.0)
        return super().answer(sample)


def test_a_blocked_loop_counts_late_cycles_and_collects_no_garbage_meanwhile(
    machine: Any, wait_for: Callable[..., bool]
) -> None:
    node = rclpy.create_node("hot", context=machine.context)
    core = BlockedCore(machine.robot, Gains())
    core.go, core.collecting = threading.Event(), []
    measures = RealTime(RealTimeOptions(), print)
    hot = HotPath(node, core, 0, measures, lambda error: None)
    measures.prepare()
    hot.start()
    try:
        for k in range(5):
            machine.answer(k)
        before = hot.times.late_cycles
        blocked = machine.publish(5)
        assert wait_for(lambda: len(core.collecting) > 5 and hot.times.work.worst_ns > 0)
        for k in range(6, 9):
            machine.publish(k)
        time.sleep(0.2)  # a hundred periods
        core.go.set()
        assert wait_for(lambda: core.last is not None and core.last.stamp_ns > blocked)
        assert wait_for(lambda: hot.times.late_cycles >= before + 3)
        assert hot.times.lateness.worst_ns > 150_000_000
        assert wait_for(lambda: hot.times.work.worst_ns > 150_000_000)
    finally:
        core.go.set()
        hot.stop()
        measures.leave()
        hot.destroy()
        node.destroy_node()
    assert not any(core.collecting)
    assert gc.isenabled()


class HeldCore(ControllerCore):
    """A controller whose law takes until it is let go, once it is told to."""

    hold: bool
    held: threading.Event
    go: threading.Event

    def answer(self, sample: Sample) -> Answer | None:
        if self.hold:
            self.held.set()
            assert self.go.wait(60.0)
        return super().answer(sample)


def test_an_end_that_falls_into_a_cycle_is_on_a_ramp_as_well(
    machine: Any, monkeypatch: pytest.MonkeyPatch, patience_s: float
) -> None:
    for name in ("LAST_SAMPLE_S", "RAMP_S"):
        monkeypatch.setattr(winding_down, name, patience_s)
    node = rclpy.create_node("hot", context=machine.context)
    core = HeldCore(machine.robot, replace(Gains(), slew_limit_v_s=100.0))
    core.hold, core.held, core.go = False, threading.Event(), threading.Event()
    hot = HotPath(node, core, 0, RealTime(RealTimeOptions(), print), lambda error: None)
    hot.start()
    cycle, away = 0, machine.pose - 0.05
    while abs(machine.answer(cycle, away if cycle else machine.pose).effort[0]) < 1.0:
        cycle += 1
    core.hold = True
    cycle, before = cycle + 1, len(machine.commands())
    held = machine.publish(cycle, away)
    ending = threading.Thread(target=hot.stop)
    try:
        assert core.held.wait(patience_s)
        ending.start()
        time.sleep(0.2)  # it has asked, and waits for the cycle to end
    finally:
        core.go.set()
    assert machine.commands_of(held, before, patience_s)
    time.sleep(0.1)  # no sample is there yet when the way down begins
    while ending.is_alive():
        cycle += 1
        before, stamp = len(machine.commands()), machine.publish(cycle, away)
        machine.commands_of(stamp, before, 0.2)
    hot.destroy()
    node.destroy_node()
    voltage = np.array([c.effort for c in machine.commands()])
    assert np.abs(np.diff(voltage, axis=0)).max() <= 0.2 + 1e-9
    assert voltage[-1].tolist() == [0.0, 0.0]
