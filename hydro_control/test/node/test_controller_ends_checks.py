"""A node that stops driving ends what is being checked: it takes computing time from the next."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from hydro_control.core.core import Sample  # noqa: E402

pytestmark = pytest.mark.ros
DOMAIN = 10 + (os.getpid() + 70) % 90


def test_what_was_asked_for_before_driving_ended_is_overtaken(node: Any) -> None:
    chambers = np.full(2, 8e6)
    node._core.answer(Sample(10**18, np.array([0.6, -1.5]), chambers, chambers, 19e6, 1e6))
    asked_from = node._core.requests.standing
    assert not asked_from.overtaken
    node.stop_driving()
    assert asked_from.overtaken
