"""A second `can_bridge` in the ROS domain, on a bus of its own: neither drives for both."""

from __future__ import annotations

import time
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")

pytestmark = pytest.mark.ros

CONFIGURE, ACTIVATE = 1, 3
PATIENCE_S = 120.0


def test_a_bridge_beside_another_is_neither_configured_activated_nor_cleared(
    ros: Any, processes: Any, can_name: str
) -> None:
    def seen() -> int:
        names = ros.node.get_node_names()
        return int(names.count("can_bridge"))

    ros.bring_up(processes, can_name, "robot:=xs031")
    other = rclpy.create_node("can_bridge", context=ros.context)
    ros.until(lambda: seen() == 2)
    said = ros.clear()
    assert not said.success
    assert "2 nodes are called /can_bridge in ROS domain" in said.message
    assert not ros.tried(ACTIVATE)
    other.destroy_node()
    ros.until(lambda: seen() == 1)
    # The bridge hears of it by itself, soon.
    ros.until(lambda: "2 nodes" not in ros.clear().message)
    ros.transition(ACTIVATE)


def test_nor_is_one_that_comes_up_beside_another(ros: Any, processes: Any, can_name: str) -> None:
    other = rclpy.create_node("can_bridge", context=ros.context)
    processes.start(can_name, "robot:=xs031")
    assert ros.change_state.wait_for_service(PATIENCE_S)
    time.sleep(2.0)  # until the two know one another: nothing tells from outside that they do
    assert not ros.tried(CONFIGURE)
    other.destroy_node()
    ros.until(lambda: ros.tried(CONFIGURE))
    processes.until_said("configure: 2 nodes are called /can_bridge")
