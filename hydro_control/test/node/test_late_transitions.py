"""What a node does that did not answer in time: nothing that nobody expects any more."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")

from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn  # noqa: E402

from hydro_control.node import lifecycle_command  # noqa: E402
from hydro_control.node.lifecycle_command import TransitionError  # noqa: E402

pytestmark = pytest.mark.ros

SUCCESS = TransitionCallbackReturn.SUCCESS
ACTIVATE = ("activate", "slow", "--timeout", "8")


class Slow(LifecycleNode):
    """Its activation takes until it is let go, and it hears nothing meanwhile."""

    def __init__(self, context: Any, patience_s: float) -> None:
        super().__init__("slow", context=context)
        self.go, self.made, self._patience_s = threading.Event(), list[str](), patience_s
        self.fails = False

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        return SUCCESS

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        assert self.go.wait(self._patience_s)
        if self.fails:
            return TransitionCallbackReturn.ERROR
        self.made.append("activate")
        return SUCCESS

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        self.made.append("deactivate")
        return SUCCESS

    @property
    def state(self) -> str:
        label: str = self._state_machine.current_state[1]
        return label


@pytest.fixture
def slow(machine: Any, patience_s: float) -> Iterator[Slow]:
    node = Slow(machine.context, patience_s)
    node.trigger_configure()
    executor = SingleThreadedExecutor(context=machine.context)
    executor.add_node(node)
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            executor.spin_once(timeout_sec=0.02)

    spinner = threading.Thread(target=spin)
    spinner.start()
    yield node
    node.go.set()
    ended.set()
    spinner.join()
    executor.shutdown()
    node.destroy_node()


def test_what_is_activated_long_after_it_was_given_up_is_deactivated_at_once(
    slow: Slow, run_module: Callable[..., Any], wait_for: Callable[..., bool]
) -> None:
    """Its command has ended, and said that it had no answer: the machine is thought to rest."""
    done = run_module("lifecycle_command", *ACTIVATE)
    assert done.returncode == 1
    assert "activate: no answer from /slow/change_state within" in done.stderr
    assert "slow was asked to deactivate, too, should it still activate" in done.stderr
    assert "keep away from the machine until `lifecycle get slow` says inactive" in done.stderr
    assert slow.made == []
    slow.go.set()
    assert wait_for(lambda: slow.made == ["activate", "deactivate"])
    assert wait_for(lambda: slow.state == "inactive")


@pytest.mark.thorough
def test_what_is_activated_just_too_late_is_told_to_be_deactivated_again(
    slow: Slow, monkeypatch: pytest.MonkeyPatch, patience_s: float
) -> None:
    afterwards = lifecycle_command._afterwards

    def late(*given: Any) -> str:
        slow.go.set()
        return afterwards(*given)

    monkeypatch.setattr(lifecycle_command, "_TAKEN_BACK_S", patience_s)
    monkeypatch.setattr(lifecycle_command, "_afterwards", late)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(slow.context.get_domain_id()))
    with pytest.raises(TransitionError, match="slow was activated too late, and is deactivated"):
        lifecycle_command.run(ACTIVATE)
    assert (slow.made, slow.state) == (["activate", "deactivate"], "inactive")


def test_an_activation_that_fails_late_is_not_said_to_be_made(
    slow: Slow, monkeypatch: pytest.MonkeyPatch, patience_s: float
) -> None:
    """It cannot be activated any more either way: unconfigured as little as active."""
    call, slow.fails = lifecycle_command._call, True

    def gives_up(*given: Any, **options: Any) -> Any:
        try:
            return call(*given, **options)
        except TransitionError:
            slow.go.set()
            raise

    monkeypatch.setattr(lifecycle_command, "_AGAIN_S", 1.0)
    monkeypatch.setattr(lifecycle_command, "_call", gives_up)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(slow.context.get_domain_id()))
    with pytest.raises(TransitionError, match="slow did not activate: it is unconfigured"):
        lifecycle_command.run(("activate", "slow", "--timeout", str(patience_s)))


def test_of_other_transitions_it_is_said_that_they_may_still_be_made() -> None:
    said = lifecycle_command._afterwards(None, None, "/slow", "configure", None)  # type: ignore[arg-type]
    assert said == "it may still configure: `lifecycle get slow` says whether it has"
