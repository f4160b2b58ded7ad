"""The controller process on a clock that steps: `use_sim_time`, and stamps that go back."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hydro_model.motion.paths_segments import Quintic
from hydro_msgs_docs import topics
from hydro_msgs_docs.messages import set_stamp, stamp_ns

pytestmark = pytest.mark.ros
ERROR = b"\x02"
HOUR_S = 3600
PERIOD_S = 0.002
#: The arm's lift, how far and for how long, and how many cycles it waits before.
FROM, TO, LASTS_S, WAITS = 0.6, 0.63, 0.6, 100


class SimTime:
    """A publisher of `/clock`, and what the controller makes of it."""

    def __init__(self, machine: Any, wait_for: Callable[..., bool]) -> None:
        from rosgraph_msgs.msg import Clock

        self._machine, self._wait_for, self._message = machine, wait_for, Clock()
        self._publisher = machine.make(
            lambda: machine.node.create_publisher(Clock, "/clock", topics.reliable())
        )

    def put(self, seconds: int) -> None:
        """Set the clock, and wait until diagnostics are stamped with it: it stands still then."""
        self._message.clock.sec = seconds
        heard = self._machine.heard[topics.DIAGNOSTICS]

        def is_there() -> bool:
            self._publisher.publish(self._message)
            return self._wait_for(lambda: heard and heard[-1].header.stamp.sec == seconds, 0.2)

        assert self._wait_for(is_there), f"no diagnostics of {seconds} s"


def asked(start_ns: int) -> Any:
    from builtin_interfaces.msg import Duration
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    message = JointTrajectory(joint_names=["lift"])
    time = Duration(sec=0, nanosec=round(LASTS_S * 1e9))
    message.points.append(JointTrajectoryPoint(positions=[TO], time_from_start=time))
    set_stamp(message, start_ns)
    return message


def status(machine: Any) -> Any:
    heard = machine.heard[topics.DIAGNOSTICS]
    return heard[-1].status[0] if heard else None


def says(machine: Any, text: str) -> bool:
    return any(text in d.status[0].message for d in list(machine.heard[topics.DIAGNOSTICS]))


def test_steps_of_the_ros_clock_neither_move_nor_hasten_nor_restart_a_motion(
    machine: Any, controller: Callable[..., subprocess.Popen[str]], wait_for: Callable[..., bool]
) -> None:
    controller("use_sim_time:=true")
    time = SimTime(machine, wait_for)
    publisher = machine.publisher(topics.JOINT_TRAJECTORY, topics.reliable())
    assert wait_for(lambda: publisher.get_subscription_count() == 1)
    zero_ns = stamp_ns(machine.answer(0))
    now_s = zero_ns // 1_000_000_000
    time.put(now_s)
    # Somebody whose clock has stepped meanwhile means to begin in two seconds.
    publisher.publish(asked(zero_ns + (HOUR_S + 2) * 1_000_000_000))
    refused = "should start within 10 s of the newest sample, found 3602.000 s ahead"
    assert wait_for(lambda: says(machine, refused))
    publisher.publish(asked(zero_ns + round(WAITS * PERIOD_S * 1e9)))
    assert wait_for(lambda: not status(machine).message.startswith("trajectory refused"))
    steps = {50: HOUR_S, 200: -900, 300: 0}  # while it waits, and twice while it runs
    last = WAITS + round(LASTS_S / PERIOD_S) + 50
    for cycle in range(1, last):
        if cycle in steps:
            time.put(now_s + steps[cycle])
        machine.answer(cycle)
    references = machine.heard[topics.JOINT_REFERENCE]
    assert wait_for(lambda: stamp_ns(references[-1]) == zero_ns + (last - 1) * 2_000_000)
    found = {(stamp_ns(r) - zero_ns) // 2_000_000: r.position[0] for r in references}
    assert sorted(found) == list(range(last))
    lift = np.array([found[cycle] for cycle in range(last)])
    motion = Quintic.at_rest([FROM], [TO], LASTS_S)
    times = (np.arange(last) - WAITS) * PERIOD_S
    expected = [motion.sample(min(max(t, 0.0), LASTS_S))[0][0] for t in times]
    np.testing.assert_allclose(lift, expected, atol=1e-9)


def test_stamps_that_go_back_end_in_an_error_until_activated_anew(
    machine: Any, controller: Callable[..., subprocess.Popen[str]], wait_for: Callable[..., bool]
) -> None:
    controller()
    for cycle in range(3):
        machine.answer(cycle)
    back = 2 - round(HOUR_S / PERIOD_S)

    def told() -> bool:
        machine.publish(back)
        return wait_for(lambda: says(machine, "stamps went back by 3600.000 s"), 0.2)

    assert wait_for(told)
    assert status(machine).level == ERROR
    answered = len(machine.commands())
    machine.publish(3)
    assert not wait_for(lambda: len(machine.commands()) > answered, 0.5)
    for transition in ("deactivate", "activate"):
        machine.transition(transition)
    machine.answer(back + 1)
    assert wait_for(lambda: status(machine).message == "holding")
