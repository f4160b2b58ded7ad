"""A controller whose loop cannot be started is not active, and can be configured again."""

from __future__ import annotations

import gc
import os
import threading
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")

from rclpy.lifecycle import TransitionCallbackReturn  # noqa: E402

from hydro_control.errors import ControlError  # noqa: E402
from hydro_control.node.hot_path import HotPath  # noqa: E402

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
