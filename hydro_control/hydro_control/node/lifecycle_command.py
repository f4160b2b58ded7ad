"""`lifecycle TRANSITION NODE`: change or read the state of a node, without ros2cli."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from hydro_control.errors import ControlError
from hydro_model.command_line.command import Parser, run_command
from hydro_model.command_line.output import add_json, report
from hydro_model.errors import printable
from hydro_msgs_docs.middleware import start_ros

#: Time without an answer after which a node is asked again.
_AGAIN_S = 5.0
#: How long a node may take to answer that what it did not activate in time is deactivated again.
_TAKEN_BACK_S = 2.0
#: Once one node of a name was found, others of that name that are there are found within this.
_OTHERS_S = 0.5
#: Nobody was found for so long: nobody is there. Who was not met at once is by the next of its
#: announcements, which Fast DDS makes every 3 s.
_FREE_S = 4.5
NAME = "lifecycle"
#: No transition: a bridge that has tripped stays active.
CLEAR_TRIP = "clear_trip"
#: Nor is this: whether a name is free, for who is about to start a node of it.
ABSENT = "absent"
#: Transitions, and the state that a node is in after each.
_TRANSITIONS = {
    "configure": "inactive",
    "activate": "active",
    "deactivate": "inactive",
    "cleanup": "unconfigured",
    "shutdown": "finalized",
}
#: Of what `--json` writes.
SCHEMA = "hydro_control/lifecycle/1"


class TransitionError(ControlError):
    """The node did not answer, did not make the transition, or is not alone with its name."""

    exit_code = 1


class _NoAnswerError(TransitionError):
    """A request is under way, or its answer was lost."""


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
        No such node within the timeout, more than one, or the transition failed.
    """
    args = _parser().parse_args(arguments)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    target = _named(args.node)
    start_ros(NAME, handlers=SignalHandlerOptions.NO)
    node = rclpy.create_node(f"lifecycle_{args.transition}", start_parameter_services=False)
    try:
        found, text = _done(rclpy, node, target, args.transition, args.timeout)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    asked = {"schema": SCHEMA, "node": target, "asked": args.transition}
    report(args.json, {**asked, **found}, text)
    return 0


def _named(node: str) -> str:
    from rclpy.exceptions import InvalidTopicNameException
    from rclpy.validate_full_topic_name import validate_full_topic_name

    target = "/" + node.strip("/")
    try:
        validate_full_topic_name(target)
    except InvalidTopicNameException as error:
        why = "expected a node's name, such as controller"
        raise ControlError(f"{why}, found '{printable(node)}'") from error
    return target


def _done(
    rclpy: Any, node: Any, target: str, asked: str, timeout_s: float
) -> tuple[dict[str, str], str]:
    """What came of it, for a program and for a person."""
    if asked == ABSENT:
        _refuse_present(node, target)
        return {"state": ABSENT}, ""
    if asked == "deactivate":
        _deactivate(rclpy, node, target, timeout_s)
        return {"state": _TRANSITIONS[asked]}, ""
    _refuse_several(node, target, asked, timeout_s)
    if asked == "get":
        state = _state(rclpy, node, target, timeout_s)
        return {"state": state}, state
    if asked == CLEAR_TRIP:
        message = _clear_trip(rclpy, node, target, timeout_s)
        return {"message": message}, message
    _change(rclpy, node, target, asked, timeout_s)
    return {"state": _TRANSITIONS[asked]}, ""


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog=NAME,
        description="Change or read the state of a lifecycle node, or clear the trip of a bridge"
        " once its cause is gone. Where several nodes have the name nothing is asked of any, as"
        " all would do it; `deactivate` alone is asked of them all.",
    )
    parser.add_argument(
        "transition",
        choices=(*_TRANSITIONS, "get", CLEAR_TRIP, ABSENT),
        help="change of the node's state, or what is asked of it; absent: fail where it is there",
    )
    parser.add_argument("node", metavar="NODE", help="name of the node, such as controller")
    parser.add_argument(
        "--timeout", type=seconds, default=10.0, metavar="S", help="seconds to wait (default 10)"
    )
    add_json(parser, "node and state, or what the node said,")
    return parser


def seconds(text: str) -> float:
    """A time to wait as a command line gives it.

    Parameters
    ----------
    text : str

    Returns
    -------
    float

    Raises
    ------
    argparse.ArgumentTypeError
        It is not above 0 s and finite.
    ValueError
        It is no number.
    """
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected seconds above 0, found {text}")
    return value


def _found(node: Any, target: str, service: str) -> int:
    """How many nodes of a name there are, as far as is known by now."""
    # A node and its services are told of apart: whichever is known first.
    services: int = node.count_services(f"{target}/{service}")
    nodes: int = node.get_fully_qualified_node_names().count(target)
    return max(services, nodes)


def _several(node: Any, target: str, service: str = "change_state") -> str:
    """What there is in the place of one node, in words; empty where no second one is found."""
    end = time.monotonic() + _OTHERS_S
    while (count := _found(node, target, service)) < 2:
        if time.monotonic() > end:
            return ""
        time.sleep(0.02)
    return f"{count} nodes are called {target} in ROS domain {node.context.get_domain_id()}"


def _nobody(node: Any, service: str, timeout_s: float) -> TransitionError:
    """The error of a service that nobody offers."""
    name, _, asked = service.rpartition("/")
    if name in node.get_fully_qualified_node_names():
        return TransitionError(f"{name} is there, and offers no {asked} within {timeout_s:g} s")
    domain = node.context.get_domain_id()
    return TransitionError(
        f"no node answers at {service} within {timeout_s:g} s in ROS domain {domain}: is it up"
        " there?"
    )


def _refuse_several(node: Any, target: str, asked: str, timeout_s: float) -> None:
    """Refuse where one request would reach more than one node: another machine's does it, too."""
    service = {"get": "get_state", CLEAR_TRIP: CLEAR_TRIP}.get(asked, "change_state")
    end = time.monotonic() + timeout_s
    while not _found(node, target, service):
        if time.monotonic() > end:
            raise _nobody(node, f"{target}/{service}", timeout_s)
        time.sleep(0.02)
    if several := _several(node, target, service):
        raise TransitionError(
            f"{several}, expected one: nothing was asked, as all of them would {asked}; give each"
            " machine a ROS_DOMAIN_ID of its own"
        )


def _refuse_present(node: Any, target: str) -> None:
    """Refuse where a node of a name is there."""
    end = time.monotonic() + _FREE_S
    while time.monotonic() < end:
        if count := _found(node, target, "change_state"):
            domain = node.context.get_domain_id()
            raise TransitionError(
                f"expected nobody called {target} in ROS domain {domain}, found {count}: a machine"
                " is brought up there already; end that, or set another ROS_DOMAIN_ID"
            )
        time.sleep(0.02)


def _deactivate(rclpy: Any, node: Any, target: str, timeout_s: float) -> None:
    """Stop first and count after: who has to stop is neither kept waiting nor refused."""
    from lifecycle_msgs.msg import Transition

    failed: TransitionError | None = None
    try:
        _change(rclpy, node, target, "deactivate", timeout_s)
    except TransitionError as error:
        failed = error  # of one that was not active, perhaps, beside one that is
    if several := _several(node, target):
        asking = _Asking(rclpy, node, target)
        with suppress(_NoAnswerError):
            asking.succeeds(Transition.TRANSITION_DEACTIVATE, "deactivate", _TAKEN_BACK_S)
        raise TransitionError(
            f"{several}, expected one: all were asked to deactivate, and which have is not known"
        )
    if failed is not None:
        raise failed


def _call(
    rclpy: Any,
    node: Any,
    kind: Any,
    service: str,
    request: Any,
    timeout_s: float,
    what: str,
    *,
    again: bool = False,
    client: Any = None,
) -> Any:
    """One service call; TransitionError where nobody answers in time.

    What changes nothing may be asked `again`: an answer is lost where a server has not found the
    client's end of it yet. What one `client` asks for arrives in that order.
    """
    end = time.monotonic() + timeout_s
    client = node.create_client(kind, service) if client is None else client
    if not client.wait_for_service(timeout_sec=timeout_s):
        raise _nobody(node, service, timeout_s)
    while True:
        left = max(0.1, end - time.monotonic())
        future = client.call_async(request)
        patience = min(left, _AGAIN_S)
        rclpy.spin_until_future_complete(node, future, timeout_sec=patience)
        if future.done():
            return future.result()
        if not again or patience >= left:
            raise _NoAnswerError(f"{what}: no answer from {service} within {timeout_s:g} s")


def _state(rclpy: Any, node: Any, target: str, timeout_s: float) -> str:
    from lifecycle_msgs.srv import GetState

    service = f"{target}/get_state"
    answer = _call(
        rclpy, node, GetState, service, GetState.Request(), timeout_s, "get", again=True
    )
    return str(answer.current_state.label)


def _clear_trip(rclpy: Any, node: Any, target: str, timeout_s: float) -> str:
    from std_srvs.srv import Trigger

    service = f"{target}/{CLEAR_TRIP}"
    answer = _call(rclpy, node, Trigger, service, Trigger.Request(), timeout_s, CLEAR_TRIP)
    if not answer.success:
        raise TransitionError(f"{target} is not cleared: {answer.message}")
    return str(answer.message)


class _Asking:
    """Asks one node for transitions, through one client: they arrive in the order of asking."""

    def __init__(self, rclpy: Any, node: Any, target: str) -> None:
        from lifecycle_msgs.srv import ChangeState

        self._rclpy, self._node, self._kind = rclpy, node, ChangeState
        self._client = node.create_client(ChangeState, f"{target}/change_state")

    def succeeds(self, number: int, label: str, timeout_s: float) -> bool:
        """Whether the node makes a transition; _NoAnswerError where it does not say in time."""
        request = self._kind.Request()
        # Shutdown has one number per state it starts from; a node also takes its label.
        request.transition.id, request.transition.label = number, label
        given = self._kind, self._client.srv_name, request, timeout_s, label
        return bool(_call(self._rclpy, self._node, *given, client=self._client).success)


def _change(rclpy: Any, node: Any, target: str, transition: str, timeout_s: float) -> None:
    end = time.monotonic() + timeout_s
    number = _number(rclpy, node, target, transition, timeout_s)
    asking = _Asking(rclpy, node, target)
    while True:
        left = max(end - time.monotonic(), 0.1)
        try:
            done = asking.succeeds(number, transition, left)
            break
        except _NoAnswerError as error:
            try:
                # Lost on the way back: the node's state says what became of the request.
                if _state(rclpy, node, target, left) == _TRANSITIONS[transition]:
                    return
            except _NoAnswerError:
                left = 0.0  # it answers nothing
            if left <= _AGAIN_S:
                after = _afterwards(rclpy, node, target, transition, asking)
                raise TransitionError(f"{error}; {after}") from error
    if not done:
        state = _state(rclpy, node, target, timeout_s)
        raise TransitionError(f"{target[1:]} did not {transition}: it is {state}; see its log")


def _afterwards(rclpy: Any, node: Any, target: str, transition: str, asking: _Asking) -> str:
    """What becomes of a request that was not answered in time, in words.

    A node that is busy carries it out once it is not. What would still be activated is deactivated
    at once: who was told that a node does not answer expects nothing of it minutes later.
    """
    from lifecycle_msgs.msg import Transition

    name = target[1:]
    if transition != "activate":
        return f"it may still {transition}: `lifecycle get {name}` says whether it has"
    try:
        if asking.succeeds(Transition.TRANSITION_DEACTIVATE, "deactivate", _TAKEN_BACK_S):
            return f"{name} was activated too late, and is deactivated again"
        return f"{name} is {_state(rclpy, node, target, _TAKEN_BACK_S)}"
    except _NoAnswerError:
        return (
            f"{name} was asked to deactivate, too, should it still activate: keep away from the"
            f" machine until `lifecycle get {name}` says inactive"
        )


def _open(rclpy: Any, node: Any, target: str, transition: str, timeout_s: float) -> dict[str, int]:
    """Numbers of the transitions that are open from the node's present state."""
    from lifecycle_msgs.srv import GetAvailableTransitions

    service = f"{target}/get_available_transitions"
    request = GetAvailableTransitions.Request()
    answer = _call(
        rclpy,
        node,
        GetAvailableTransitions,
        service,
        request,
        timeout_s,
        transition,
        again=True,
    )
    return {t.transition.label: int(t.transition.id) for t in answer.available_transitions}


def _number(rclpy: Any, node: Any, target: str, transition: str, timeout_s: float) -> int:
    """Number of a transition that is open from the node's present state."""
    open_now = _open(rclpy, node, target, transition, timeout_s)
    if transition not in open_now:
        state = _state(rclpy, node, target, timeout_s)
        names = ", ".join(sorted(open_now)) or "nothing"
        raise TransitionError(f"{target[1:]} is {state} and cannot {transition} (it can: {names})")
    return open_now[transition]


if __name__ == "__main__":
    sys.exit(main())
