"""Two nodes of one name: what is asked of one machine is not done by another one as well."""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")

from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

pytestmark = pytest.mark.ros

DOMAIN = 10 + (os.getpid() + 25) % 90
SUCCESS = TransitionCallbackReturn.SUCCESS


class Twin(LifecycleNode):
    """What it was asked for, and does: it looks for no other one of its name."""

    def __init__(self, context: Any) -> None:
        super().__init__("twin", context=context)
        self.done: list[str] = []
        self.create_service(Trigger, "~/clear_trip", self._clear)

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        self.done.append("configure")
        return SUCCESS

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        self.done.append("activate")
        return SUCCESS

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        self.done.append("deactivate")
        return SUCCESS

    def _clear(self, _request: Any, response: Any) -> Any:
        self.done.append("clear_trip")
        response.success = True
        return response


@pytest.fixture
def twins(machine: Any) -> Iterator[list[Twin]]:
    made = [Twin(machine.context), Twin(machine.context)]
    executor = SingleThreadedExecutor(context=machine.context)
    executor.add_node(made[0])
    executor.add_node(made[1])
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.02)

    spinner = threading.Thread(target=spin)
    spinner.start()
    yield made
    ended.set()
    spinner.join()
    executor.shutdown()
    while made:
        made.pop().destroy_node()
    gc.collect()  # the services of a node's states live as long as it, beyond its end


@pytest.mark.parametrize("asked", ["configure", "clear_trip", "get"])
def test_of_two_nodes_of_a_name_nothing_is_asked(
    asked: str, twins: list[Twin], machine: Any, run_module: Callable[..., Any]
) -> None:
    done = run_module("lifecycle_command", asked, "twin", "--timeout", "20")
    assert done.returncode == 1
    domain = machine.context.get_domain_id()
    assert f"2 nodes are called /twin in ROS domain {domain}, expected one" in done.stderr
    assert f"nothing was asked, as all of them would {asked}" in done.stderr
    assert [twin.done for twin in twins] == [[], []]


@pytest.mark.parametrize("active", [(0, 1), (0,), (1,)])
def test_both_are_stopped_all_the_same(
    active: tuple[int, ...],
    twins: list[Twin],
    run_module: Callable[..., Any],
    wait_for: Callable[..., bool],
) -> None:
    """Who has to stop a machine is not refused, whichever of the two answers first."""
    for k in active:
        twins[k].trigger_configure()
        twins[k].trigger_activate()
    done = run_module("lifecycle_command", "deactivate", "twin", "--timeout", "20")
    assert done.returncode == 1
    assert "expected one: all were asked to deactivate" in done.stderr
    assert wait_for(lambda: all(twins[k].done[-1] == "deactivate" for k in active))


def test_whether_a_name_is_free(twins: list[Twin], run_module: Callable[..., Any]) -> None:
    free = run_module("lifecycle_command", "absent", "nobody")
    assert (free.returncode, free.stdout, free.stderr) == (0, "", "")
    taken = run_module("lifecycle_command", "absent", "twin")
    assert taken.returncode == 1
    assert "expected nobody called /twin in ROS domain" in taken.stderr
    assert "a machine is brought up there already" in taken.stderr


def test_the_controller_does_not_become_active_beside_another_one(
    node: Any, wait_for: Callable[..., bool]
) -> None:
    """Whoever asks, and whatever with."""
    failure = TransitionCallbackReturn.FAILURE
    other = rclpy.create_node("controller")
    assert wait_for(lambda: node.get_node_names().count("controller") == 2)
    assert node.trigger_configure() is failure
    other.destroy_node()
    assert wait_for(lambda: node.get_node_names().count("controller") == 1)
    assert node.trigger_configure() is SUCCESS
    other = rclpy.create_node("controller")
    assert wait_for(lambda: node.get_node_names().count("controller") == 2)
    assert node.trigger_activate() is failure
    other.destroy_node()
    assert wait_for(lambda: node.get_node_names().count("controller") == 1)
    assert node.trigger_activate() is SUCCESS
