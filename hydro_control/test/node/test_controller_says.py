"""What was over before the controller looked at itself is said in `/diagnostics` all the same."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from rclpy.lifecycle import TransitionCallbackReturn  # noqa: E402

from hydro_control.core.core import Sample  # noqa: E402
from hydro_control.monitoring.bad_samples import SETTLED  # noqa: E402
from hydro_msgs_docs.nodes import ERROR, WARN  # noqa: E402

pytestmark = pytest.mark.ros
DOMAIN = 10 + (os.getpid() + 20) % 90
STEP_NS = 2_000_000
POSE = np.array([0.6, -1.5])
SAMPLES_A_LOOK = 50


class Said:
    """A controller that is active, its samples, and what it publishes of itself."""

    def __init__(self, node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.node, self.cycle = node, 0
        self.said: list[tuple[bytes, str, dict[str, object]]] = []
        for trigger in (node.trigger_configure, node.trigger_activate):
            assert trigger() is TransitionCallbackReturn.SUCCESS
        monkeypatch.setattr(node._diagnostics, "publish", lambda *said: self.said.append(said))

    def answer(self, cycles: int = 1, q: Any = POSE) -> Any:
        """Samples on; the last answer."""
        for _ in range(cycles):
            chambers = np.full(2, 8e6)
            stamp_ns = 10**18 + self.cycle * STEP_NS
            self.cycle += 1
            answer = self.node._core.answer(Sample(stamp_ns, q, chambers, chambers, 19e6, 2e5))
        return answer

    def looks(self) -> list[tuple[bytes, str]]:
        """What is said at the next look, but for what is said each second."""
        self.said.clear()
        self.node._said_s = float("inf")
        self.node._look()
        return [(level, message) for level, message, _ in self.said]


@pytest.fixture
def machine(node: Any, monkeypatch: pytest.MonkeyPatch) -> Said:
    """Of which the rest state was said."""
    machine = Said(node, monkeypatch)
    machine.answer(5)
    machine.looks()
    return machine


def test_a_fault_between_two_looks_is_said_once_with_its_count(machine: Said) -> None:
    machine.answer(1, np.array([np.nan, -1.5]))
    assert not machine.answer(SAMPLES_A_LOOK).output.fault
    ((level, message),) = machine.looks()
    assert level == ERROR
    assert message.startswith("0 V: expected finite numbers, found joint position [nan, -1.5]")
    assert machine.said[0][2]["faults"] == 1 + SETTLED
    machine.answer(SAMPLES_A_LOOK)
    ((level, message),) = machine.looks()
    assert level != ERROR
    machine.answer(SAMPLES_A_LOOK)
    assert machine.looks() == []


def test_the_newest_fault_is_said_and_none_of_before_it_began_anew(machine: Said) -> None:
    machine.answer(1, np.array([np.nan, -1.5]))
    machine.answer(SAMPLES_A_LOOK)
    machine.answer(1, np.array([0.6, np.inf]))
    machine.answer(SAMPLES_A_LOOK)
    ((_, message),) = machine.looks()
    assert "joint position [0.6, inf]" in message
    machine.answer(1, np.array([np.nan, -1.5]))
    machine.node._core.restart()
    machine.answer(1)
    assert ERROR not in [level for level, _ in machine.looks()]


def test_a_note_between_two_looks_is_said_once(machine: Said) -> None:
    machine.cycle += 12  # lost: filters start anew, which is noted of one sample
    assert machine.answer().output.notes
    assert not machine.answer(SAMPLES_A_LOOK - 1).output.notes
    ((level, message),) = machine.looks()
    assert level == WARN
    assert "; gap of 0.026 s, filters start anew" in message
    machine.answer(SAMPLES_A_LOOK)
    assert [text for _, text in machine.looks() if "gap" in text] == []
