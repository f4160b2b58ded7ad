"""Gates of the bridge, and how they are driven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.gate.gate import Gate, GateState, Outcome, Output
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.permissives import Inputs

NAMES = ("lift_valve", "tilt_valve")
#: 2 V legal per 2 ms cycle, tripping above 4 V; 5 cycles are 10 ms.
LIMITS = GateLimits(NAMES, (10.0, 8.0), 0.002, 1000.0, 5, 2.0e6)
GOOD = Inputs(True, True, True, False, 19.0e6)
OFF = Output((0.0, 0.0), enable=False)
Make = Callable[..., Any]


def _waiting(newest: int = 100, limits: GateLimits = LIMITS, **inputs: Any) -> Gate:
    gate = Gate(limits)
    gate.advance(newest)
    gate.check(replace(GOOD, **inputs))
    gate.arm()
    return gate


def _driving(lift: float = 0.0, tilt: float = 0.0, limits: GateLimits = LIMITS) -> Gate:
    """A gate that accepted (lift, tilt) for cycle 100, with its first ramp over."""
    gate = _waiting(90, limits)
    for counter in range(90, 101):
        _step(gate, counter, lift, tilt)
    assert gate.output == Output((lift, tilt), enable=True)
    return gate


def _step(gate: Gate, counter: int, lift: float, tilt: float) -> Outcome:
    gate.advance(counter)
    gate.check(GOOD)
    return gate.command(counter, NAMES, (lift, tilt))


def _assert_tripped(gate: Gate, reason: str) -> None:
    assert gate.state is GateState.TRIPPED
    assert reason in gate.reason
    assert gate.output == OFF


@pytest.fixture
def waiting() -> Make:
    """`waiting(newest=100, limits=LIMITS, **inputs)`: a gate that waits for a first command."""
    return _waiting


@pytest.fixture
def driving() -> Make:
    """`driving(lift=0.0, tilt=0.0, limits=LIMITS)`: a gate that accepted them for cycle 100."""
    return _driving


@pytest.fixture
def step() -> Make:
    """`step(gate, counter, lift, tilt)`: a cycle and its command."""
    return _step


@pytest.fixture
def assert_tripped() -> Make:
    """`assert_tripped(gate, reason)`: 0 V, and this reason."""
    return _assert_tripped
