"""`lifecycle TRANSITION NODE`: change or read the state of a lifecycle node, without ros2cli."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from typing import Any

from hydro_control.errors import ControlError
from hydro_model.command import run_command

NAME = "lifecycle"
_TRANSITIONS = ("configure", "activate", "deactivate", "cleanup", "shutdown")


class TransitionError(ControlError):
    """The node did not answer, or did not make the transition."""

    exit_code = 1


def main() -> int:
    """The command `lifecycle`."""
    return run_command(NAME, run)


def run(arguments: Sequence[str]) -> int:
    """Make a transition, or print the state.

    Parameters
    ----------
    arguments : sequence of str

    Returns
    -------
    int
        0 where the node made the transition.

    Raises
    ------
    TransitionError
        No such node within the timeout, or the transition failed.
    """
    args = _parser().parse_args(arguments)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=None, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f"lifecycle_{args.transition}", start_parameter_services=False)
    try:
        target = "/" + args.node.strip("/")
        if args.transition == "get":
            print(_state(rclpy, node, target, args.timeout))
        else:
            _change(rclpy, node, target, args.transition, args.timeout)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=NAME, description="Change or read the state of a lifecycle node."
    )
    parser.add_argument("transition", choices=(*_TRANSITIONS, "get"))
    parser.add_argument("node", metavar="NODE", help="name of the node, such as controller")
    parser.add_argument(
        "--timeout", type=_seconds, default=10.0, metavar="S", help="seconds to wait (default 10)"
    )
    return parser


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected seconds above 0, found {text}")
    return value


def _call(
    rclpy: Any, node: Any, kind: Any, service: str, request: Any, timeout_s: float, what: str
) -> Any:
    """One service call; TransitionError where nobody answers in time."""
    end = time.monotonic() + timeout_s
    client = node.create_client(kind, service)
    if not client.wait_for_service(timeout_sec=timeout_s):
        raise TransitionError(f"no node answers at {service} within {timeout_s:g} s: is it up?")
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=max(0.1, end - time.monotonic()))
    if not future.done():
        raise TransitionError(f"{what}: no answer from {service} within {timeout_s:g} s")
    return future.result()


def _state(rclpy: Any, node: Any, target: str, timeout_s: float) -> str:
    from lifecycle_msgs.srv import GetState

    service = f"{target}/get_state"
    answer = _call(rclpy, node, GetState, service, GetState.Request(), timeout_s, "get")
    return str(answer.current_state.label)


def _change(rclpy: Any, node: Any, target: str, transition: str, timeout_s: float) -> None:
    from lifecycle_msgs.srv import ChangeState

    request = ChangeState.Request()
    # Shutdown has one number per state it starts from; a node also takes its label.
    request.transition.id = _number(rclpy, node, target, transition, timeout_s)
    request.transition.label = transition
    service = f"{target}/change_state"
    answer = _call(rclpy, node, ChangeState, service, request, timeout_s, transition)
    if not answer.success:
        state = _state(rclpy, node, target, timeout_s)
        raise TransitionError(f"{target[1:]} did not {transition}: it is {state}; see its log")


def _number(rclpy: Any, node: Any, target: str, transition: str, timeout_s: float) -> int:
    """Number of a transition that is open from the node's present state."""
    from lifecycle_msgs.srv import GetAvailableTransitions

    service = f"{target}/get_available_transitions"
    request = GetAvailableTransitions.Request()
    answer = _call(rclpy, node, GetAvailableTransitions, service, request, timeout_s, transition)
    open_now = {t.transition.label: int(t.transition.id) for t in answer.available_transitions}
    if transition not in open_now:
        state = _state(rclpy, node, target, timeout_s)
        names = ", ".join(sorted(open_now)) or "nothing"
        raise TransitionError(f"{target[1:]} is {state} and cannot {transition} (it can: {names})")
    return open_now[transition]


if __name__ == "__main__":
    sys.exit(main())
