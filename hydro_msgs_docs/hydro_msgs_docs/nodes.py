"""What the lifecycle nodes share: transitions, fixed parameters, diagnostics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos_overriding_options import QoSOverridingOptions

from hydro_model.errors import HydroError
from hydro_msgs_docs.aside import log_of
from hydro_msgs_docs.errors import ContractError
from hydro_msgs_docs.topics import DIAGNOSTICS, reliable

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)

#: Transitions towards driving, which a node makes alone with its name or not at all.
_ALONE = ("configure", "activate")

Transition = Callable[[Any, LifecycleState], TransitionCallbackReturn]


class NamesakeError(ContractError):
    """Another node has this one's name: what is asked of one is asked of both."""


def refuse_namesakes(node: Node) -> None:
    """Refuse to go on beside another node of the same name.

    A service is called by its name: whoever configures, activates or clears one node does so with
    all of that name in the ROS domain, and each has a machine of its own.

    Parameters
    ----------
    node : Node

    Raises
    ------
    NamesakeError
    """
    name = node.get_fully_qualified_name()
    count = node.get_fully_qualified_node_names().count(name)
    if count > 1:
        raise NamesakeError(
            f"{count} nodes are called {name} in ROS domain {node.context.get_domain_id()},"
            " expected one: what is asked of one is asked of all; give each machine a"
            " ROS_DOMAIN_ID of its own"
        )


def logged_transition(body: Callable[[Any], None]) -> Transition:
    """Make a lifecycle callback of a method that raises on failure.

    rclpy swallows what a lifecycle callback raises, so the message is logged here and the
    transition fails: back to the state before for a HydroError, ERROR for anything else. What
    leads towards driving fails beside another node of this one's name, too.

    Parameters
    ----------
    body : method without arguments

    Returns
    -------
    method
        To be used as `on_configure`, `on_activate` ...
    """

    def transition(self: LifecycleNode, _state: LifecycleState) -> TransitionCallbackReturn:
        try:
            if body.__name__.strip("_") in _ALONE:
                refuse_namesakes(self)
            body(self)
        except HydroError as error:
            log_of(self).error(f"{body.__name__.strip('_')}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            log_of(self).fatal(f"{body.__name__.strip('_')}: {type(error).__name__}: {error}")
            raise
        return TransitionCallbackReturn.SUCCESS

    return transition


def refuse_closed_transitions(node: LifecycleNode) -> None:
    """Have a node refuse transitions that are not open from its state, and go on.

    Where one is asked for by its number, as managers of nodes do, rclpy raises instead, and what a
    service raises ends the executor: the node of a machine that is being driven, asked to
    activate once more, was gone.

    Parameters
    ----------
    node : LifecycleNode
    """
    change = next(service for service in node.services if service.srv_type is ChangeState)
    make = change.callback

    def _answer(
        request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        try:
            return make(request, response)
        except RCLError as error:
            asked, why = request.transition, " ".join(str(error).split())
            log_of(node).error(f"transition {asked.label or asked.id} is refused: {why}")
            response.success = False
            return response

    change.callback = _answer


def fix_parameters(node: Node, configured: Callable[[], bool]) -> None:
    """Have a node refuse every change of a parameter while it is configured.

    That takes in what rclpy itself declares: `use_sim_time` would put a running node on another
    clock. What is declared only then, such as the QoS of topics made by `configure`, is no change.

    Parameters
    ----------
    node : Node
    configured : callable
        Whether it is, at the moment.
    """

    def judge(asked: list[Parameter]) -> SetParametersResult:
        # rclpy asks for declarations, too: what is being declared is not there yet.
        names = [parameter.name for parameter in asked if node.has_parameter(parameter.name)]
        if not names or not configured():
            return SetParametersResult(successful=True)
        return SetParametersResult(
            successful=False,
            reason=f"{', '.join(names)}: parameters are read when configuring: clean up first",
        )

    # rclpy asks the newest callback first and stops at a refusal. Its own for `use_sim_time`
    # switches the clock while it is asked, so this one, made later, has to come before it.
    node.add_on_set_parameters_callback(judge)


class Diagnostics:
    """Publishes `/diagnostics` (REP-107) for one node.

    Parameters
    ----------
    node : Node
    hardware_id : str
    """

    def __init__(self, node: Node, hardware_id: str) -> None:
        self._node = node
        self._hardware_id = hardware_id
        self._publisher = node.create_publisher(
            DiagnosticArray,
            DIAGNOSTICS,
            reliable(),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def publish(self, level: bytes, message: str, values: Mapping[str, object]) -> None:
        """Publish one status.

        Parameters
        ----------
        level : bytes
            OK, WARN, ERROR or STALE.
        message : str
            A summary in plain words.
        values : mapping
            Counters and measurements, printed as text.
        """
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_name(),
            message=message,
            hardware_id=self._hardware_id,
            values=[KeyValue(key=k, value=str(v)) for k, v in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)
