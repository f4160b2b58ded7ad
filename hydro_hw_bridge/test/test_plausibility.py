"""Readings that no machine gives, and those that a sound one may give."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from hydro_hw_bridge.monitoring.plausibility import STILL_S, STUCK_S, ReadingsWatch, Verdict
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Readings

Make = Callable[..., Readings]
PERIOD_S = 0.002
SHUT = (0.0, 0.0)


@pytest.fixture
def watch(codec: Codec) -> ReadingsWatch:
    return ReadingsWatch(codec, PERIOD_S)


def test_sound_readings_are_not_spoken_of(watch: ReadingsWatch, readings: Make) -> None:
    for k in range(100):
        now = readings(k, positions=(0.3 + 1e-3 * k, -0.5 - 1e-3 * k))
        assert watch.look(now, k, (9.0, -9.0)) == Verdict()
    assert watch.newest == ""


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("cycles", [1, 5])
def test_a_jump_is_told_and_a_fast_joint_is_none(
    codec: Codec, readings: Make, joint: int, cycles: int
) -> None:
    speed = codec.robot.joints[joint].velocity_limit
    for times, told in ((3.9, False), (4.2, True)):
        watch = ReadingsWatch(codec, PERIOD_S)
        before, after = [0.3, -0.5], [0.3, -0.5]
        after[joint] += times * speed * PERIOD_S * cycles
        watch.look(readings(0, positions=tuple(before)), 0, SHUT)
        found = watch.look(readings(cycles, positions=tuple(after)), cycles, SHUT)
        assert ("position jumped" in found.passing) == told
        assert watch.counters.jumps == told
        # It is a thing of the past with the next cycle.
        found = watch.look(readings(cycles + 1, positions=tuple(after)), cycles + 1, SHUT)
        assert found == Verdict()


@pytest.mark.parametrize(
    ("value", "wrong"),
    [(-1.9e5, False), (-2.1e5, True), (-1.0e6, True), (29.9e6, False), (30.1e6, True)],
)
@pytest.mark.parametrize("place", range(6))
def test_pressures_that_cannot_be(
    watch: ReadingsWatch, codec: Codec, readings: Make, value: float, wrong: bool, place: int
) -> None:
    pressures = [5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 1.0e6]
    pressures[place] = value
    found = watch.look(readings(0, pressures_pa=tuple(pressures)), 0, SHUT)
    assert (codec.pressure_names[place] in found.standing) == wrong
    assert watch.counters.out_of_range == wrong


@pytest.mark.parametrize("volts", [1.9, 2.0, -9.0])
def test_an_encoder_is_stuck_under_an_open_valve_only(
    watch: ReadingsWatch, readings: Make, volts: float
) -> None:
    said = [
        watch.look(readings(k), k, (volts, 0.0)).passing
        for k in range(int(STUCK_S / PERIOD_S) + 2)
    ]
    told = [text for text in said if text]
    assert len(told) == (abs(volts) >= 2.0)
    assert all(text.startswith("lift: encoder stuck") for text in told)


def test_a_single_count_is_motion(watch: ReadingsWatch, codec: Codec, readings: Make) -> None:
    count = codec.position_steps[0]
    for k in range(600):
        positions = (0.3 + count * (k // 200), -0.5)
        assert watch.look(readings(k, positions=positions), k, (9.0, 0.0)) == Verdict()


def test_a_pressure_without_noise_is_named_and_stops_nothing(
    watch: ReadingsWatch, readings: Make
) -> None:
    cycles = int(STILL_S / PERIOD_S)
    for k in range(cycles + 1):
        noise = 500.0 * (k % 2)
        now: Any = readings(
            k, pressures_pa=(5e6, 2e6 + noise, 3e6 + noise, 4e6 + noise, 19e6, 1e6)
        )
        assert watch.look(now, k, SHUT) == Verdict()
    assert watch.counters.still == 3
    assert "without any noise" in watch.newest


def test_a_device_that_counts_anew_has_not_jumped(watch: ReadingsWatch, readings: Make) -> None:
    watch.look(readings(900), 900, SHUT)
    watch.forget()
    assert watch.look(readings(0, positions=(1.2, -2.0)), 0, SHUT) == Verdict()


def test_what_drives_nothing_is_named_and_ends_nothing(sensed: Codec, readings: Make) -> None:
    watch = ReadingsWatch(sensed, PERIOD_S)
    wrong = {"strokes_m": (0.9,), "oil_temperature_c": 200.0}
    said = "lift_cylinder: stroke cannot be 0.9000 m (from -0.0590 to 0.6490 m)"
    assert watch.look(readings(0, **wrong), 0, SHUT) == Verdict()
    assert (watch.newest, watch.counters.strokes, watch.counters.temperatures) == (said, 1, 1)
    # What may end driving is told in its place, and stays: it is said once.
    pressures = (99.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 1.0e6)
    found = watch.look(readings(1, pressures_pa=pressures, **wrong), 1, SHUT)
    assert watch.newest == found.standing != ""
    watch.look(readings(2, **wrong), 2, SHUT)
    assert watch.newest == found.standing
    # A device that counts anew is told anew.
    watch.forget()
    assert watch.look(readings(0, **wrong), 0, SHUT) == Verdict()
    assert (watch.newest, watch.counters.strokes) == (said, 4)
    # Once it is over it is still the newest.
    watch.look(readings(9, strokes_m=(0.2,), oil_temperature_c=40.0), 9, SHUT)
    watch.look(readings(10, strokes_m=(0.2,), oil_temperature_c=40.0), 10, SHUT)
    assert watch.newest
