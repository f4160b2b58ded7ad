"""A slow swing of the crane's joints, shared by the tests of what is estimated on the way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from hydro_model.robot import FloatArray

#: Of a time and each joint's size: positions, velocities and accelerations of lift and tilt.
Swing = Callable[[float, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


def _swing(t: float, size: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    rate = 2.0 * np.pi * np.array([0.1, 0.13])
    phase = rate * t + np.array([0.0, 2.0])
    q = np.array([0.5, -1.4]) + size * np.sin(phase)
    return q, size * rate * np.cos(phase), -size * rate**2 * np.sin(phase)


@pytest.fixture(scope="session")
def slow_swing() -> Swing:
    """Each joint at a frequency of its own, so that their forces are told apart."""
    return _swing
