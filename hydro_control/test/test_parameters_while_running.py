"""Parameters of a configured controller: a change is refused, whatever it is."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")

from rclpy.parameter import Parameter  # noqa: E402

from hydro_control.controller_node import ControllerNode  # noqa: E402
from hydro_control.parameters import PARAMETERS  # noqa: E402

pytestmark = pytest.mark.ros
DOMAIN = 10 + (os.getpid() + 60) % 90


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setitem(os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(domain_id=DOMAIN)
    node = ControllerNode()
    yield node
    node.close()
    rclpy.try_shutdown()


def test_every_parameter_is_refused_once_configured_and_taken_again_after_cleanup(
    node: Any,
) -> None:
    node.trigger_configure()
    for rule in PARAMETERS:
        before = node.get_parameter(rule.name).value
        result = node.set_parameters([Parameter(rule.name, value=rule.default)])[0]
        assert not result.successful, rule.name
        assert "clean up first" in result.reason
        assert node.get_parameter(rule.name).value == before
    node.trigger_cleanup()
    assert node.set_parameters([Parameter("k_v", value=1.0)])[0].successful
