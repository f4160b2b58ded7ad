"""Settings that a bridge cannot keep on a machine are refused before it starts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.node.bridge_start import gate_limits, not_quite_zero
from hydro_hw_bridge.node.parameters import PARAMETERS, PUBLISHED_CYCLE_TOPICS, settings_from
from hydro_hw_bridge.protocol.codec import Codec
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import CYCLE_TOPICS


def settings(**changes: Any) -> Any:
    return settings_from({rule.name: rule.default for rule in PARAMETERS} | changes)


def at_rate(robot: Robot, rate_hz: float) -> Robot:
    return replace(robot, sensors=replace(robot.sensors, rate_hz=rate_hz))


@pytest.mark.parametrize(
    ("rate_hz", "max_age_ms", "cycles"), [(500.0, 10.0, 5), (1000.0, 10.0, 10), (100.0, 20.0, 2)]
)
def test_ages_are_whole_cycles(
    robot: Robot, rate_hz: float, max_age_ms: float, cycles: int
) -> None:
    limits = gate_limits(settings(max_age_ms=max_age_ms), at_rate(robot, rate_hz))
    assert limits.max_age_cycles == cycles


def test_an_age_that_a_slow_machine_cannot_keep_is_refused(robot: Robot) -> None:
    """The next cycle is never there on the dot: every one would trip now and then."""
    said = "'max_age_ms': expected at least 20 ms, 2 cycles of the device at 100 Hz"
    with pytest.raises(BridgeError, match=said):
        gate_limits(settings(clock="real_time"), at_rate(robot, 100.0))
    assert gate_limits(settings(clock="lockstep"), at_rate(robot, 100.0)).max_age_cycles == 1
    with pytest.raises(BridgeError, match="expected at least 20 ms, 1 cycles of the device"):
        gate_limits(settings(clock="lockstep"), at_rate(robot, 50.0))


def test_a_valve_to_which_0_v_cannot_be_told_is_named_with_what_it_gets(
    codec: Codec, coarse: Codec
) -> None:
    assert not_quite_zero(codec) == []
    (line,) = not_quite_zero(coarse)
    assert line.startswith(f"{coarse.mapping.source}: 0 V of valve 'lift_valve' is no whole count")
    assert line.endswith("it gets +20 mV")


def test_topics_that_it_can_wait_for_carry_a_message_per_cycle() -> None:
    assert set(PUBLISHED_CYCLE_TOPICS) <= set(CYCLE_TOPICS)
    text = " ".join(f"{topic}:1" for topic in PUBLISHED_CYCLE_TOPICS)
    required = settings(required_subscribers=text).required_subscribers
    assert required == dict.fromkeys(PUBLISHED_CYCLE_TOPICS, 1)
