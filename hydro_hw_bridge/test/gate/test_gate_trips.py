"""The gate's permissives, trips and faults, and how it is cleared.

With `test_gate_commands` and `test_output_ramp` the line and branch coverage of gate.py is
complete.
"""

from __future__ import annotations

import math
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


PERMISSIVES = [
    ({"emergency_stop_ok": False}, "emergency stop"),
    ({"pump_on": False}, "pump is off"),
    ({"enable_switch": False}, "enable switch is off"),
    ({"supply_pa": math.nextafter(2.0e6, 0.0)}, "supply pressure 20.0 bar"),
    ({"supply_pa": math.nan}, "supply pressure nan bar"),
]


@pytest.mark.parametrize(("change", "reason"), PERMISSIVES)
def test_every_permissive_trips_while_driving(
    driving: Make, assert_tripped: Make, change: dict[str, Any], reason: str
) -> None:
    gate = driving(1.0)
    gate.check(replace(GOOD, **change))
    assert_tripped(gate, reason)
    told = gate.reason
    assert gate.clear() == (False, f"still there: {told}")
    gate.check(GOOD)
    assert gate.clear() == (True, f"cleared: {told}")
    assert gate.state is GateState.WAITING


@pytest.mark.parametrize(("change", "reason"), PERMISSIVES)
def test_every_permissive_is_needed_to_begin(
    waiting: Make, assert_tripped: Make, change: dict[str, Any], reason: str
) -> None:
    gate = waiting(100, **change)
    assert gate.state is GateState.WAITING
    assert gate.command(100, NAMES, (0.0, 0.0)) is Outcome.DENIED
    assert_tripped(gate, reason)


def test_supply_at_its_minimum_is_enough(driving: Make) -> None:
    gate = driving(1.0)
    gate.check(replace(GOOD, supply_pa=2.0e6))
    assert gate.state is GateState.DRIVING


def test_no_minimum_means_supply_is_not_checked() -> None:
    gate = Gate(replace(LIMITS, min_supply_pa=0.0))
    gate.advance(1)
    gate.check(replace(GOOD, supply_pa=math.nan))
    assert gate.command(1, NAMES, (0.0, 0.0)) is Outcome.ACCEPTED


def test_amplifier_watchdog_counts_once_the_amplifiers_had_time_to_enable(
    waiting: Make, assert_tripped: Make
) -> None:
    gate = waiting(100, amplifier_watchdog=True)
    barked = replace(GOOD, amplifier_watchdog=True)
    for counter in range(100, 106):
        gate.advance(counter)
        gate.check(barked)
        assert gate.command(counter, NAMES, (0.0, 0.0)) is Outcome.ACCEPTED
    gate.advance(106)
    gate.check(barked)
    assert_tripped(gate, "watchdog")
    # Disabled amplifiers cannot clear their watchdog: it does not keep the trip.
    assert gate.clear()[0]


def test_a_trip_keeps_its_first_reason_and_denies_everything(
    driving: Make, step: Make, assert_tripped: Make
) -> None:
    gate = driving(1.0)
    gate.trip("first")
    gate.trip("second")
    assert gate.reason == "first"
    assert gate.trips == 1
    assert step(gate, 101, 0.0, 0.0) is Outcome.DENIED
    gate.advance(500)
    gate.check(replace(GOOD, pump_on=False))
    assert_tripped(gate, "first")


def test_a_trip_survives_deactivation(driving: Make, assert_tripped: Make) -> None:
    gate = driving(1.0)
    gate.trip("reason")
    gate.arm()
    assert_tripped(gate, "reason")


def test_clear_without_a_trip(waiting: Make, driving: Make) -> None:
    assert waiting().clear() == (True, "not tripped (waiting)")
    assert driving().clear() == (True, "not tripped (driving)")


def test_clear_is_refused_while_bad_commands_keep_coming(driving: Make) -> None:
    gate = driving(1.0)
    gate.advance(101)
    gate.command(101, NAMES, (math.nan, 0.0))
    assert gate.clear()[1].startswith("still there: lift_valve: command is not finite")
    gate.advance(106)
    assert not gate.clear()[0]
    gate.advance(107)
    assert gate.clear()[0]


def test_clear_follows_a_good_command_at_once(driving: Make, step: Make) -> None:
    gate = driving(1.0)
    gate.advance(101)
    gate.command(101, NAMES, (11.0, 0.0))
    assert "command of 11.000 V (rated 10 V)" in gate.clear()[1]
    assert step(gate, 102, 1.0, 0.0) is Outcome.DENIED
    assert gate.clear() == (True, "cleared: lift_valve: command of 11.000 V (rated 10 V)")
    assert gate.output == OFF


def test_clear_before_any_cycle() -> None:
    gate = Gate(LIMITS)
    gate.trip("test")
    assert gate.clear() == (False, "still there: no complete cycle from the device yet")


def test_faults_trip_and_hold(driving: Make, assert_tripped: Make) -> None:
    gate = driving(1.0)
    gate.set_fault("second_bridge", "a second bridge is on the bus")
    assert_tripped(gate, "second bridge")
    assert gate.clear() == (False, "still there: a second bridge is on the bus")
    gate.end_fault("second_bridge")
    gate.end_fault("second_bridge")
    assert gate.clear()[0]


def test_arming_with_a_fault_trips(waiting: Make, assert_tripped: Make) -> None:
    gate = waiting()
    gate.faults["x"] = "standing fault"
    gate.arm()
    assert_tripped(gate, "standing fault")


def test_a_restarted_device_is_a_new_beginning(waiting: Make) -> None:
    gate = waiting(100)
    gate.forget()
    assert gate.command(100, NAMES, (0.0, 0.0)) is Outcome.DENIED
    gate.advance(1)
    gate.check(GOOD)
    assert gate.clear()[0]
    assert gate.command(1, NAMES, (0.0, 0.0)) is Outcome.ACCEPTED


def test_defects_of_before_a_restart_are_forgotten(driving: Make) -> None:
    gate = driving()
    gate.advance(101)
    gate.command(101, NAMES, (math.nan, 0.0))
    gate.forget()
    gate.check(GOOD)
    assert gate.clear()[0]
