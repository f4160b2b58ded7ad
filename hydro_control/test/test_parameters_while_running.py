"""Parameters of a controller: refused while it is configured, taken within their ranges before."""

from __future__ import annotations

import gc
import math
import os
from collections.abc import Iterator
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")

from rclpy.lifecycle import TransitionCallbackReturn  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from hydro_control.node.controller_node import ControllerNode  # noqa: E402
from hydro_control.node.parameters import PARAMETERS  # noqa: E402
from hydro_msgs_docs.node_parameters import ParameterRule, Value  # noqa: E402

pytestmark = pytest.mark.ros
DOMAIN = 10 + (os.getpid() + 60) % 90
#: Texts that a configured controller could use.
TEXTS = {
    "robot": "patu655",
    "path": "xs031/parallelogram",
    "adaptation": "payload, friction",
    "cpu_affinity": "0",
}
#: Another value for an inherited parameter of a type.
OTHER: dict[type, Value] = {bool: True, int: 3, str: "best_effort"}


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setitem(os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    gc.collect()  # the node of the test before is in its domain until then
    rclpy.init(domain_id=DOMAIN)
    node = ControllerNode()
    yield node
    node.close()
    rclpy.try_shutdown()


def others(rule: ParameterRule) -> list[Value]:
    """Legal values that are not the default: of a number both ends of its range."""
    if isinstance(rule.default, str):
        return [TEXTS[rule.name]]
    if isinstance(rule.default, bool):
        return [not rule.default]
    kind = type(rule.default)
    ends: list[Value] = [kind(rule.lower), kind(rule.upper)]
    return [value for value in ends if value != rule.default]


def illegal(rule: ParameterRule) -> list[Value]:
    """Just outside the range, not finite, or of another type."""
    if isinstance(rule.default, str | bool):
        return [1.5]
    if isinstance(rule.default, int):
        return [int(rule.lower) - 1, int(rule.upper) + 1, "1"]
    step = 1e-3 * (rule.upper - rule.lower)
    beyond = [rule.lower - step, rule.upper + step, math.inf, -math.inf, math.nan]
    return [*beyond, int(rule.upper), "1"]


def inherited(node: Any) -> dict[str, Any]:
    """Parameters that every node of rclpy has and those of its topics' QoS, by name."""
    own = {rule.name for rule in PARAMETERS}
    return {name: value for name, value in node._parameters.items() if name not in own}


def taken(node: Any, name: str, value: Value) -> bool:
    """Whether a value was accepted; the node has it then, and what it had before else."""
    before = node.get_parameter(name).value
    result = node.set_parameters([Parameter(name, value=value)])[0]
    assert node.get_parameter(name).value == (value if result.successful else before)
    assert result.successful or result.reason
    return bool(result.successful)


@pytest.mark.parametrize("active", [False, True])
def test_every_parameter_is_refused_once_configured_and_taken_again_after_cleanup(
    node: Any, active: bool
) -> None:
    node.trigger_configure()
    if active:
        node.trigger_activate()
    for rule in PARAMETERS:
        for value in (rule.default, *others(rule), *illegal(rule)):
            assert not taken(node, rule.name, value), (rule.name, value)
        refused = node.set_parameters([Parameter(rule.name, value=others(rule)[0])])[0]
        assert "clean up first" in refused.reason
        assert node.get_parameter(rule.name).value == rule.default
    if active:
        node.trigger_deactivate()
    node.trigger_cleanup()
    for rule in PARAMETERS:
        assert taken(node, rule.name, others(rule)[0]), rule.name


@pytest.mark.parametrize("active", [False, True])
def test_what_every_node_has_is_refused_once_configured_too(node: Any, active: bool) -> None:
    node.trigger_configure()
    if active:
        node.trigger_activate()
    before = inherited(node)
    assert before["use_sim_time"].value is False
    assert "start_type_description_service" in before
    assert any(name.startswith("qos_overrides./joint_trajectory") for name in before)
    for name, parameter in before.items():
        for value in (parameter.value, OTHER[type(parameter.value)], None):
            asked = Parameter(name, value=value)
            for result in (*node.set_parameters([asked]), node.set_parameters_atomically([asked])):
                assert not result.successful, (name, value)
                assert result.reason
    assert inherited(node) == before
    together = [Parameter("use_sim_time", value=True), Parameter("k_v", value=1.0)]
    assert "clean up first" in node.set_parameters_atomically(together).reason
    assert not node.get_clock().ros_time_is_active


def test_use_sim_time_is_taken_while_unconfigured(node: Any) -> None:
    assert taken(node, "use_sim_time", True)
    node.trigger_configure()
    assert not taken(node, "use_sim_time", False)
    assert node.get_clock().ros_time_is_active
    node.trigger_cleanup()
    assert taken(node, "use_sim_time", False)
    assert not node.get_clock().ros_time_is_active
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS


def test_before_it_is_configured_every_value_in_range_is_taken_and_no_other(node: Any) -> None:
    for rule in PARAMETERS:
        for value in (*others(rule), rule.default):
            assert taken(node, rule.name, value), (rule.name, value)
        for value in illegal(rule):
            assert not taken(node, rule.name, value), (rule.name, value)


def test_what_was_set_before_is_what_the_configured_controller_has(node: Any) -> None:
    given: dict[str, Value] = {
        "k_p_1_s": 11.0,
        "slew_limit_v_s": 250.0,
        "tip_speed_limit_m_s": 0.4,
        "fault_end_share": 0.03,
        "fault_speed_factor": 2.5,
        "adaptation": "payload",
    }
    for name, value in given.items():
        assert taken(node, name, value)
    node.trigger_configure()
    core = node._core
    assert (core.gains.k_p_1_s, core.gains.slew_limit_v_s) == (11.0, 250.0)
    assert core.law.limits.tip_speed_m_s == 0.4
    assert (core.runaway.end_share, core.runaway.speed_factor) == (0.03, 2.5)
    assert core.law.adaptation is not None
