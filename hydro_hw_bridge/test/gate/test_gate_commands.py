"""The gate and its commands at and around every limit."""

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


def test_default_is_deny(assert_tripped: Make) -> None:
    gate = Gate(LIMITS)
    assert gate.output == OFF
    assert gate.command(5, NAMES, (0.0, 0.0)) is Outcome.DENIED
    assert_tripped(gate, "of no complete cycle")


def test_first_command_before_a_complete_cycle_is_denied(assert_tripped: Make) -> None:
    gate = Gate(LIMITS)
    gate.advance(5)
    assert gate.command(5, NAMES, (0.0, 0.0)) is Outcome.DENIED
    assert_tripped(gate, "no complete cycle from the device yet")


def test_waiting_never_ages_and_gives_zero(waiting: Make) -> None:
    gate = waiting(100)
    for counter in range(101, 1000):
        gate.advance(counter)
        gate.check(GOOD)
    assert gate.state is GateState.WAITING
    assert gate.output == OFF


def test_a_good_command_drives(waiting: Make) -> None:
    gate = waiting(100)
    assert gate.command(100, NAMES, (1.5, -1.0)) is Outcome.ACCEPTED
    assert gate.state is GateState.DRIVING
    assert gate.output == Output((1.5, -1.0), enable=True)


def test_names_in_another_order_are_sorted_out(waiting: Make) -> None:
    gate = waiting(100)
    assert gate.command(100, NAMES[::-1], (-1.0, 1.5)) is Outcome.ACCEPTED
    assert gate.output.voltages == (1.5, -1.0)


@pytest.mark.parametrize(
    ("names", "voltages"),
    [
        ((), ()),
        (("lift_valve",), (0.0,)),
        (("lift_valve", "grab_valve"), (0.0, 0.0)),
        (("lift_valve", "lift_valve"), (0.0, 0.0)),
        (("lift_valve", "tilt_valve", "grab_valve"), (0.0, 0.0, 0.0)),
        (NAMES, (0.0,)),
        (NAMES, (0.0, 0.0, 0.0)),
        (NAMES, ()),
    ],
)
@pytest.mark.parametrize("started", [False, True])
def test_only_every_known_valve_once(
    waiting: Make,
    driving: Make,
    assert_tripped: Make,
    names: tuple[str, ...],
    voltages: tuple[float, ...],
    started: bool,
) -> None:
    gate = driving() if started else waiting(100)
    gate.advance(101)
    assert gate.command(101, names, voltages) is Outcome.DENIED
    assert_tripped(gate, "expected each of lift_valve, tilt_valve once")


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("valve", [0, 1])
def test_commands_are_finite(waiting: Make, assert_tripped: Make, bad: float, valve: int) -> None:
    gate = waiting(100)
    voltages = [0.0, 0.0]
    voltages[valve] = bad
    assert gate.command(100, NAMES, voltages) is Outcome.DENIED
    assert_tripped(gate, f"{NAMES[valve]}: command is not finite")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("valve", "rated"), [(0, 10.0), (1, 8.0)])
def test_range_at_and_beyond_the_rated_voltage(
    waiting: Make, sign: float, valve: int, rated: float
) -> None:
    for value, outcome in (
        (rated, Outcome.ACCEPTED),
        (math.nextafter(rated, 0.0), Outcome.ACCEPTED),
        (math.nextafter(rated, 99.0), Outcome.DENIED),
        (99.0, Outcome.DENIED),
    ):
        gate = waiting(100)
        voltages = [0.0, 0.0]
        voltages[valve] = sign * value
        assert gate.command(100, NAMES, voltages) is outcome
        assert gate.state is not GateState.WAITING


@pytest.mark.parametrize(
    ("age", "outcome"), [(0, Outcome.ACCEPTED), (2, Outcome.ACCEPTED), (3, Outcome.OUTDATED)]
)
def test_age_of_a_first_command(waiting: Make, age: int, outcome: Outcome) -> None:
    gate = waiting(100)
    gate.advance(100 + age)
    gate.check(GOOD)
    assert gate.command(100, NAMES, (0.0, 0.0)) is outcome
    assert gate.output.enable is (outcome is Outcome.ACCEPTED)
    if outcome is Outcome.OUTDATED:
        assert gate.state is GateState.WAITING
        assert gate.command(100 + age, NAMES, (0.0, 0.0)) is Outcome.ACCEPTED


def test_silence_of_the_controller_trips_above_the_limit_only(
    driving: Make, assert_tripped: Make
) -> None:
    gate = driving(1.0)
    for counter in range(101, 106):
        gate.advance(counter)
        assert gate.output == Output((1.0, 0.0), enable=True)
    gate.advance(106)
    assert_tripped(gate, "no command for 12 ms (limit 10 ms)")


def test_a_late_command_within_the_limit_is_followed(driving: Make, assert_tripped: Make) -> None:
    gate = driving(1.0)
    gate.advance(105)
    gate.check(GOOD)
    assert gate.command(102, NAMES, (2.0, 0.0)) is Outcome.ACCEPTED
    gate.advance(107)
    assert gate.state is GateState.DRIVING
    gate.advance(108)
    assert_tripped(gate, "no command")


@pytest.mark.parametrize("counter", [None, 101, 10_000])
def test_a_stamp_of_no_cycle_trips(
    driving: Make, assert_tripped: Make, counter: int | None
) -> None:
    gate = driving()
    assert gate.command(counter, NAMES, (0.0, 0.0)) is Outcome.DENIED
    assert_tripped(gate, "of no complete cycle")


def test_commands_from_before_are_not_taken(waiting: Make) -> None:
    gate = waiting(100)
    assert gate.command(99, NAMES, (5.0, 0.0)) is Outcome.OUTDATED
    assert gate.state is GateState.WAITING
    assert gate.command(100, NAMES, (0.0, 0.0)) is Outcome.ACCEPTED


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("valve", [0, 1])
@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_rate_trips_above_twice_the_slew_limit_and_never_on_a_legal_step(
    driving: Make, assert_tripped: Make, sign: float, valve: int, cycles: int
) -> None:
    # 1 V per cycle legal: a step over three cycles stays within the rated voltage.
    limits = replace(LIMITS, slew_v_s=500.0)
    for size, outcome in (
        (1.0, Outcome.ACCEPTED),
        (2.0, Outcome.ACCEPTED),
        (2.001, Outcome.DENIED),
    ):
        gate = driving(limits=limits)
        voltages = [0.0, 0.0]
        voltages[valve] = sign * size * cycles * limits.legal_step_v
        gate.advance(100 + cycles)
        gate.check(GOOD)
        assert gate.command(100 + cycles, NAMES, voltages) is outcome
        if outcome is Outcome.DENIED:
            assert_tripped(gate, f"{NAMES[valve]}: step of")
            assert f"limit {2 * cycles * limits.legal_step_v:.3f} V" in gate.reason
        else:
            # However many cycles the command had, the valves see one step.
            most = 2.0 * limits.legal_step_v
            assert gate.output.voltages[valve] == sign * min(abs(voltages[valve]), most)
            assert gate.output.voltages[1 - valve] == 0.0


def test_zero_does_not_help_where_something_is_wrong(driving: Make, assert_tripped: Make) -> None:
    gate = driving(9.0)
    gate.check(replace(GOOD, pump_on=False))
    assert gate.command(101, NAMES, (0.0, 0.0)) is Outcome.DENIED
    assert_tripped(gate, "pump is off")


def test_a_new_gate_takes_over_a_trip_but_no_driving(driving: Make, assert_tripped: Make) -> None:
    old, new = driving(3.0), Gate(LIMITS)
    old.set_fault("x", "standing fault")
    new.carry_over(old)
    assert_tripped(new, "standing fault")
    assert (new.trips, new.faults) == (1, {"x": "standing fault"})
    new.end_fault("x")
    assert old.faults == {"x": "standing fault"}
    new.advance(1)
    new.check(GOOD)
    assert new.clear()[0]
    after = Gate(LIMITS)
    after.carry_over(new)
    assert (after.state, after.trips) == (GateState.WAITING, 1)
    after.advance(1)
    after.check(GOOD)
    after.command(1, NAMES, (3.0, 0.0))
    assert after.output.voltages == (0.02, 0.0)  # cleared, and not driven since
    fresh = Gate(LIMITS)
    fresh.carry_over(driving(3.0))
    assert (fresh.state, fresh.output) == (GateState.WAITING, OFF)


def test_one_command_per_stamp(driving: Make, assert_tripped: Make) -> None:
    gate = driving(1.0)
    assert gate.command(100, NAMES, (1.0, 0.0)) is Outcome.REPEATED
    assert gate.command(100, NAMES[::-1], (0.0, 1.0)) is Outcome.REPEATED
    assert gate.command(99, NAMES, (9.0, 0.0)) is Outcome.OUTDATED
    assert gate.output == Output((1.0, 0.0), enable=True)
    assert gate.command(100, NAMES, (1.001, 0.0)) is Outcome.DENIED
    assert_tripped(gate, "two different commands for one stamp")


def test_a_defective_second_command_trips(driving: Make, assert_tripped: Make) -> None:
    gate = driving(1.0)
    assert gate.command(100, NAMES, (math.nan, 0.0)) is Outcome.DENIED
    assert_tripped(gate, "lift_valve: command is not finite")


@pytest.mark.parametrize("back", [1, 3, 10, 90])
@pytest.mark.parametrize("voltage", [math.nan, 99.0])
def test_a_defective_command_for_any_cycle_trips(
    driving: Make, assert_tripped: Make, back: int, voltage: float
) -> None:
    gate = driving(1.0)
    assert gate.command(100 - back, NAMES, (voltage, 0.0)) is Outcome.DENIED
    assert_tripped(gate, "lift_valve: command")


def test_two_controllers_of_which_one_says_nothing_are_noticed(
    driving: Make, step: Make, assert_tripped: Make
) -> None:
    """One drives, the other answers every cycle with 0 V."""
    gate = driving(5.0, 1.0)
    outcomes = []
    for counter in range(101, 110):
        outcomes += [step(gate, counter, 5.0, 1.0), gate.command(counter, NAMES, (0.0, 0.0))]
    assert outcomes[:4] == [
        Outcome.ACCEPTED, Outcome.RELEASED, Outcome.ACCEPTED, Outcome.DENIED
    ]  # fmt: skip
    assert_tripped(gate, "taken back twice in 2 ms: is there a second controller?")


def test_a_controller_that_stops_again_later_is_no_second_one(driving: Make, step: Make) -> None:
    gate = driving(5.0, 1.0)
    for begin in (101, 101 + LIMITS.max_age_cycles + 1):
        for counter in (begin - 1, begin):
            step(gate, counter, 5.0, 1.0)
        assert gate.command(begin, NAMES, (0.0, 0.0)) is Outcome.RELEASED
    last = begin + LIMITS.max_age_cycles
    for counter in (last - 1, last):
        step(gate, counter, 5.0, 1.0)
    assert gate.command(last, NAMES, (0.0, 0.0)) is Outcome.DENIED


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["x" * 500], "valves " + "x" * 40 + " with"),
        ([f"v{i}" for i in range(8)], "v6, v7 with 8 voltages"),
        ([f"v{i}" for i in range(1000)], "v7, and 992 more with 1000 voltages"),
        (["\x1b[2J\nfine"], "\\x1b[2J\\nfine with"),
    ],
)
def test_what_a_message_says_is_told_short_and_escaped(
    driving: Make, names: list[str], told: str
) -> None:
    gate = driving(1.0)
    gate.advance(101)
    gate.command(101, names, [0.0] * len(names))
    assert told in gate.reason
    assert len(gate.reason) < 400


def test_a_controller_that_stops_releases_the_valves_without_a_trip(
    driving: Make, step: Make
) -> None:
    gate = driving(5.0, 1.0)
    assert gate.command(100, NAMES, (0.0, 0.0)) is Outcome.RELEASED
    assert gate.state is GateState.WAITING
    assert gate.output == OFF
    assert gate.command(100, NAMES, (5.0, 1.0)) is Outcome.OUTDATED
    assert step(gate, 101, 5.0, 1.0) is Outcome.ACCEPTED
    assert gate.output.voltages == (2.0, 1.0)


def test_0_v_again_for_one_stamp_releases_and_silence_after_it_is_no_trip(
    driving: Make, step: Make
) -> None:
    """A controller that came to 0 V on a ramp, or stood there, has nothing to take back."""
    gate = driving(1.0)
    assert step(gate, 101, 0.0, 0.0) is Outcome.ACCEPTED
    assert gate.output == Output((0.0, 0.0), enable=True)
    assert gate.command(101, NAMES, (0.0, 0.0)) is Outcome.RELEASED
    assert (gate.state, gate.output) == (GateState.WAITING, OFF)
    for counter in range(102, 102 + 10 * LIMITS.max_age_cycles):
        gate.advance(counter)
        gate.check(GOOD)
    assert (gate.state, gate.trips) == (GateState.WAITING, 0)


def test_0_v_once_and_silence_is_a_controller_that_fell_silent(
    driving: Make, step: Make, assert_tripped: Make
) -> None:
    gate = driving(1.0)
    step(gate, 101, 0.0, 0.0)
    gate.advance(102 + LIMITS.max_age_cycles)
    assert_tripped(gate, "no command for 12 ms")


def test_0_v_twice_for_every_stamp_is_no_sign_of_a_second_controller(
    driving: Make, step: Make
) -> None:
    gate = driving(0.0)
    outcomes = set()
    for counter in range(101, 110):
        outcomes.add((step(gate, counter, 0.0, 0.0), gate.command(counter, NAMES, (0.0, 0.0))))
    assert outcomes == {(Outcome.ACCEPTED, Outcome.RELEASED)}
    assert gate.trips == 0
    # Nor does it hide that a command is taken back once.
    assert step(gate, 110, 1.0, 0.0) is Outcome.ACCEPTED
    assert gate.command(110, NAMES, (0.0, 0.0)) is Outcome.RELEASED
    assert step(gate, 111, 1.0, 0.0) is Outcome.ACCEPTED
    assert gate.command(111, NAMES, (0.0, 0.0)) is Outcome.DENIED
