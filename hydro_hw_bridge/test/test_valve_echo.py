"""Valve frames that get lost, broken or doubled behind the bridge, told by the amplifiers."""

from __future__ import annotations

import random
from collections import deque

import pytest

from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.held_voltages import PATIENCE, HeldVoltages
from hydro_hw_bridge.monitoring.valve_echo import ValveEcho
from hydro_hw_bridge.protocol.bridge_step import EchoCounters
from hydro_hw_bridge.protocol.frames import Echo

SPANS = (256, 32)
LIMITS = GateLimits(("lift_valve",), (10.0,), 0.002, 1000.0, 5, 2.0e6)
ZERO = (0.0,)


class Way:
    """Frames from an echo's owner to amplifiers that count them, cycle by cycle."""

    def __init__(self, counter: int = 0) -> None:
        self.echo = ValveEcho(SPANS, HeldVoltages(LIMITS))
        self.taken = self.refused = 0
        self.counter = counter
        self.cycle()

    def cycle(self, told: bool = True) -> None:
        """The amplifiers tell; without `told` that cycle does not arrive."""
        if told:
            now = Echo(self.taken % SPANS[0], self.refused % SPANS[1])
            self.echo.heard(now, self.counter)
        self.counter += 1

    def send(self, arrives: int = 1, *, intact: bool = True) -> None:
        self.echo.sent(ZERO)
        self.arrive(arrives, intact=intact)

    def arrive(self, frames: int = 1, *, intact: bool = True) -> None:
        if intact:
            self.taken += frames
        else:
            self.refused += frames

    def sound(self, cycles: int) -> None:
        for _ in range(cycles):
            self.send()
            self.cycle()


@pytest.mark.parametrize("counter", [0, (1 << 32) - 20])
def test_nothing_is_told_of_a_sound_way_through_the_wrap_of_every_count(counter: int) -> None:
    way = Way(counter)
    way.sound(3 * SPANS[0])
    assert way.echo.counters == EchoCounters()


@pytest.mark.parametrize("lost", [1, 4, 40])
def test_every_lost_frame_is_counted_once(lost: int) -> None:
    way = Way()
    way.sound(5)
    for _ in range(lost):
        way.send(arrives=0)
        way.cycle()
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters(lost=lost)


def test_a_frame_that_is_late_is_not_lost_before_its_time() -> None:
    way = Way()
    way.send(arrives=0)
    for _ in range(PATIENCE - 1):
        way.cycle()
    way.arrive()
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters()


def test_a_late_frame_behind_a_lost_one_has_its_own_time() -> None:
    way = Way()
    way.send(arrives=0)
    for _ in range(PATIENCE - 3):
        way.cycle()
    way.send(arrives=0)
    for _ in range(PATIENCE - 1):
        way.cycle()
    way.arrive()
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters(lost=1)


def test_many_at_once_are_counted_by_the_wider_count() -> None:
    way = Way()
    way.arrive(SPANS[1] + 8)
    way.cycle()
    assert way.echo.counters == EchoCounters(surplus=SPANS[1] + 8)


def test_a_frame_too_many_does_not_make_up_for_one_that_is_lost() -> None:
    way = Way()
    way.send(arrives=2)
    way.cycle()
    way.send(arrives=0)
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters(lost=1, surplus=1)


def test_a_frame_is_lost_after_twice_the_time_that_a_command_may_be_old() -> None:
    assert PATIENCE * 0.002 == 2.0 * 0.010


def test_broken_frames_are_refused_and_not_lost() -> None:
    way = Way()
    for _ in range(3 * SPANS[1]):
        way.send(intact=False)
        way.cycle()
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters(refused=3 * SPANS[1])


def test_doubled_frames_and_those_of_others_are_surplus() -> None:
    way = Way()
    way.sound(5)
    way.send(arrives=2)
    way.cycle()
    way.arrive()
    way.cycle()
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters(surplus=2)


def test_cycles_that_do_not_arrive_hide_no_frame_and_make_none() -> None:
    way = Way()
    for _ in range(SPANS[1] - 2):
        way.send()
        way.cycle(told=False)
    way.send(arrives=0)
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters(lost=1)


def test_after_a_silence_in_which_counts_may_have_gone_around_nothing_is_told() -> None:
    way = Way()
    way.sound(5)
    for _ in range(SPANS[1]):
        way.send(arrives=0)
        way.cycle(told=False)
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters()


@pytest.mark.parametrize("back", [0, 1, 5])
def test_a_cycle_that_was_there_before_says_nothing(back: int) -> None:
    way = Way()
    way.sound(10)
    way.echo.heard(Echo((way.taken + 3) % SPANS[0], 7), way.counter - 1 - back)
    assert way.echo.counters == EchoCounters()


@pytest.mark.parametrize(("missing", "told"), [(SPANS[1] - 2, 7), (SPANS[1] - 1, 0)])
def test_counts_are_compared_as_long_as_they_cannot_have_gone_around(
    missing: int, told: int
) -> None:
    way = Way()
    way.sound(5)
    for _ in range(missing):
        way.cycle(told=False)
    way.arrive(7, intact=False)
    way.cycle()
    assert way.echo.counters.refused == told


def test_a_cycle_that_tells_nothing_forgets_nothing() -> None:
    way = Way()
    way.sound(5)
    way.send(arrives=0)
    way.echo.heard(None, way.counter)
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters(lost=1)


def test_a_device_that_counts_anew_is_no_fault() -> None:
    way = Way()
    way.sound(7)
    way.echo.forget()
    way.taken = way.counter = 0
    way.cycle()
    way.sound(3 * PATIENCE)
    assert way.echo.counters == EchoCounters()


def test_amplifiers_that_tell_nothing() -> None:
    echo = ValveEcho((), HeldVoltages(LIMITS))
    for counter in range(3 * PATIENCE):
        echo.sent(ZERO)
        echo.heard(None, counter)
    assert echo.counters == EchoCounters()


@pytest.mark.parametrize("seed", range(20))
def test_what_is_counted_adds_up_whatever_happens(seed: int) -> None:
    source, way = random.Random(seed), Way()
    late: deque[int] = deque()
    lost = broken = 0
    for cycle in range(2000):
        fate = source.choices(("sound", "lost", "broken", "late"), (90, 3, 3, 4))[0]
        lost, broken = lost + (fate == "lost"), broken + (fate == "broken")
        way.send(arrives=0 if fate in ("lost", "late") else 1, intact=fate != "broken")
        if fate == "late":
            late.append(cycle + source.randint(1, PATIENCE // 2))
        while late and late[0] <= cycle:
            late.popleft()
            way.arrive()
        way.cycle()
    way.arrive(len(late))
    way.sound(3 * PATIENCE)
    counted = way.echo.counters
    assert counted.refused == broken
    # A late frame may stand in for a lost one: counted too early, it is surplus when it comes.
    assert counted.lost - counted.surplus == lost
    assert counted.surplus <= 0.05 * 2000


@pytest.mark.parametrize("tells", [True, False])
def test_where_the_valves_may_be_follows_from_what_left_and_was_taken(tells: bool) -> None:
    held = HeldVoltages(LIMITS)
    echo = ValveEcho(SPANS if tells else (), held)
    for taken, counter in ((255, 1), (0, 2)):
        echo.heard(Echo(taken, 0) if tells else None, counter)
        # What left is where they are by its count, around the wrap, or where none is told.
        sure = not tells or counter == 2
        if counter == 1:
            echo.sent((4.0,))
            sure = not tells
        assert held.towards((9.0,), (4.0,), 2.0) == ((6.0,) if sure else (4.0,))
