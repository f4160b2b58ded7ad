"""The plausibility of readings exactly at its limits, on the codec's own numbers.

With `test_plausibility` the line and branch coverage of plausibility.py is complete.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import pytest

from hydro_hw_bridge.monitoring.plausibility import ReadingsWatch, Verdict
from hydro_hw_bridge.protocol.bridge_step import ReadingCounters
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Readings
from hydro_model.robot import Robot

Make = Callable[..., Readings]
PERIOD_S = 0.002
SHUT = (0.0, 0.0)
PRESSURES = (5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 1.0e6)


@pytest.fixture
def watch(codec: Codec) -> ReadingsWatch:
    return ReadingsWatch(codec, PERIOD_S)


def _watching(codec: Codec, robot: Robot) -> ReadingsWatch:
    other = copy.copy(codec)
    other.robot = robot
    return ReadingsWatch(other, PERIOD_S)


def _noisy(k: int) -> tuple[float, ...]:
    return tuple(p + 500.0 * (k % 2) for p in PRESSURES)


def test_records() -> None:
    names = ("jumps", "out_of_range", "stuck", "still", "strokes", "temperatures")
    assert asdict(ReadingCounters()) == dict.fromkeys(names, 0)
    assert ReadingCounters(jumps=2).jumps == 2
    assert not hasattr(ReadingCounters(), "__dict__")
    verdict = Verdict("a", "b")
    assert not hasattr(verdict, "__dict__")
    with pytest.raises(AttributeError):
        verdict.passing = ""  # type: ignore[misc]


@pytest.mark.parametrize("cycles", [1, 5, 2000])
def test_a_jump_is_four_times_the_speed_limit_and_sixteen_counts(
    watch: ReadingsWatch, codec: Codec, readings: Make, cycles: int
) -> None:
    limit = codec.robot.joints[0].velocity_limit
    most = 4.0 * limit * PERIOD_S * cycles + 16 * abs(codec.position_steps[0])
    for moved, told in ((most, False), (math.nextafter(most, 99.0), True)):
        watch.forget()
        watch.look(readings(0, positions=(0.0, -0.5)), 7, SHUT)
        after = readings(0, positions=(moved, -0.5), pressures_pa=_noisy(1))
        found = watch.look(after, 7 + cycles, SHUT)
        said = f"lift: position jumped by {most:.4f} in {2 * cycles} ms (at most {most:.4f})"
        assert found == Verdict(passing=said if told else "")
    assert watch.newest == said


def test_a_cycle_that_is_seen_again_counts_as_one(
    watch: ReadingsWatch, codec: Codec, readings: Make
) -> None:
    fast = codec.robot.joints[0].velocity_limit * PERIOD_S
    watch.look(readings(0, positions=(0.3, -0.5)), 7, SHUT)
    assert watch.look(readings(0, positions=(0.3 + 4.0 * fast, -0.5)), 7, SHUT) == Verdict()


def test_pressures_at_their_limits(codec: Codec, readings: Make) -> None:
    robot = replace(
        codec.robot,
        atmospheric_pressure_pa=1.0e9,
        sensors=replace(codec.robot.sensors, pressure_range_pa=2.0e9),
    )
    low, high = -1.0e9 - 1.0e5, 1.2 * 2.0e9
    for value, wrong in (
        (low, False),
        (high, False),
        (math.nextafter(low, -math.inf), True),
        (math.nextafter(high, math.inf), True),
    ):
        watch = _watching(codec, robot)
        found = watch.look(readings(0, pressures_pa=(value, *PRESSURES[1:])), 0, SHUT)
        said = f"{value / 1e5:.1f} bar gauge (from -10001.0 to 24000.0 bar)"
        expected = f"pressure {codec.pressure_names[0]} cannot be {said}" if wrong else ""
        assert found == Verdict(standing=expected)


def _when_stuck(watch: ReadingsWatch, readings: Make, cycles: int, moves: int = -1) -> list[int]:
    """Counters at which the lift's encoder was found stuck under an open valve."""
    found, at = [], 0.3
    for k in range(cycles):
        at += 1e-3 * (k == moves)
        now = readings(k, positions=(at, -0.5), pressures_pa=_noisy(k))
        if "encoder stuck" in watch.look(now, k, (9.0, 0.0)).passing:
            found.append(k)
    return found


def test_an_encoder_is_stuck_after_half_a_second_and_again(
    watch: ReadingsWatch, readings: Make
) -> None:
    assert _when_stuck(watch, readings, 760) == [250, 500, 750]
    assert watch.counters.stuck == 3
    assert watch.newest == ("lift: encoder stuck, not a count in 0.5 s with lift_valve at 9.00 V")
    watch.forget()
    assert _when_stuck(watch, readings, 260) == [250]


def test_motion_begins_the_half_second_anew(watch: ReadingsWatch, readings: Make) -> None:
    assert _when_stuck(watch, readings, 400, moves=100) == [350]


def _in_turns(
    watch: ReadingsWatch, readings: Make, open_: int, shut: int, turns: int
) -> list[int]:
    """Counters at which the lift's encoder was found stuck, its valve open and shut in turns."""
    found = []
    for k in range((open_ + shut) * turns):
        turn, at = divmod(k, open_ + shut)
        volts = (9.0 if turn % 2 else -9.0, 0.0) if at < open_ else SHUT
        now = readings(k, pressures_pa=_noisy(k))
        if "encoder stuck" in watch.look(now, k, volts).passing:
            found.append(k)
    return found


def test_a_valve_that_opens_now_and_then_makes_no_encoder_stuck(
    watch: ReadingsWatch, readings: Make
) -> None:
    # A hold around an overlap: 10 ms of a second. And a 33rd of the time.
    assert _in_turns(watch, readings, 5, 495, 120) == []
    assert _in_turns(watch, readings, 10, 320, 60) == []


def test_shut_before_it_opens_is_no_time_gained_or_lost(
    watch: ReadingsWatch, readings: Make
) -> None:
    found = []
    for k in range(300):
        volts = SHUT if k < 10 else (9.0, 0.0)
        if "encoder stuck" in watch.look(readings(k, pressures_pa=_noisy(k)), k, volts).passing:
            found.append(k)
    assert found == [10 + 249]


def test_what_is_forgotten_goes_by_time_whatever_cycles_are_lost(
    watch: ReadingsWatch, readings: Make
) -> None:
    # Open for 200 cycles, shut for 3200 of which every second is lost, open again.
    counters = [*range(201), *range(202, 3402, 2), *range(3401, 3700)]
    found = []
    for k in counters:
        volts = (9.0, 0.0) if 0 < k <= 200 or k > 3400 else SHUT
        if "encoder stuck" in watch.look(readings(k, pressures_pa=_noisy(k)), k, volts).passing:
            found.append(k)
    assert found == [3400 + 150]


def test_of_a_valve_that_swings_a_stuck_encoder_is_found_all_the_same(
    watch: ReadingsWatch, readings: Make
) -> None:
    # Turns of 55 count 50 - 5 / 32: five, less the first look, and the second of the next one.
    found = _in_turns(watch, readings, 50, 5, 10)
    assert found == [5 * 55 + 1]


@pytest.mark.parametrize("changes", [-1, 100])
def test_a_pressure_is_still_after_two_seconds_and_again(
    watch: ReadingsWatch, readings: Make, changes: int
) -> None:
    when = []
    for k in range(2150):
        first = PRESSURES[0] + 500.0 * (k >= changes > 0)
        now = readings(k, pressures_pa=(first, *_noisy(k)[1:]))
        before = watch.counters.still
        assert watch.look(now, k, SHUT) == Verdict()
        when += [k] * (watch.counters.still - before)
    begin = max(changes, 0)
    assert when == [begin + 1000, begin + 2000]
    watch.forget()
    for k in range(1001):
        watch.look(readings(k, pressures_pa=(PRESSURES[0], *_noisy(k)[1:])), k, SHUT)
        assert watch.counters.still == 2 + (k == 1000)


def test_pressures_with_noise_are_never_still(watch: ReadingsWatch, readings: Make) -> None:
    for k in range(2100):
        watch.look(readings(k, pressures_pa=_noisy(k)), k, SHUT)
    assert watch.counters.still == 0


def test_a_joint_without_a_valve_is_passed_over_and_the_next_is_not(
    codec: Codec, readings: Make
) -> None:
    robot = copy.copy(codec.robot)
    object.__setattr__(robot, "valves", codec.robot.valves[1:])
    watch = _watching(codec, robot)
    said = [watch.look(readings(k), k, (9.0, 9.0)).passing for k in range(251)]
    assert [text for text in said if text] == [said[250]]
    assert said[250].startswith("tilt: encoder stuck")


def test_of_two_valves_at_a_cylinder_the_first_is_looked_at(codec: Codec, readings: Make) -> None:
    first, second = codec.robot.valves
    robot = copy.copy(codec.robot)
    valves = (first, replace(second, cylinder=first.cylinder))
    object.__setattr__(robot, "valves", valves)
    for volts, told in (((9.0, 0.0), True), ((0.0, 9.0), False)):
        watch = _watching(codec, robot)
        said = [watch.look(readings(k), k, volts).passing for k in range(251)]
        assert any(said) == told


@pytest.mark.parametrize("changes", [{"pressures_pa": PRESSURES[:-1]}, {}])
def test_readings_of_another_shape_are_no_readings(
    watch: ReadingsWatch, readings: Make, changes: dict[str, Any]
) -> None:
    watch.look(readings(0), 0, SHUT)
    with pytest.raises(ValueError, match="argument"):
        watch.look(readings(1, **changes), 1, SHUT if changes else SHUT[:1])
