"""`can_bridge`: CAN to ROS and back, the command around the lifecycle node of `bridge`."""

from __future__ import annotations

import argparse
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from hydro_hw_bridge.errors import BridgeError
from hydro_model.command_line.command import Parser, run_command
from hydro_msgs_docs.aside import unread_streams
from hydro_msgs_docs.endings import on_end, on_end_at_once
from hydro_msgs_docs.middleware import start_ros

if TYPE_CHECKING:
    from hydro_hw_bridge.node.bridge import CanBridge

NAME = "can_bridge"
SPIN_S = 0.1


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    with unread_streams():
        return run_command(NAME, _main, arguments)


def _main(arguments: Sequence[str]) -> int:
    words = list(arguments)
    at = words.index("--ros-args") if "--ros-args" in words else len(words)
    _parser().parse_args(words[:at])
    return _run(words[at:])


def _parser() -> argparse.ArgumentParser:
    from hydro_hw_bridge.node.parameters import PARAMETERS

    width = max(len(rule.name) for rule in PARAMETERS)
    lines = [f"  {rule.name:{width}}  {rule.meaning} [{rule.default}]" for rule in PARAMETERS]
    return Parser(
        prog=NAME,
        description="CAN to ROS and back. A lifecycle node: inactive reads and publishes,"
        " active also drives the valves. Ends with 0 V on Ctrl-C, SIGTERM and SIGHUP.",
        usage=f"{NAME} [-h] [--ros-args -p NAME:=VALUE ...]",
        epilog="parameters:\n" + "\n".join(lines),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def _run(ros_arguments: list[str]) -> int:
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from hydro_hw_bridge.node.bridge import CanBridge

    stop = threading.Event()
    on_end(stop.set)
    start_ros(NAME, ros_arguments, SignalHandlerOptions.NO, rosout_alone=True)
    try:
        node = CanBridge(stop)
        executor = SingleThreadedExecutor()
        executor.add_node(node)

        def end() -> None:
            known = stop.is_set()
            node.end()
            if not known:
                executor.wake()

        on_end_at_once(end)
        try:
            while not stop.is_set():
                executor.spin_once(timeout_sec=SPIN_S)
        except Exception as error:  # noqa: BLE001 - whatever ends the node must stop the valves
            node.fail(error)
        finally:
            node.close()
            executor.shutdown()
            node.destroy_node()
        return _result(node)
    finally:
        rclpy.try_shutdown()


def _result(node: CanBridge) -> int:
    if node.failure:
        error = BridgeError(node.failure)
        error.exit_code = 1
        raise error
    return 0
