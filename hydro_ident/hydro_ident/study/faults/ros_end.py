"""The ROS end of the campaign: a publisher of commands, lifecycle, trips and diagnostics."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from hydro_hw_bridge.faults.command_faults import CommandFault, Publisher
from hydro_hw_bridge.faults.wave import Wave
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.bridge_step import Sample
from hydro_hw_bridge.protocol.frames import Readings, Status
from hydro_ident.errors import IdentError
from hydro_msgs_docs import topics
from hydro_msgs_docs.messages import joint_state, stamp_ns

CALL_S = 20.0
PATIENCE_S, ASK_S = 90.0, 2.0
CONFIGURE, ACTIVATE = 1, 3
#: States after transitions.
AFTER = {CONFIGURE: "inactive", ACTIVATE: "active"}
_NOTHING = Readings(0, Status(), (), (), ())


class RosEnd:
    """A node with everything that the campaign asks of bridge and controller.

    Parameters
    ----------
    limits : GateLimits

    Attributes
    ----------
    publishing : bool
        Whether samples are answered.
    """

    def __init__(self, limits: GateLimits) -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.executors import SingleThreadedExecutor
        from sensor_msgs.msg import JointState
        from std_srvs.srv import Trigger

        self._context = rclpy.Context()
        self._context.init()
        self.node = rclpy.create_node("fault_campaign", context=self._context)
        self._limits = limits
        self._period_ns = round(1e9 * limits.period_s)
        self._wave = self._new_wave()
        self._publisher = Publisher((), self._period_ns)
        self._count = 0
        self.fault_at_ns: int | None = None
        self._fault: CommandFault | None = None
        self.publishing = False
        self.diagnosis: dict[str, dict[str, str]] = {}
        make, reliable = self.node.create_subscription, topics.reliable()
        make(JointState, topics.CHAMBER_PRESSURES, self._on_sample, reliable)
        make(DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, reliable)
        self.command = self.node.create_publisher(JointState, topics.VALVE_COMMAND, reliable)
        self._trip = self.node.create_client(Trigger, "/can_bridge/clear_trip")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def _new_wave(self) -> Wave:
        limits = self._limits
        return Wave(
            limits.valve_names,
            limits.rated_voltage_v,
            limits.legal_step_v,
            frequency_hz=2.0,
            period_s=limits.period_s,
        )

    def _on_sample(self, message: Any) -> None:
        if not self.publishing:
            return
        self._count += 1
        stamp = stamp_ns(message)
        counter = stamp // self._period_ns
        command = self._wave.answer(Sample(stamp, counter, _NOTHING, False))
        fault = self._fault
        if fault is not None and self.fault_at_ns is None and fault.acts(self._count):
            self.fault_at_ns = time.monotonic_ns()
        sent = self._publisher.due(self._count) + self._publisher.take(command, self._count)
        for one in sent:
            message = joint_state(one.stamp_ns, one.names)
            message.effort = list(one.voltages)
            self.command.publish(message)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            values = {v.key: v.value for v in status.values}
            self.diagnosis[status.name] = values | {"message": status.message}

    def begin_fault(self, kind: str, cycles: int, amount: float, valve: int) -> None:
        """Let a fault of the publisher begin with the next sample but one.

        It lasts for so many `cycles`; `amount` is its size in its kind's unit, `valve` the index
        of the one that it concerns.
        """
        self.fault_at_ns = None
        self._fault = CommandFault(kind, self._count + 2, cycles, amount, valve)
        self._publisher = Publisher([self._fault], self._period_ns)

    def end_fault(self) -> None:
        """Publish soundly again, from 0 V on."""
        self._fault = None
        self._publisher = Publisher((), self._period_ns)
        self._wave.restart()

    def call(self, client: Any, request: Any, wait_s: float = CALL_S) -> Any:
        """Call a service.

        `client` is that of the service, `request` its message.

        Raises
        ------
        IdentError
            It is not there, or does not answer.
        """
        if not client.wait_for_service(CALL_S):
            raise IdentError(f"expected the service {client.srv_name}, found none")
        return _result(client.call_async(request), wait_s, client.srv_name)

    def _there(self, do: Callable[[], Any]) -> Any:
        """What a call gives, called where the node spins: rclpy's wait set takes no others."""
        return _result(self._executor.create_task(do), CALL_S, "the campaign's own node")

    def _client(self, kind: Any, name: str) -> Any:
        return self._there(lambda: self.node.create_client(kind, name))

    def transition(self, node: str, number: int) -> bool:
        """Take a node through a transition; whether it got there.

        One that was just killed may still be seen for a while, and take a call with it.
        """
        from lifecycle_msgs.srv import ChangeState, GetState

        state = self._client(GetState, f"/{node}/get_state")
        change = self._client(ChangeState, f"/{node}/change_state")
        request = ChangeState.Request()
        request.transition.id = number
        end = time.monotonic() + PATIENCE_S
        there = False
        while not there and time.monotonic() < end:
            try:
                label = self.call(state, GetState.Request(), ASK_S).current_state.label
                there = label == AFTER[number]
                if not there:
                    there = bool(self.call(change, request).success)
            except IdentError:
                continue
        self._there(lambda: self.node.destroy_client(state))
        self._there(lambda: self.node.destroy_client(change))
        return there

    def clear_trip(self) -> tuple[bool, str]:
        """Clear the bridge's trip; whether that was done, and what it said."""
        from std_srvs.srv import Trigger

        answer = self.call(self._trip, Trigger.Request())
        return bool(answer.success), str(answer.message)

    def set_parameter(self, node: str, name: str, value: float) -> bool:
        """Try to set a parameter of a running node; whether it was taken."""
        from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
        from rcl_interfaces.srv import SetParameters

        client = self._client(SetParameters, f"/{node}/set_parameters")
        number = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        request = SetParameters.Request(parameters=[Parameter(name=name, value=number)])
        taken = bool(self.call(client, request).results[0].successful)
        self._there(lambda: self.node.destroy_client(client))
        return taken

    def close(self) -> None:
        """End."""
        self.publishing = False
        self._executor.shutdown()
        self._thread.join(2.0)
        self.node.destroy_node()
        self._context.shutdown()


def _result(future: Any, wait_s: float, whose: str) -> Any:
    """What another thread makes of a future."""
    end = time.monotonic() + wait_s
    while not future.done():
        if time.monotonic() > end:
            raise IdentError(f"no answer from {whose} within {wait_s:g} s")
        time.sleep(0.005)
    return future.result()
