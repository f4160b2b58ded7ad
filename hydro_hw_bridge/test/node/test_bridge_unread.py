"""Nobody reads the bridge's log: it drives, answers and ends all the same."""

from __future__ import annotations

import signal
from typing import Any

import pytest

pytest.importorskip("rclpy")

pytestmark = pytest.mark.ros

CONFIGURE, ACTIVATE = 1, 3


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_bridge_whose_log_nobody_reads(
    number: signal.Signals, ros: Any, processes: Any, device: Any, can_name: str, full_pipe: int
) -> None:
    ros.bring_up(processes, can_name, "robot:=xs031", log=full_pipe)
    stamp = ros.first_sample(device, 0)
    ros.transition(ACTIVATE)
    # Each is a line of its log, told in the thread that serves it.
    for _ in range(20):
        assert ros.clear().success
    assert ros.answer_to(device, stamp, 0.0, 0.0).enable
    processes[0].send_signal(number)
    last = device.answer()
    while (frame := device.next_command(1.0)) is not None:
        last = frame
    assert not last.enable
    assert processes.wait(0) == 0
