"""Parameters of a running bridge: whoever sets one is refused, and nothing changes."""

from __future__ import annotations

from typing import Any

import pytest

from hydro_hw_bridge.node.parameters import PARAMETERS
from hydro_msgs_docs.node_parameters import ParameterRule

pytestmark = pytest.mark.ros
CLEANUP, ACTIVATE, DEACTIVATE = 2, 3, 4
RULES = {rule.name: rule for rule in PARAMETERS}
#: Other values of what every node has, and of the QoS of topics.
OTHER = {bool: True, int: 3, str: "best_effort"}


def another(rule: ParameterRule, now: str | float | int | bool) -> str | float | int | bool:
    """A value that the parameter could have been started with, and was not."""
    if isinstance(now, bool):
        return not now
    if isinstance(now, str):
        return next((choice for choice in rule.choices if choice != now), f"{now}_2")
    return type(now)(rule.lower if rule.lower != now else rule.upper)


class Remote:
    """The parameter services of a bridge."""

    def __init__(self, ros: Any) -> None:
        from rcl_interfaces import srv

        self._ros, self._srv = ros, srv

        def client(kind: Any, name: str) -> Any:
            return ros.node.create_client(kind, f"/can_bridge/{name}_parameters")

        self._list = client(srv.ListParameters, "list")
        self._get = client(srv.GetParameters, "get")
        self._set = client(srv.SetParameters, "set")

    def values(self) -> dict[str, Any]:
        """All that it has, by name."""
        from rclpy.parameter import parameter_value_to_python

        names = self._ros.call(self._list, self._srv.ListParameters.Request()).result.names
        found = self._ros.call(self._get, self._srv.GetParameters.Request(names=names)).values
        return dict(zip(names, map(parameter_value_to_python, found), strict=True))

    def set(self, name: str, value: Any) -> Any:
        """Ask for a change; what is answered."""
        from rclpy.parameter import Parameter

        asked = Parameter(name, value=value).to_parameter_msg()
        request = self._srv.SetParameters.Request(parameters=[asked])
        (result,) = self._ros.call(self._set, request).results
        return result

    def refuses_all(self, before: dict[str, Any]) -> None:
        """Every change is refused, with its reason, and nothing is another afterwards."""
        for name, now in before.items():
            value = another(RULES[name], now) if name in RULES else OTHER[type(now)]
            result = self.set(name, value)
            assert not result.successful, name
            expected = "clean up first" if name == "use_sim_time" else "read-only"
            assert expected in result.reason
        assert self.values() == before


def test_every_parameter_of_a_running_bridge_is_refused(
    ros: Any, device: Any, processes: Any, can_name: str
) -> None:
    remote = Remote(ros)
    ros.bring_up(processes, can_name, "clock:=lockstep")
    device.lockstep = True
    stamp = ros.first_sample(device, 50)
    before = remote.values()
    assert {name: before[name] for name in RULES} == {r.name: r.default for r in PARAMETERS} | {
        "can": can_name,
        "clock": "lockstep",
    }
    # What every node has, and the QoS of its topics.
    assert before["use_sim_time"] is False
    assert "start_type_description_service" in before
    assert any(name.startswith("qos_overrides./joint_states") for name in before)
    remote.refuses_all(before)  # configured
    ros.transition(ACTIVATE)
    ros.send_and_hear(device, 50, stamp)
    assert ros.answer_to(device, stamp, 1.5, -0.5).enable
    remote.refuses_all(before)  # driving
    # The limits are those of before: the same step is legal, the same one is not.
    for counter, volts, enable in ((51, 3.0, True), (52, 7.5, False)):
        at = stamp + (counter - 50) * 2_000_000
        ros.send_and_hear(device, counter, at)
        assert ros.answer_to(device, at, volts, -0.5).enable is enable
    ros.until(lambda: "step of 4.500 V" in ros.diagnosis()["message"])
    for transition in (DEACTIVATE, CLEANUP):
        ros.transition(transition)
    assert remote.set("use_sim_time", True).successful
    assert remote.values() == before | {"use_sim_time": True}
