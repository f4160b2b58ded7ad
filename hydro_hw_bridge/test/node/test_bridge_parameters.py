"""Parameters of a running bridge: whoever sets one is refused, and nothing changes."""

from __future__ import annotations

from typing import Any

import pytest

from hydro_hw_bridge.parameters import PARAMETERS, ParameterRule

pytestmark = pytest.mark.ros
ACTIVATE = 3


def another(rule: ParameterRule, now: str | float | int | bool) -> str | float | int | bool:
    """A value that the parameter could have been started with, and was not."""
    if isinstance(now, bool):
        return not now
    if isinstance(now, str):
        return next((choice for choice in rule.choices if choice != now), f"{now}_2")
    assert rule.low is not None
    assert rule.high is not None
    return type(now)(rule.low if rule.low != now else rule.high)


def test_every_parameter_of_a_running_bridge_is_refused(
    ros: Any, device: Any, processes: Any, can_name: str
) -> None:
    from rcl_interfaces.srv import GetParameters, SetParameters
    from rclpy.parameter import Parameter, parameter_value_to_python

    names = [rule.name for rule in PARAMETERS]
    setting = ros.node.create_client(SetParameters, "/can_bridge/set_parameters")
    getting = ros.node.create_client(GetParameters, "/can_bridge/get_parameters")

    def values() -> dict[str, Any]:
        found = ros.call(getting, GetParameters.Request(names=names)).values
        return dict(zip(names, map(parameter_value_to_python, found), strict=True))

    def refused() -> None:
        for rule in PARAMETERS:
            value = another(rule, before[rule.name])
            asked = Parameter(rule.name, value=value).to_parameter_msg()
            (result,) = ros.call(setting, SetParameters.Request(parameters=[asked])).results
            assert not result.successful, rule.name
            assert "read-only" in result.reason

    ros.bring_up(processes, can_name, "clock:=lockstep")
    device.lockstep = True
    stamp = ros.first_sample(device, 50)
    before = values()
    assert before == {rule.name: rule.default for rule in PARAMETERS} | {
        "can": can_name,
        "clock": "lockstep",
    }
    refused()  # configured
    ros.transition(ACTIVATE)
    ros.send_and_hear(device, 50, stamp)
    assert ros.answer_to(device, stamp, 1.5, -0.5).enable
    refused()  # driving
    assert values() == before
    # The limits are those of before: the same step is legal, the same one is not.
    for counter, volts, enable in ((51, 3.0, True), (52, 7.5, False)):
        at = stamp + (counter - 50) * 2_000_000
        ros.send_and_hear(device, counter, at)
        assert ros.answer_to(device, at, volts, -0.5).enable is enable
    ros.until(lambda: "step of 4.500 V" in ros.diagnosis()["message"])
