"""Where the valves may be while frames are lost or late: steps are small from there, too."""

from __future__ import annotations

import random
from collections import deque
from dataclasses import replace

import pytest

from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.held_voltages import PATIENCE, ROUNDING_V, WATCHDOG_S, HeldVoltages
from hydro_hw_bridge.gate.output_ramp import RATE_FACTOR, OutputRamp
from hydro_hw_bridge.monitoring.valve_echo import ValveEcho
from hydro_hw_bridge.protocol.frames import Echo

SPANS = (256, 32)
LIMITS = GateLimits(("lift_valve",), (10.0,), 0.002, 1000.0, 5, 2.0e6)
MOST_V = RATE_FACTOR * LIMITS.legal_step_v
#: The watchdog's time, and a command's age.
UNHEARD = 30


class Way:
    """A ramp's output on its way to amplifiers that tell what they took, cycle by cycle.

    `most_v` is the largest step at the valve so far, but for 0 V.
    """

    def __init__(self, *, tells: bool = True) -> None:
        self.held = HeldVoltages(LIMITS)
        self.echo = ValveEcho(SPANS if tells else (), self.held)
        self.ramp = OutputRamp(LIMITS, self.held)
        self.tells = tells
        self.counter = self.taken = self.told = 0
        self.valve_v = self.most_v = 0.0
        self.coming: deque[tuple[int, float]] = deque()
        self.hear()

    def hear(self, taken: int | None = None, *, told: bool = True) -> None:
        """A cycle begins: what came is taken, and told, or another count is."""
        self.counter += 1
        before = self.valve_v
        while self.coming and self.coming[0][0] <= self.counter:
            self.valve_v = self.coming.popleft()[1]
            self.taken += 1
        if self.valve_v:
            self.most_v = max(self.most_v, abs(self.valve_v - before))
        if told:
            self.told = count = self.taken if taken is None else taken
            self.echo.heard(Echo(count % SPANS[0], 0) if self.tells else None, self.counter)

    def ask(self, command_v: float) -> float:
        """The output that follows a command."""
        self.ramp.follow(self.counter, (command_v,))
        return self.ramp.applied_v[0]

    def send(self, command_v: float, *, lost: bool = False, late: int = 0) -> float:
        """It leaves, and is lost or comes cycles late: never before one that left earlier."""
        voltage = self.ask(command_v)
        self.echo.sent((voltage,))
        if not lost:
            due = max(self.counter + 1 + late, self.coming[-1][0] if self.coming else 0)
            self.coming.append((due, voltage))
        return voltage

    def sound(self, cycles: int, command_v: float) -> None:
        for _ in range(cycles):
            self.send(command_v)
            self.hear()


def swing(cycle: int) -> float:
    """From one end to the other and back, at the slew limit: 9 V, 7 V ... -9 V, -7 V ..."""
    return 9.0 - 2.0 * min(cycle % 18, 18 - cycle % 18)


def test_times_are_those_of_the_watchdog_and_of_twice_a_commands_age() -> None:
    assert (PATIENCE * LIMITS.period_s, WATCHDOG_S) == (2.0 * LIMITS.max_age_s, 0.05)


@pytest.mark.parametrize("tells", [True, False])
def test_on_a_sound_way_every_legal_command_is_the_output(tells: bool) -> None:
    way = Way(tells=tells)
    way.sound(8, 9.0)
    for cycle in range(300):
        assert way.send(swing(cycle)) == swing(cycle)
        way.hear()
    assert way.held.complaint == ""
    # A step of the gate's own limit, twice the slew limit, is followed as well.
    way.sound(8, 9.0)
    assert way.send(5.0) == 5.0


def test_one_frame_that_is_always_under_way_slows_nothing() -> None:
    way = Way()
    way.sound(8, 9.0)
    for cycle in range(300):
        assert way.send(swing(cycle), late=1) == swing(cycle)
        way.hear()
    # And it is not taken for a lost one: what is lost then is counted from what was taken.
    for cycle in range(300, 310):
        way.send(swing(cycle), lost=True)
        way.hear()
    way.sound(5, swing(310))
    assert way.most_v == MOST_V


@pytest.mark.parametrize("lost", [1, 2, 3, 5, 10, 20, 24])
def test_after_lost_frames_the_step_is_within_twice_the_slew_limit(lost: int) -> None:
    way = Way()
    way.sound(8, 9.0)
    for cycle in range(lost):
        way.send(swing(cycle + 1), lost=True)
        way.hear()
    assert way.valve_v == 9.0
    for cycle in range(lost, lost + 100):
        way.send(swing(cycle + 1))
        way.hear()
    assert way.most_v <= MOST_V + 1e-9
    assert way.held.complaint == ""
    # And it is over: twice the patience behind the last one it slows nothing.
    way.sound(8, 9.0)
    for cycle in range(60):
        assert way.send(swing(cycle)) == swing(cycle)
        way.hear()


def test_what_was_lost_is_known_after_its_time_and_not_before() -> None:
    way = Way()
    way.sound(9, -1.0)
    for _ in range(4):
        way.send(-1.0, lost=True)
        way.hear()
    # Until then steep commands are followed as far as is sure, wherever the valve may be.
    reached = []
    for cycle in range(60):
        reached.append(way.send(swing(cycle)))
        way.hear()
    assert reached[:9] == [3.0, 3.0, 3.0, 3.0, 1.0, -1.0, -1.0, -1.0, -3.0]
    assert reached[9:17] == [-5.0, -5.0, -5.0, -3.0, -1.0, -1.0, -1.0, 1.0]
    assert reached[19:] == [swing(cycle) for cycle in range(19, 60)]


def test_a_late_one_behind_lost_ones_is_not_lost_with_them() -> None:
    way = Way()
    way.sound(8, 9.0)
    for _ in range(4):
        way.send(9.0, lost=True)
        way.hear()
    for _ in range(3 * PATIENCE):
        way.send(9.0, late=1)
        way.hear()
    assert way.send(5.0, lost=True) == 5.0
    way.hear()
    # The one before it came meanwhile; of this one and the next nobody has heard.
    assert way.send(1.0, lost=True) == 5.0


def test_while_nothing_is_taken_the_output_stays_within_a_step_of_what_was() -> None:
    way = Way()
    way.sound(8, 9.0)
    sent = []
    for cycle in range(20):
        sent.append(way.send(9.0 - 0.4 * cycle, lost=True))
        way.hear()
    assert sent[:11] == [9.0 - 0.4 * cycle for cycle in range(11)]
    assert sent[11:] == [5.0] * 9


def test_a_stop_waits_for_nothing() -> None:
    way = Way()
    way.sound(8, 9.0)
    for _ in range(20):
        way.send(5.0, lost=True)
        way.hear()
    assert way.send(0.0, lost=True) == 0.0
    # It was lost, too: before it is known to be there, no other voltage.
    way.hear()
    assert way.send(3.0) == 0.0
    way.hear()
    way.hear()
    assert (way.valve_v, way.send(3.0)) == (0.0, 2.0)


def test_what_the_bus_did_not_take_moved_nothing() -> None:
    """Told by nobody but the bus itself: amplifiers that say nothing are held to it, too."""
    for tells in (True, False):
        way = Way(tells=tells)
        way.sound(8, 9.0)
        for cycle in range(1, 10):
            way.ask(swing(cycle))
            way.hear()
        way.send(swing(10))
        way.hear()
        assert (way.most_v, way.valve_v) == (MOST_V, 5.0)


def test_frames_that_come_late_all_at_once_are_one_step() -> None:
    way = Way()
    way.sound(8, 9.0)
    for cycle in range(5):
        way.send(swing(cycle + 1), late=5 - cycle)
        way.hear()
    way.sound(3, swing(6))
    assert way.valve_v != 9.0
    assert way.most_v <= MOST_V + 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_no_loss_and_no_lateness_makes_a_step(seed: int) -> None:
    """Frames are lost and late at random, cycles of the machine, too; commands are at the limit.

    Late ones do not come one after the other for as long as a lost one takes to be known: in
    two cycles of ten none is on its way.
    """
    source, way = random.Random(seed), Way()
    way.sound(8, 9.0)
    burst = 0
    for cycle in range(1, 600):
        burst = source.choice((0, 0, 0, 2, 5, 20)) if not burst else burst - 1
        late = source.choice((0, 0, 1, 3)) if cycle % 10 < 5 else 0
        way.send(swing(cycle), lost=burst > 0 and source.random() < 0.9, late=late)
        way.hear(told=cycle % 10 > 7 or source.random() < 0.9)
    assert way.most_v <= MOST_V + 1e-9
    assert way.most_v == pytest.approx(MOST_V)


@pytest.mark.parametrize("seed", range(8))
def test_whatever_they_say_the_output_is_on_the_way_to_the_command(seed: int) -> None:
    """A count that stands, leaps or is drawn: slower at most, and never by a larger step."""
    source, way = random.Random(seed), Way()
    stands = source.random() < 0.3
    before = count = 0
    for cycle in range(200):
        command_v = swing(cycle)
        free = OutputRamp(LIMITS, HeldVoltages(LIMITS))
        free.applied_v, free._ramping = way.ramp.applied_v, way.ramp._ramping
        before, after = way.ramp.applied_v[0], way.send(command_v)
        free.follow(way.counter, (command_v,))
        low, high = sorted((before, free.applied_v[0]))
        assert low <= after <= high
        count = count if stands else source.choice((count, count + 1, source.randrange(256)))
        way.hear(count)


def driven(way: Way, pattern: list[bool]) -> list[str]:
    """Complaints, cycle by cycle, where a count grows by one or not."""
    found, count = [], way.told
    for grows in pattern:
        count += grows
        way.send(5.0)
        way.hear(count)
        found.append(way.held.complaint)
    return found


def test_what_is_not_taken_for_longer_than_the_watchdog_takes_is_complained_of() -> None:
    way = Way()
    said = driven(way, [False] * (UNHEARD + 5))
    told = "the amplifiers took no valve frame for 60 ms"
    assert said == [""] * UNHEARD + [told] * 5
    # However many were taken before.
    assert driven(Way(), [True] * 9 + [False] * (UNHEARD + 1)) == [""] * (UNHEARD + 9) + [told]
    way.held.rest()
    assert driven(way, [False] * (UNHEARD + 1)) == [""] * UNHEARD + [told]


def test_a_count_that_grows_now_and_then_holds_nothing_for_long() -> None:
    """Who tells one frame in twenty keeps the valves where they were; that ends soon, too."""
    said = driven(Way(), ([False] * 19 + [True]) * 3)
    assert said.index("the amplifiers took no valve frame for 60 ms") == 32
    # As many that are taken make up for those that are not.
    assert set(driven(Way(), [False, True] * 200)) == {""}


def test_the_complaint_ends_with_as_much_as_it_began_with() -> None:
    way = Way()
    driven(way, [False] * 1000)
    assert driven(way, [True] * 3)[0] == ""


def test_where_nothing_is_sent_nothing_is_missing() -> None:
    way = Way()
    way.sound(3, 5.0)
    way.hear()
    for _ in range(100):
        way.hear()
    assert way.held.complaint == ""


def test_a_gap_in_what_is_told_counts_as_long_as_it_is() -> None:
    way = Way()
    way.send(1.0, lost=True)
    for _ in range(UNHEARD):
        way.hear(told=False)
    way.hear()
    assert way.held.complaint != ""


def test_a_count_that_may_have_gone_around_says_nothing() -> None:
    way = Way()
    way.sound(8, 9.0)
    for _ in range(SPANS[1]):
        way.send(5.0, lost=True)
        way.hear(told=False)
    way.hear(way.taken + 7)
    assert way.send(1.0) == 5.0


def test_frames_of_long_ago_are_forgotten_and_the_newest_is_not() -> None:
    held = HeldVoltages(LIMITS)
    for count in range(1000):
        held.sent((float(count),), told=True)
    assert held.towards((5000.0,), (999.0,), 100.0) == (1000.0 - 64.0 + 100.0,)
    held.took(1, 0, 1)
    assert held.towards((5000.0,), (999.0,), 100.0) == (1000.0 - 63.0 + 100.0,)
    held.took(2000, 1, 2)
    assert held.towards((5000.0,), (999.0,), 100.0) == (1099.0,)
    assert held.towards((0.0,), (999.0,), 100.0) == (899.0,)
    held.forget()
    assert held.towards((5.0,), (0.0,), 1.0) == (5.0,)


def test_before_the_first_is_heard_the_valves_are_at_0_v() -> None:
    held = HeldVoltages(LIMITS)
    held.sent((1.0,), told=True)
    assert held.towards((9.0,), (1.0,), 4.0) == (4.0,)
    assert held.towards((-9.0,), (1.0,), 4.0) == (-3.0,)
    held.took(1, 0, 1)
    assert held.towards((9.0,), (1.0,), 4.0) == (5.0,)


def test_rounding_makes_no_step_too_large() -> None:
    held = HeldVoltages(LIMITS)
    held.sent((1.0,), told=False)
    for sign in (1.0, -1.0):
        border = 1.0 + 4.0 * sign
        legal = border + sign * ROUNDING_V
        assert held.towards((legal,), (1.0,), 4.0) == (legal,)
        assert held.towards((border + 3.0 * sign * ROUNDING_V,), (1.0,), 4.0) == (border,)
    assert ROUNDING_V == 1e-9


def test_a_single_place_that_is_a_step_from_all_is_gone_to() -> None:
    held = HeldVoltages(LIMITS)
    held.sent((4.0,), told=False)
    held.sent((-4.0,), told=True)
    assert held.towards((2.0,), (-1.0,), 4.0) == (0.0,)
    assert held.towards((2.0,), (-1.0,), 3.9) == (-1.0,)


def test_every_valve_has_its_own_way() -> None:
    held = HeldVoltages(replace(LIMITS, valve_names=("a", "b"), rated_voltage_v=(10.0, 10.0)))
    held.sent((4.0, -4.0), told=False)
    assert held.towards((9.0, -5.0), (4.0, -4.0), 1.5) == (5.5, -5.0)
    # A range that holds neither is gone towards; of one that is none nothing moves.
    assert held.towards((2.0, 0.0), (1.0, -1.0), 1.0) == (2.0, -1.0)
    held.sent((-4.0, -4.0), told=True)
    assert held.towards((2.0, 0.0), (1.0, -4.0), 1.0) == (1.0, -3.0)
