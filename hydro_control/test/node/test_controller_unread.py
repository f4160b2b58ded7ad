"""Nobody reads the controller's log: it answers, and ends at 0 V, all the same."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("rclpy")

from trajectory_msgs.msg import JointTrajectory

from hydro_msgs_docs import topics

pytestmark = pytest.mark.ros


def test_a_signal_ends_a_controller_whose_log_nobody_reads(
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    full_pipe: int,
    wait_for: Callable[..., bool],
    patience_s: float,
) -> None:
    stops = machine.publisher(topics.JOINT_TRAJECTORY, topics.reliable(1000))
    process = controller(log=full_pipe)
    assert wait_for(lambda: stops.get_subscription_count() == 1)
    # Each is a line of its log, and what it says of itself another.
    for k in range(20):
        stops.publish(JointTrajectory())
        machine.answer(k, machine.pose - 0.02 * (k > 0))
    assert any(machine.commands()[-1].effort)
    process.send_signal(signal.SIGTERM)
    assert process.wait(patience_s) == 0
    assert wait_for(lambda: list(machine.commands()[-1].effort) == [0.0, 0.0])
