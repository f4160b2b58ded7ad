"""Strokes and temperatures of the oil that no machine gives, at their limits, and sound ones.

With it the line and branch coverage of side_readings.py is complete.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hydro_hw_bridge.monitoring.side_readings import SideWatch
from hydro_hw_bridge.protocol.bridge_step import ReadingCounters
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Readings
from hydro_model.hydraulics.cylinder import joint_position, lever, stroke

Make = Callable[..., Readings]
PERIOD_S = 0.002
#: Of the reference crane's lift: its stroke, and one count of the sensor that stands in.
FULL_M, COUNT_M = 0.59, 0.00005


class Side:
    """A watch, and the cycles it is shown."""

    def __init__(self, codec: Codec, make: Make) -> None:
        self.codec, self.make = codec, make
        self.counters = ReadingCounters()
        self.watch = SideWatch(codec, PERIOD_S, self.counters)
        self.last: Readings | None = None

    def says(self, stroke_m: float = 0.2, cycles: int = 1, **others: Any) -> str:
        """What is said of a cycle with this stroke."""
        now = self.make(0, strokes_m=(stroke_m,), **others)
        said = self.watch.look(self.last, now, cycles)
        self.last = now
        return said

    def counted(self) -> tuple[int, int]:
        """Cycles with wrong strokes and with wrong temperatures."""
        return self.counters.strokes, self.counters.temperatures


@pytest.fixture
def side(sensed: Codec, readings: Make) -> Side:
    return Side(sensed, readings)


def _angle(codec: Codec, stroke_m: float) -> float:
    """Where the lift stands at a stroke."""
    return float(joint_position(codec.robot.cylinders[0], stroke_m))


LOWEST_M, HIGHEST_M = -0.1 * FULL_M, (1.0 + 0.1) * FULL_M


@pytest.mark.parametrize(
    ("value", "wrong"),
    [
        (LOWEST_M, False),
        (math.nextafter(LOWEST_M, -1.0), True),
        (HIGHEST_M, False),
        (math.nextafter(HIGHEST_M, 1.0), True),
        (-1.0, True),
    ],
)
def test_a_stroke_beyond_its_cylinder_is_named_from_the_first_cycle_on(
    side: Side, value: float, wrong: bool
) -> None:
    said = side.says(value)
    words = f"lift_cylinder: stroke cannot be {value:.4f} m (from -0.0590 to 0.6490 m)"
    assert said == (words if wrong else "")
    assert side.says(value) == ""  # once, and counted on
    assert side.counted() == (2 * wrong, 0)
    side.watch.forget()
    side.last = None
    assert side.says(value) == said


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("cycles", [1, 5])
def test_a_piston_is_four_times_as_fast_as_its_joint_at_most(
    side: Side, sense: int, cycles: int
) -> None:
    cylinder = side.codec.robot.cylinders[0]
    limit = side.codec.robot.joints[0].velocity_limit
    most = 4.0 * (limit * cylinder.l2_m) * PERIOD_S * cycles + 16 * COUNT_M
    # The longest lever of all angles is not above what is counted on.
    angles = [0.001 * k for k in range(-1000, 2000)]
    assert max(abs(float(lever(cylinder, q))) for q in angles) <= cylinder.l2_m
    for moved, told in ((most, False), (math.nextafter(most, 1.0), True)):
        side.says(0.0)
        said = side.says(sense * moved, cycles)
        words = f"stroke jumped by {most:.4f} m in {2 * cycles} ms (at most {most:.4f} m)"
        assert said == (f"lift_cylinder: {words}" if told else "")
        side.watch.forget()
        side.last = None
    assert side.counted() == (1, 0)


@pytest.mark.parametrize(
    ("l1_m", "l2_m", "lever_m"), [(0.2, 0.4, 0.2), (0.9, 0.4, 0.4), (0.0, 0.0, 1.0)]
)
def test_the_lever_is_the_shorter_side_or_none(
    sensed: Codec, readings: Make, l1_m: float, l2_m: float, lever_m: float
) -> None:
    first = replace(sensed.robot.cylinders[0], l1_m=l1_m, l2_m=l2_m)
    robot = copy.copy(sensed.robot)
    object.__setattr__(robot, "cylinders", (first, *sensed.robot.cylinders[1:]))
    codec = copy.copy(sensed)
    codec.robot = robot
    most = 4.0 * robot.joints[0].velocity_limit * lever_m * PERIOD_S + 16 * COUNT_M
    for moved, told in ((most - 1e-9, False), (most + 1e-9, True)):
        side = Side(codec, readings)
        side.says(0.3)
        assert bool(side.says(0.3 + moved)) is told


@pytest.mark.parametrize("sense", [1, -1])
def test_a_stroke_that_stays_while_the_joint_moves_is_stuck(side: Side, sense: int) -> None:
    at_m, most = 0.3, 0.05 * FULL_M + 2 * COUNT_M
    side.says(at_m, positions=(_angle(side.codec, at_m), -0.5))
    for share, told in ((0.5, False), (0.999, False), (1.001, True)):
        there = _angle(side.codec, at_m + sense * share * most)
        said = side.says(at_m, positions=(there, -0.5))
        moved = 1.001 * most
        words = f"not a count while lift moved the piston by {moved:.4f} m"
        assert said == (f"lift_cylinder: stroke sensor stuck, {words}" if told else "")
    assert side.says(at_m, positions=(there, -0.5)) == ""
    assert side.counted() == (2, 0)
    # One count, and it is not stuck; nor is one that is at rest with its joint.
    assert side.says(at_m + COUNT_M, positions=(there, -0.5)) == ""
    for _ in range(2000):
        assert side.says(at_m + COUNT_M, positions=(there, -0.5)) == ""
    assert side.counted() == (2, 0)


def test_a_sensor_that_follows_its_joint_is_not_spoken_of(side: Side) -> None:
    cylinder = side.codec.robot.cylinders[0]
    for k in range(1500):
        q = 0.4 + 0.4 * math.sin(0.01 * k)
        counted = COUNT_M * round(float(stroke(cylinder, q)) / COUNT_M)
        assert side.says(counted + 0.02, positions=(q, -0.5)) == ""  # with a zero of its own
    assert side.counted() == (0, 0)


@pytest.mark.parametrize(
    ("value", "wrong"), [(-40.0, True), (-39.9, False), (129.9, False), (130.0, True)]
)
def test_oil_that_does_not_flow_or_burns_is_named(side: Side, value: float, wrong: bool) -> None:
    said = side.says(oil_temperature_c=value)
    words = f"oil temperature cannot be {value:.1f} deg C (from -40 to 130 deg C)"
    assert said == (words if wrong else "")
    assert side.says(oil_temperature_c=value) == ""
    assert side.counted() == (0, 2 * wrong)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("cycles", [1, 500])
def test_oil_changes_by_five_kelvin_and_five_a_second_at_most(
    side: Side, sense: int, cycles: int
) -> None:
    most = 5.0 + 5.0 * cycles * PERIOD_S
    side.says(oil_temperature_c=0.0)
    assert side.says(cycles=cycles, oil_temperature_c=sense * most) == ""
    side.says(cycles=5000, oil_temperature_c=0.0)
    said = side.says(cycles=cycles, oil_temperature_c=sense * math.nextafter(most, 99.0))
    words = f"jumped by {most:.1f} K in {2 * cycles} ms (at most {most:.1f} K)"
    assert said == f"oil temperature {words}"
    assert side.counted() == (0, 1)


def test_without_a_thermometer_nothing_is_said_of_it(side: Side) -> None:
    for value in (None, 40.0, None, 100.0):
        assert side.says(oil_temperature_c=value) == ""
    assert side.counted() == (0, 0)


def test_of_two_that_begin_at_once_the_first_is_said_and_both_are_counted(side: Side) -> None:
    side.says()
    assert "stroke cannot be" in side.says(1.0, oil_temperature_c=200.0)
    assert side.says(1.0, oil_temperature_c=200.0) == ""
    assert side.counted() == (2, 2)
    # Each by itself begins anew.
    assert side.says(0.2, cycles=100_000, oil_temperature_c=40.0) == ""
    assert "oil temperature cannot be" in side.says(0.2, oil_temperature_c=200.0)
    assert "stroke cannot be" in side.says(1.0, oil_temperature_c=200.0)
    assert side.counted() == (3, 4)
