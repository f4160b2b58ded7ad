"""What of the gate only a changed source showed to be untested (`scripts/mutants.sh`)."""

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


@pytest.mark.parametrize(
    ("record", "field"), [(LIMITS, "max_age_cycles"), (GOOD, "pump_on"), (OFF, "enable")]
)
def test_records_cannot_be_changed(record: object, field: str) -> None:
    with pytest.raises(AttributeError):
        setattr(record, field, 99)
    assert not hasattr(record, "__dict__")


@pytest.mark.parametrize(("most", "first"), [(1, 1), (2, 1), (3, 1), (4, 2), (5, 2), (6, 3)])
def test_a_first_command_is_at_most_half_as_old_but_may_be_a_cycle(most: int, first: int) -> None:
    found = replace(LIMITS, max_age_cycles=most).first_age_cycles
    assert (found, type(found)) == (first, int)


@pytest.mark.parametrize("newest", [100, 103, 104, 128, 1025])
def test_age_of_a_first_command_whatever_the_counter(newest: int) -> None:
    for age, outcome in ((0, True), (1, True), (2, True), (3, False), (4, False)):
        gate = Gate(LIMITS)
        gate.advance(newest)
        gate.check(GOOD)
        answer = gate.command(newest - age, NAMES, (0.0, 0.0))
        assert answer is (Outcome.ACCEPTED if outcome else Outcome.OUTDATED)


def test_it_begins_without_a_reason_and_takes_the_very_first_cycle() -> None:
    gate = Gate(LIMITS)
    assert (gate.state, gate.reason, gate.trips) == (GateState.WAITING, "", 0)
    gate.advance(0)
    gate.check(GOOD)
    assert gate.command(0, NAMES, (1.0, 0.0)) is Outcome.ACCEPTED


def test_armed_before_any_cycle_it_takes_the_very_first() -> None:
    gate = Gate(LIMITS)
    gate.arm()
    gate.advance(0)
    gate.check(GOOD)
    assert gate.command(0, NAMES, (1.0, 0.0)) is Outcome.ACCEPTED


def test_a_device_that_counts_anew_is_driven_from_its_first_cycle(waiting: Make) -> None:
    gate = waiting(100)
    gate.forget()
    gate.advance(0)
    gate.check(GOOD)
    assert gate.command(0, NAMES, (1.0, 0.0)) is Outcome.ACCEPTED


def test_a_defect_of_before_a_restart_is_none_of_the_new_cycles(driving: Make) -> None:
    gate = driving()
    gate.advance(101)
    gate.command(101, NAMES, (math.nan, 0.0))
    gate.forget()
    gate.advance(1)
    gate.check(GOOD)
    assert gate.clear()[0]


def test_what_was_asked_before_clearing_does_not_drive(driving: Make) -> None:
    gate = driving(1.0)
    gate.trip("test")
    gate.advance(103)
    gate.check(GOOD)
    assert gate.clear()[0]
    assert gate.command(102, NAMES, (1.0, 0.0)) is Outcome.OUTDATED
    assert gate.command(103, NAMES, (1.0, 0.0)) is Outcome.ACCEPTED


def test_a_defect_of_before_any_cycle_counts_from_zero() -> None:
    gate = Gate(LIMITS)
    gate.command(None, NAMES, (math.nan, 0.0))
    gate.check(GOOD)
    gate.advance(5)
    assert not gate.clear()[0]
    gate.advance(6)
    assert gate.clear()[0]


def test_stamps_are_compared_by_value() -> None:
    gate = Gate(LIMITS)
    for counter in (1000, int("1001")):
        gate.advance(counter)
        gate.check(GOOD)
        assert gate.command(counter, NAMES, (1.0, 0.0)) is Outcome.ACCEPTED
    assert gate.command(int("1001"), NAMES, (float("1"), 0.0)) is Outcome.REPEATED
    assert gate.command(int("1000"), NAMES, (1.0, 0.0)) is Outcome.OUTDATED


def test_a_late_step_of_the_first_ramp_is_one_step(waiting: Make) -> None:
    gate = waiting(100)
    gate.command(100, NAMES, (7.0, 0.0))
    gate.advance(102)
    gate.check(GOOD)
    assert gate.command(102, NAMES, (7.0, 0.0)) is Outcome.ACCEPTED
    assert gate.output.voltages == (4.0, 0.0)


def test_the_rate_limit_itself_is_legal(driving: Make, step: Make) -> None:
    assert step(driving(), 101, 2.0 * LIMITS.legal_step_v + 1e-9, 0.0) is Outcome.ACCEPTED


def test_limits_that_contradict_themselves_let_nothing_pass() -> None:
    gate = Gate(replace(LIMITS, rated_voltage_v=(10.0,)))
    gate.advance(1)
    gate.check(GOOD)
    with pytest.raises(ValueError, match="shorter"):
        gate.command(1, NAMES, (1.0, 1.0))
    assert gate.output == OFF


def test_any_minimum_above_zero_is_checked(assert_tripped: Make) -> None:
    gate = Gate(replace(LIMITS, min_supply_pa=0.5))
    gate.advance(1)
    gate.check(replace(GOOD, supply_pa=0.4))
    assert gate.command(1, NAMES, (0.0, 0.0)) is Outcome.DENIED
    assert_tripped(gate, "supply pressure 0.0 bar gauge (minimum 0.0 bar)")


def test_reasons_give_the_numbers(waiting: Make, driving: Make) -> None:
    gate = Gate(replace(LIMITS, min_supply_pa=1.0e9))
    gate.advance(1)
    gate.check(replace(GOOD, supply_pa=9.9e8))
    gate.command(1, NAMES, (0.0, 0.0))
    assert gate.reason == "supply pressure 9900.0 bar gauge (minimum 10000.0 bar)"
    gate = driving()
    gate.advance(1100)
    assert gate.reason == "no command for 2000 ms (limit 10 ms)"
    expected = "expected each of lift_valve, tilt_valve once"
    for names, voltages, said in (
        ((), (), f"command for valves none with 0 voltages, {expected}"),
        (NAMES[:1], (1.0,), f"command for valves lift_valve with 1 voltages, {expected}"),
    ):
        gate = waiting(100)
        gate.command(100, names, voltages)
        assert gate.reason == said


@pytest.mark.parametrize(
    ("whole", "missing", "said"),
    [
        (None, ("ENCODERS",), "no command for 12 ms (limit 10 ms)"),
        (105, ("ENCODERS",), "no command for 12 ms (limit 10 ms)"),
        (102, ("ENCODERS",), "no command for 12 ms (limit 10 ms)"),
        (101, (), "no whole cycle for 10 ms (limit 10 ms)"),
        (100, ("A", "B"), "no whole cycle for 12 ms, missing A, B (limit 10 ms)"),
    ],
)
def test_where_there_was_nothing_to_answer_that_is_the_reason(
    driving: Make, whole: int | None, missing: tuple[str, ...], said: str
) -> None:
    gate = driving()
    gate.advance(105, whole, missing)
    assert gate.reason == ""
    gate.advance(106, whole, missing)
    assert gate.reason == said


def test_the_greatest_age_in_seconds() -> None:
    assert LIMITS.max_age_s == 0.010


def test_a_step_at_the_limit_less_its_rounding_is_taken_whole(driving: Make) -> None:
    """A command after a missing one, nearer to the limit of one cycle than rounding tells."""
    most = 2.0 * LIMITS.legal_step_v
    for value in (most - 0.5e-9, most, most + 0.5e-9, most + 1e-9):
        gate = driving()
        gate.advance(102)
        gate.check(GOOD)
        assert gate.command(102, NAMES, (value, 0.0)) is Outcome.ACCEPTED
        assert gate.output.voltages[0] == value
