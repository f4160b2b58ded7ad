"""A controller whose loop cannot be started or ended: not active, and the reason is told."""

from __future__ import annotations

import gc
import os
import threading
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")

from rclpy.lifecycle import TransitionCallbackReturn  # noqa: E402

from hydro_control.errors import ControlError  # noqa: E402
from hydro_control.node import hot_path  # noqa: E402
from hydro_control.node.hot_path import HotPath  # noqa: E402
from hydro_msgs_docs.real_time import RealTime  # noqa: E402

pytestmark = pytest.mark.ros
DOMAIN = 10 + (os.getpid() + 80) % 90


def state_of(node: Any) -> str:
    label: str = node._state_machine.current_state[1]
    return label


def test_a_start_that_is_refused_leaves_it_inactive(
    node: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_hot: HotPath) -> None:
        raise ControlError("no")

    assert node.trigger_configure() is TransitionCallbackReturn.SUCCESS
    with monkeypatch.context() as patch:
        patch.setattr(HotPath, "start", refuse)
        assert node.trigger_activate() is TransitionCallbackReturn.FAILURE
    assert state_of(node) == "inactive"
    assert node._status()[1].startswith("inactive")
    assert gc.isenabled()
    assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS


def test_a_system_without_another_thread_leaves_it_to_be_configured_again(
    node: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def exhausted(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    assert node.trigger_configure() is TransitionCallbackReturn.SUCCESS
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", exhausted)
        assert node.trigger_activate() is TransitionCallbackReturn.ERROR
    assert state_of(node) == "unconfigured"
    assert gc.isenabled()
    for trigger in (node.trigger_configure, node.trigger_activate):
        assert trigger() is TransitionCallbackReturn.SUCCESS


def test_a_loop_that_is_held_is_told_and_does_not_hold_the_node(
    node: Any, monkeypatch: pytest.MonkeyPatch, patience_s: float
) -> None:
    held, go = threading.Event(), threading.Event()

    def hold(_measures: RealTime) -> None:
        held.set()
        go.wait(patience_s)

    monkeypatch.setattr(hot_path, "JOIN_S", 0.1)
    monkeypatch.setattr(RealTime, "idle", hold)
    for trigger in (node.trigger_configure, node.trigger_activate):
        assert trigger() is TransitionCallbackReturn.SUCCESS
    assert held.wait(patience_s)
    loop = node._hot._thread
    deactivating = threading.Thread(target=node.trigger_deactivate)
    deactivating.start()
    deactivating.join(5.0)
    ended = not deactivating.is_alive()
    # While it is held no other one is started beside it.
    again = node.trigger_activate() if ended else None
    # It keeps what it still needs to send its 0 V.
    node._hot.destroy()
    kept = node._hot._command in list(node.publishers)
    go.set()
    for thread in (deactivating, loop):
        thread.join(patience_s)
    assert ended
    assert kept
    assert loop.daemon
    assert "expected the control loop to end within 0.1 s, found it held" in str(node.failure)
    assert again is TransitionCallbackReturn.FAILURE
    assert node.trigger_activate() is TransitionCallbackReturn.SUCCESS
