"""The `controller` lifecycle node: inactive it listens, active it answers every sample."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from hydro_control.errors import ControlError
from hydro_model.command_line.command import run_command
from hydro_msgs_docs.aside import unread_streams
from hydro_msgs_docs.endings import on_end
from hydro_msgs_docs.middleware import start_ros
from hydro_msgs_docs.node_arguments import check_arguments

if TYPE_CHECKING:
    from hydro_control.node.controller_node import ControllerNode

NAME = "controller"


def main() -> int:
    """The command `controller`."""
    with unread_streams():
        return run_command(NAME, run)


def run(arguments: Sequence[str]) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP; the last valve command is 0 V.

    Parameters
    ----------
    arguments : sequence of str
        ROS arguments (`--ros-args -p robot:=... --params-file ...`).

    Returns
    -------
    int
        0 after a signal, 1 where the control loop failed.

    Raises
    ------
    ParameterError, ControlError, RobotError, RealTimeError
        A parameter, robot or path file that cannot be used.
    MiddlewareError
        ROS cannot be started with these arguments.
    """
    _check(arguments)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from hydro_control.node.controller_node import ControllerNode

    # A shorter turn of the interpreter's lock: planning a trajectory in another thread
    # then costs the control loop at most this much at each step.
    sys.setswitchinterval(0.0005)
    start_ros(NAME, arguments, SignalHandlerOptions.NO, rosout_alone=True)
    try:
        node = ControllerNode()
        try:
            return _spin(rclpy, node)
        finally:
            node.close()
    finally:
        rclpy.try_shutdown()


def _check(arguments: Sequence[str]) -> None:
    from hydro_control.node.parameters import PARAMETERS

    check_arguments(
        NAME,
        "Model-based 500 Hz controller of a hydraulic manipulator. A lifecycle node: inactive it"
        " listens, active it answers every sample.",
        [(rule.name, rule.meaning, rule.default) for rule in PARAMETERS],
        arguments,
    )


#: A signal is heard between two waits of the executor: no longer than this after it came.
_SPIN_S = 0.02


def _spin(rclpy: Any, node: ControllerNode) -> int:
    """Serve the node until a signal or a failure of the control loop."""
    from rclpy.executors import SingleThreadedExecutor

    received: list[bool] = []
    on_end(lambda: received.append(True))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while rclpy.ok() and not received and node.failure is None:
        executor.spin_once(timeout_sec=_SPIN_S)
    node.stop_driving()
    executor.remove_node(node)
    if node.failure is not None:
        failure = node.failure
        raise _LoopError(f"control loop ended: {type(failure).__name__}: {failure}")
    return 0


class _LoopError(ControlError):
    """The control loop failed while running."""

    exit_code = 1


if __name__ == "__main__":
    sys.exit(main())
