"""The amplifiers' enable chain, watchdog, saturation and delay."""

import numpy as np
import pytest

from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.rig.amplifier import Amplifier

CYCLE_S = 0.002
RATED_V = np.array([10.0, 10.0])


def _driving(delay: int = 0) -> Amplifier:
    amplifier = Amplifier(RATED_V, CYCLE_S, delay)
    for _ in range(delay + 1):
        amplifier.step([1.0, -2.0], True, True)
    assert amplifier.enabled
    return amplifier


@pytest.mark.parametrize(("missing", "off"), [(1, False), (24, False), (25, True), (26, True)])
def test_watchdog_trips_at_50_ms_and_not_before(missing: int, off: bool) -> None:
    amplifier = _driving()
    for _ in range(missing):
        output = amplifier.step(None, False, True)
    assert amplifier.tripped is off
    assert amplifier.enabled is not off
    np.testing.assert_array_equal(output, [0.0, 0.0] if off else [1.0, -2.0])
    assert amplifier.trips == int(off)


@pytest.mark.parametrize("cycle_s", [0.05, 0.2])
def test_where_a_cycle_is_as_long_as_the_watchdog_one_missing_frame_trips(cycle_s: float) -> None:
    amplifier = Amplifier(RATED_V[:1], cycle_s, 0)
    amplifier.step([1.0], True, True)
    assert amplifier.step(None, False, True)[0] == 0.0
    assert amplifier.tripped


def test_one_frame_in_time_starts_the_watchdog_anew() -> None:
    amplifier = _driving()
    for _ in range(10):
        for _ in range(24):
            amplifier.step(None, False, True)
        amplifier.step([1.0, 1.0], True, True)
    assert not amplifier.tripped


def test_trip_holds_until_enable_goes_off_and_on() -> None:
    amplifier = _driving()
    for _ in range(25):
        amplifier.step(None, False, True)
    for _ in range(100):
        np.testing.assert_array_equal(amplifier.step([5.0, 5.0], True, True), [0.0, 0.0])
    states = [amplifier.tripped]
    np.testing.assert_array_equal(amplifier.step([5.0, 5.0], False, True), [0.0, 0.0])
    states.append(amplifier.tripped)
    assert states == [True, False]
    np.testing.assert_array_equal(amplifier.step([5.0, 5.0], True, True), [5.0, 5.0])


def test_watchdog_sleeps_while_disabled() -> None:
    amplifier = Amplifier(RATED_V[:1], CYCLE_S, 0)
    for _ in range(100):
        amplifier.step(None, False, True)
    assert not amplifier.tripped


def test_missing_permissive_switches_off_at_once_and_on_with_the_next_frame() -> None:
    amplifier = _driving()
    np.testing.assert_array_equal(amplifier.step([1.0, 1.0], True, False), [0.0, 0.0])
    assert not amplifier.enabled
    np.testing.assert_array_equal(amplifier.step([1.0, 1.0], True, True), [1.0, 1.0])
    np.testing.assert_array_equal(amplifier.step(None, False, False), [0.0, 0.0])


def test_output_saturates() -> None:
    amplifier = _driving()
    np.testing.assert_array_equal(amplifier.step([14.0, -11.0], True, True), [10.0, -10.0])


def test_a_valve_that_is_rated_for_more_gets_it() -> None:
    amplifier = Amplifier(np.array([24.0, 5.0]), CYCLE_S, 0)
    np.testing.assert_array_equal(amplifier.step([24.0, 10.0], True, True), [24.0, 10.0])
    np.testing.assert_array_equal(amplifier.step([25.0, -11.0], True, True), [24.0, -10.0])


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_command_comes_out_after_its_delay(delay: int) -> None:
    amplifier = Amplifier(RATED_V[:1], CYCLE_S, delay)
    outputs = [float(amplifier.step([float(k)], True, True)[0]) for k in range(1, 8)]
    assert outputs == [0.0] * delay + [float(k) for k in range(1, 8 - delay)]


def test_commands_from_before_a_trip_never_come_out() -> None:
    amplifier = _driving(delay=3)
    amplifier.step([9.0, 9.0], True, True)
    amplifier.step([9.0, 9.0], False, True)
    outputs = [amplifier.step([1.0, 1.0], True, True) for _ in range(5)]
    np.testing.assert_array_equal(np.max(outputs), 1.0)


@pytest.mark.parametrize("voltages", [[1.0], [1.0, 2.0, 3.0], [np.nan, 0.0], [np.inf, 0.0]])
def test_voltages_that_are_none_are_refused(voltages: list[float]) -> None:
    with pytest.raises(BridgeError, match="expected 2 finite voltages"):
        _driving().step(voltages, True, True)
