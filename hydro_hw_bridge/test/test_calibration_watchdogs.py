"""`Session` on a wire whose time passes by waiting: what it answers, and what ends its driving.

`calibrate --signs` drives valves with it, past the gate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest

from hydro_hw_bridge.bus import claims
from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_name import BusName
from hydro_hw_bridge.commissioning import calibration_session
from hydro_hw_bridge.commissioning.calibration_session import Session
from hydro_hw_bridge.errors import BridgeError, CalibrationError
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame, Readings

BEGIN_S = 100.0
#: Of a machine's frames.
PERIOD_S = 0.002
ZERO = (0.0, 0.0)
OFF = (ZERO, False)


class Wire(Bus):
    """A bus on which time passes by waiting, and `others` speak at their times."""

    def __init__(self, codec: Codec) -> None:
        super().__init__(BusName("fake", "wire"), object())  # type: ignore[arg-type]
        self._codec = codec
        self.now = BEGIN_S
        self.sent: list[tuple[float, can.Message]] = []
        self.others: list[tuple[float, can.Message]] = []

    # the clock

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    # the bus

    def send(self, message: can.Message) -> bool:
        self.sent.append((self.now, message))
        return True

    def receive(self, timeout_s: float) -> can.Message | None:
        assert 0.0 < timeout_s <= 0.05  # so long at most nothing else is looked at
        if self.others and self.others[0][0] <= self.now + timeout_s:
            at, message = self.others.pop(0)
            self.now = max(self.now, at)
            return message
        self.now += timeout_s
        return None

    # what was said

    def put(self, messages: list[can.Message], after_s: float = PERIOD_S) -> None:
        """Frames that come one after another, so long after whatever comes before."""
        last_s = self.others[-1][0] if self.others else self.now
        self.others += [(last_s + after_s, message) for message in messages]

    def _of(self, role: str) -> list[tuple[float, Any]]:
        decoded = [(at, self._codec.receive(message)) for at, message in self.sent]
        return [(at, frame) for at, frame in decoded if frame is not None and frame.role == role]

    @property
    def answers(self) -> list[CommandFrame]:
        return [self._codec.decode_command(frame) for _, frame in self._of("command")]

    @property
    def answers_s(self) -> list[float]:
        return [at for at, _ in self._of("command")]

    @property
    def claims_s(self) -> list[float]:
        return [at for at, _ in self._of("claim")]


@pytest.fixture
def wire(codec: Codec, monkeypatch: pytest.MonkeyPatch) -> Wire:
    wire = Wire(codec)
    for module in (claims, calibration_session):
        monkeypatch.setattr(module, "time", wire)
    return wire


@pytest.fixture
def session(wire: Wire, codec: Codec) -> Session:
    """One that has claimed its bus; of what it sent then nothing is kept."""
    session = Session(wire, codec)
    assert len(wire.claims_s) > 1
    wire.sent.clear()
    return session


@pytest.fixture
def cycle(codec: Codec, readings: Any) -> Callable[[int], list[can.Message]]:
    """Frames of a cycle."""

    def frames(counter: int) -> list[can.Message]:
        return codec.encode_cycle(readings(counter))

    return frames


Frames = Callable[[int], list[can.Message]]


def said(wire: Wire) -> list[tuple[int, tuple[float, ...], bool]]:
    return [(one.answered, one.voltages, one.enable) for one in wire.answers]


def driving(wire: Wire, session: Session, cycle: Frames) -> Iterator[Readings]:
    """A session that drives the first valve from its second cycle on, at hand: the second."""
    wire.put(cycle(1))
    wire.put(cycle(2))
    cycles = session.cycles()
    assert next(cycles).counter == 1
    session.drive("lift_valve", 0.5)
    assert next(cycles).counter == 2
    return cycles


def test_where_a_bridge_is_none_is_calibrated(wire: Wire, codec: Codec) -> None:
    wire.put([codec.encode_claim(7, 0)])
    with pytest.raises(BridgeError, match=r"another bridge .* is on CAN bus fake:wire"):
        Session(wire, codec)
    assert wire.answers == []


def test_every_cycle_is_answered_once_as_the_next_is_asked_for(
    wire: Wire, session: Session, cycle: Frames
) -> None:
    for counter in (1, 2, 3, 4, 5):
        wire.put(cycle(counter))
    cycles = session.cycles()
    assert next(cycles).counter == 1
    assert said(wire) == []
    assert next(cycles).counter == 2
    session.drive("lift_valve", 0.5)
    assert next(cycles).counter == 3
    session.drive("tilt_valve", -0.25)
    assert next(cycles).counter == 4
    session.drive(None)
    assert next(cycles).counter == 5
    assert said(wire) == [
        (1, ZERO, False),
        (2, (0.5, 0.0), True),
        (3, (0.0, -0.25), True),
        (4, ZERO, False),
    ]


def test_a_valve_without_a_voltage_is_at_0_v(wire: Wire, session: Session, cycle: Frames) -> None:
    cycles = driving(wire, session, cycle)
    session.drive("tilt_valve")
    wire.put(cycle(3))
    next(cycles)
    assert said(wire)[-1] == (2, ZERO, True)


def test_what_was_driven_last_answers_the_cycle_at_hand_where_cycles_are_asked_for_anew(
    wire: Wire, session: Session, cycle: Frames
) -> None:
    driving(wire, session, cycle).close()
    wire.put(cycle(3))
    session.drive(None)
    assert next(session.cycles()).counter == 3
    assert said(wire) == [(1, (0.5, 0.0), True), (2, ZERO, False)]


def test_it_ends_with_0_v_five_times_over_eight_milliseconds(
    wire: Wire, session: Session, cycle: Frames
) -> None:
    """Any one frame may be lost; and the wire gets the last one before it is closed."""
    driving(wire, session, cycle)
    wire.sent.clear()
    session.stop()
    assert said(wire) == [(2, *OFF)] * 5
    assert wire.answers_s == pytest.approx([wire.now - 0.002 * k for k in (5, 4, 3, 2, 1)])


def test_before_the_first_cycle_nothing_is_sent(wire: Wire, session: Session) -> None:
    session.drive("lift_valve", 0.5)
    with pytest.raises(CalibrationError):
        next(session.cycles())
    session.stop()
    assert wire.answers == []


def test_a_bridge_that_appears_ends_it(
    wire: Wire, session: Session, codec: Codec, cycle: Frames
) -> None:
    cycles = driving(wire, session, cycle)
    wire.put([codec.encode_claim(session._claim.instance ^ 1, 0)])
    wire.put(cycle(3))
    with pytest.raises(BridgeError, match="a bridge appeared on CAN bus fake:wire: stop it first"):
        next(cycles)
    session.stop()
    assert said(wire)[-1] == (2, *OFF)


def test_its_own_claims_and_those_that_nobody_sent_end_nothing(
    wire: Wire, session: Session, codec: Codec, cycle: Frames
) -> None:
    """An interface may echo what it sends; and a flipped bit makes another bridge of nobody."""
    cycles = driving(wire, session, cycle)
    own = codec.encode_claim(session._claim.instance, 3)
    broken = codec.encode_claim(session._claim.instance ^ 1, 4)
    broken.data[-1] ^= 1
    wire.put([own, broken])
    wire.put(cycle(3))
    assert next(cycles).counter == 3


def test_it_claims_its_bus_for_as_long_as_it_has_it(
    wire: Wire, session: Session, cycle: Frames
) -> None:
    """A bridge listens for a second before it comes up: told ten times, whoever speaks or not."""
    for counter in range(1, 502):
        wire.put(cycle(counter))
    cycles = session.cycles()
    begin_s = wire.now
    for _ in range(501):
        next(cycles)
    with pytest.raises(CalibrationError):
        next(cycles)
    at = [begin_s, *wire.claims_s]
    assert wire.now - begin_s > 3.9
    gaps = [b - a for a, b in zip(at, [*at[1:], wire.now], strict=True)]
    assert max(gaps) < 0.1 + 0.051
    assert min(gaps[:-1]) > 0.099


def test_a_device_that_falls_silent_ends_it(wire: Wire, session: Session, cycle: Frames) -> None:
    cycles = driving(wire, session, cycle)
    last_s = wire.now
    with pytest.raises(CalibrationError, match="nothing from the device on fake:wire for 3 s"):
        next(cycles)
    assert 3.0 < wire.now - last_s < 3.1
    assert len(said(wire)) == 2  # a silent device is told nothing anew: its watchdog ends it


def test_a_device_may_be_silent_for_three_seconds(
    wire: Wire, session: Session, cycle: Frames
) -> None:
    cycles = driving(wire, session, cycle)
    wire.put(cycle(3), 3.0)
    assert next(cycles).counter == 3


def test_only_whole_cycles_are_a_sign_of_the_device_and_answered(
    wire: Wire, session: Session, codec: Codec, cycle: Frames
) -> None:
    """Neither what others send nor parts of cycles keep a valve driven."""
    cycles = driving(wire, session, cycle)
    wire.sent.clear()
    last_s = wire.now
    own = codec.encode_claim(session._claim.instance, 0)
    foreign = can.Message(arbitration_id=0x7FF, data=b"\0", is_extended_id=False)
    for counter in range(3, 1700):
        part = cycle(counter)[: 1 + counter % 3]
        wire.put([*part, foreign, codec.encode_command(counter, (1.0, 0.0), True), own])
    with pytest.raises(CalibrationError, match="nothing from the device"):
        next(cycles)
    assert 3.0 < wire.now - last_s < 3.1
    assert said(wire) == [(2, (0.5, 0.0), True)]  # the cycle at hand, as the next is asked for


def test_a_cycle_that_comes_again_is_answered_again_and_taken_once(
    wire: Wire, session: Session, cycle: Frames
) -> None:
    cycles = driving(wire, session, cycle)
    wire.sent.clear()
    for counter in (2, 2, 3):
        wire.put(cycle(counter))
    assert next(cycles).counter == 3
    assert said(wire) == [(2, (0.5, 0.0), True)] * 3


def test_a_counter_that_stands_is_driven_for_five_repeats(
    wire: Wire, session: Session, cycle: Frames
) -> None:
    """The length of a pulse is counted in cycles of the device; answers are lost now and then."""
    cycles = driving(wire, session, cycle)
    for counter in (3, 4):
        for _ in range(5):
            wire.put(cycle(counter - 1))
        wire.put(cycle(counter))
        assert next(cycles).counter == counter
    wire.sent.clear()
    for _ in range(6):
        wire.put(cycle(4))
    text = (
        "the device's sample counter stands at 4 while it is driven, expected it to count its"
        " cycles"
    )
    with pytest.raises(CalibrationError, match=f"^{text}$"):
        next(cycles)
    assert said(wire) == [(4, (0.5, 0.0), True)] * 6
    session.stop()
    assert said(wire)[6:] == [(4, *OFF)] * 5


def test_a_counter_that_stands_ends_nothing_where_nothing_is_driven(
    wire: Wire, session: Session, cycle: Frames
) -> None:
    cycles = driving(wire, session, cycle)
    session.drive(None)
    for _ in range(20):
        wire.put(cycle(2))
    wire.put(cycle(3))
    assert next(cycles).counter == 3
    session.drive("lift_valve", 0.5)
    for _ in range(5):
        wire.put(cycle(3))
    wire.put(cycle(4))
    assert next(cycles).counter == 4


@pytest.mark.parametrize("repeats", [5, 6])
def test_repeats_count_from_0_where_cycles_are_asked_for_anew(
    wire: Wire, session: Session, cycle: Frames, repeats: int
) -> None:
    driving(wire, session, cycle).close()
    cycles = session.cycles()
    for _ in range(repeats):
        wire.put(cycle(2))
    wire.put(cycle(3))
    if repeats == 5:
        assert next(cycles).counter == 3
    else:
        with pytest.raises(CalibrationError, match="stands at 2 while it is driven"):
            next(cycles)


@pytest.mark.parametrize("driven", [True, False])
@pytest.mark.parametrize("whole", [True, False])
def test_a_device_that_starts_anew_while_it_is_driven_ends_it(
    wire: Wire, session: Session, cycle: Frames, driven: bool, whole: bool
) -> None:
    """Whether its first cycle is whole or not: its sync frame tells."""
    cycles = driving(wire, session, cycle)
    session.drive("lift_valve" if driven else None, 0.5)
    wire.put(cycle(0))
    wire.put(cycle(1) if whole else [*cycle(1)[:2], *cycle(2)])
    if not driven:
        assert next(cycles).counter == (1 if whole else 2)
        return
    with pytest.raises(CalibrationError, match=r"restarted while it was driven.* to 1 from 2$"):
        next(cycles)
