"""`identification_node`: identifies from bags and publishes `/base_parameters`, latched."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hydro_ident.errors import IdentError, NotEnoughDataError
from hydro_model.command_line.command import run_command
from hydro_msgs_docs.endings import on_end
from hydro_msgs_docs.middleware import start_ros
from hydro_msgs_docs.node_arguments import check_arguments

if TYPE_CHECKING:
    from hydro_ident.identify.identification import Identification
    from hydro_ident.parameters.parameters import Parameter

_TEXT = (
    "Identifies from bags and publishes /base_parameters, latched: name = parameter, effort ="
    " value, velocity = standard deviation. Stays up until Ctrl-C."
)
#: Its parameters and what they mean; both have to be given.
_MEANT = {
    "bags": "bags to identify from, a list of paths",
    "robot": "robot file or the name of a shipped robot",
}


def run(arguments: Sequence[str]) -> int:
    """Identify, publish once, stay until SIGINT, SIGTERM or SIGHUP; returns the exit code."""
    check_arguments("identification_node", _TEXT, [(*p, None) for p in _MEANT.items()], arguments)
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.signals import SignalHandlerOptions

    start_ros("identification_node", arguments, SignalHandlerOptions.NO)
    # A signal also has to end the identification, which spins nothing.
    on_end(_interrupt)
    try:
        node = rclpy.create_node("identification_node")
        try:
            message = _identified_message(node)
            publisher = _publisher(node)
            publisher.publish(message)
            node.get_logger().info(f"/base_parameters: {len(message.name)} parameters, latched")
            while rclpy.ok():
                # A timeout, so that Python gets to see the signal.
                rclpy.spin_once(node, timeout_sec=0.5)
        except (KeyboardInterrupt, ExternalShutdownException):
            return 0
        finally:
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return 0


def _interrupt() -> None:
    raise KeyboardInterrupt


def _publisher(node: Any) -> Any:
    from rclpy.qos_overriding_options import QoSOverridingOptions
    from sensor_msgs.msg import JointState

    from hydro_msgs_docs.topics import BASE_PARAMETERS, latched

    return node.create_publisher(
        JointState,
        BASE_PARAMETERS,
        latched(),
        qos_overriding_options=QoSOverridingOptions.with_default_policies(),
    )


def _identified_message(node: Any) -> Any:
    from hydro_ident.identify.identification import identify
    from hydro_ident.identify.verdict import NOT_ENOUGH
    from hydro_ident.optional import require
    from hydro_ident.recordings.sources import bag_sources
    from hydro_model.robot_files import load_robot
    from hydro_msgs_docs.messages import joint_state

    bags, name = _parameters(node)
    require("clarabel", "bodies that can exist")
    robot = load_robot(name, narrow=True)
    found = identify(robot, bag_sources(bags, (), robot)[0])
    if found.verdict == NOT_ENOUGH:
        raise NotEnoughDataError("; ".join(found.problems))
    for text in found.problems:
        node.get_logger().warning(text)
    for loss in found.losses:
        node.get_logger().info(f"lost: {loss.bag}: {loss.channel}: {loss.reason}")
    for text in found.notes:
        node.get_logger().info(text)
    known = determined(found)
    return joint_state(
        node.get_clock().now().nanoseconds,
        [p.name for p in known],
        effort=[p.value for p in known],
        velocity=[p.std for p in known],
    )


def determined(found: Identification) -> list[Parameter]:
    """The parameters that are published: those that the data determine."""
    return [p for p in found.parameters if p.identifiable]


def _parameters(node: Any) -> tuple[list[str], str]:
    """Values of `bags` and `robot`; raises IdentError where they are missing or mistyped."""
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.exceptions import (
        InvalidParameterTypeException,
        ParameterUninitializedException,
    )
    from rclpy.parameter import Parameter as RosParameter

    kinds = {"bags": RosParameter.Type.STRING_ARRAY, "robot": RosParameter.Type.STRING}
    values = {}
    for name, text in _MEANT.items():
        descriptor = ParameterDescriptor(name=name, description=text, read_only=True)
        try:
            node.declare_parameter(name, kinds[name], descriptor)
            values[name] = node.get_parameter(name).value
        except InvalidParameterTypeException as error:
            raise IdentError(f"parameter '{name}' should be {text}: {error}") from error
        except ParameterUninitializedException as error:
            raise IdentError(f"parameter '{name}' is missing, expected {text}") from error
    if not any(values["bags"]):
        raise IdentError(f"parameter 'bags' is empty, expected {_MEANT['bags']}")
    return list(values["bags"]), str(values["robot"])


def main() -> int:
    """Entry point."""
    return run_command("identification_node", run)


if __name__ == "__main__":
    sys.exit(main())
