"""A bridge whose ROS clock steps while it drives: stamps and voltages stay as they are."""

from __future__ import annotations

from typing import Any

import pytest

pytestmark = pytest.mark.ros
ACTIVATE = 3
PERIOD_NS = 2_000_000
SECOND_NS = 1_000_000_000


class SimTime:
    """A publisher of `/clock`."""

    def __init__(self, ros: Any) -> None:
        from rosgraph_msgs.msg import Clock

        self._ros, self._message = ros, Clock()
        self._publisher = ros.node.create_publisher(Clock, "/clock", 1)

    def put(self, seconds: int) -> None:
        """Set the clock, and wait until the bridge stamps its diagnostics with it."""
        self._message.clock.sec = seconds
        heard = self._ros.heard["/diagnostics"]

        def is_there() -> bool:
            self._publisher.publish(self._message)
            return bool(heard) and heard[-1].header.stamp.sec == seconds

        self._ros.until(is_there)


def test_a_clock_that_steps_changes_neither_stamps_nor_voltages(
    ros: Any, device: Any, processes: Any, can_name: str
) -> None:
    time = SimTime(ros)
    ros.bring_up(processes, can_name, "clock:=lockstep", "use_sim_time:=true")
    time.put(5000)
    device.lockstep = True
    stamp = ros.first_sample(device, 50)
    assert 4999 * SECOND_NS < stamp <= 5000 * SECOND_NS
    ros.transition(ACTIVATE)
    ros.send_and_hear(device, 50, stamp)
    assert ros.answer_to(device, stamp, 1.5, -0.5).enable
    for counter, clock_s in ((51, 8600), (52, 1400), (53, 5000)):
        time.put(clock_s)
        at = stamp + (counter - 50) * PERIOD_NS
        ros.send_and_hear(device, counter, at)
        answer = ros.answer_to(device, at, 1.5, -0.5)
        assert answer.enable
        assert answer.voltages == pytest.approx((1.5, -0.5), abs=1e-3)
    assert ros.diagnosis()["trip_reason"] == ""
