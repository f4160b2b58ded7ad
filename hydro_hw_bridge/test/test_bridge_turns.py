"""What the bridge's threads decide, turn by turn, on a clock that the tests turn."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import can
import pytest

from hydro_hw_bridge.bus import claims
from hydro_hw_bridge.bus.claims import CLAIM_PERIOD_S, GONE_S, Claim
from hydro_hw_bridge.bus.link import BUS_OFF, CommandLink
from hydro_hw_bridge.core.bridge_turns import (
    LONGEST_SILENCE_S,
    SECOND_BRIDGE,
    SILENT_S,
    Arrival,
    BridgeTurns,
    tells_time,
)
from hydro_hw_bridge.core.supervision import FOREIGN
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.protocol.bridge_step import NOTHING, Step
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import Frame

NAMES = ("lift_valve", "tilt_valve")
ROS_NS = 1_700_000_000_500_000_000
PERIOD_S = 0.002


class Turned:
    """The turns of a bench's core, and what time it is: `now_s`."""

    def __init__(self, bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
        self.bench, self.now_s = bench, 100.0
        monkeypatch.setattr(claims, "time", self)
        self.link = CommandLink(bench.wire, 5)
        bench.core._valves._send = self.link.send
        self.claim = Claim(bench.wire, bench.codec)
        self.turns = BridgeTurns(bench.core, self.link, self.claim, self.now_s)

    def monotonic(self) -> float:
        return self.now_s

    def take(
        self,
        message: can.Message | Frame | None,
        waited_s: float = 0.0,
        *,
        told: bool = False,
        later_s: float = 0.0,
    ) -> tuple[Step, ...]:
        """A message, or none, is read, `told` when it came, and `later_s` after that looked at."""
        frame = self.bench.codec.receive(message) if isinstance(message, can.Message) else message
        at = Arrival(self.now_s, waited_s, ROS_NS) if tells_time(frame) else None
        to_s = self.now_s - waited_s if told else None
        self.now_s += later_s
        idle = message is None
        return self.turns.received(frame, at, self.now_s, idle=idle, read_to_s=to_s)

    def cycle(self, counter: int, waited_s: float = 0.0, **changes: Any) -> tuple[Step, ...]:
        """All steps that are not nothing."""
        self.now_s += PERIOD_S
        readings = self.bench.readings(counter, **changes)
        steps = [self.take(m, waited_s) for m in self.bench.codec.encode_cycle(readings)]
        return tuple(step for of in steps for step in of if step is not NOTHING)

    def command(self, counter: int, lift_v: float, number: int | None = None) -> tuple[Step, ...]:
        stamp_ns = (self.bench.core.clock.zero_stamp_ns or 0) + round(counter * PERIOD_S * 1e9)
        return self.turns.commanded(stamp_ns, NAMES, (lift_v, 0.0), number, self.now_s)

    def drive(self) -> None:
        self.bench.core.activate(ready=True)
        self.cycle(1)
        assert self.command(1, 1.0)[0].answer is not None
        assert self.gate.state is GateState.DRIVING

    def drive_on(self, counter: int) -> None:
        self.cycle(counter)
        assert self.command(counter, 1.0)[0].answer is not None

    @property
    def gate(self) -> Any:
        return self.bench.core.gate


@pytest.fixture
def turned(real_time: Any, monkeypatch: pytest.MonkeyPatch) -> Turned:
    return Turned(real_time, monkeypatch)


def broken(message: can.Message) -> can.Message:
    data = bytearray(message.data)
    data[-1] ^= 1
    return can.Message(
        arbitration_id=message.arbitration_id, is_extended_id=message.is_extended_id, data=data
    )


def test_time_is_counted_by_intact_sync_frames_alone(codec: Codec, readings: Any) -> None:
    messages = codec.encode_cycle(readings(1))
    frames = [codec.receive(message) for message in messages]
    assert [tells_time(frame) for frame in frames] == [True] + [False] * (len(frames) - 1)
    assert not tells_time(codec.receive(broken(messages[0])))
    assert not tells_time(None)


def test_the_step_of_the_frame_itself_comes_first(turned: Turned) -> None:
    messages = turned.bench.codec.encode_cycle(turned.bench.readings(1))
    steps = [turned.take(message) for message in messages]
    assert [of[0].sample is not None for of in steps] == [False] * (len(messages) - 1) + [True]
    # The stamp of what comes first is that of its arrival.
    sample = steps[-1][0].sample
    assert sample is not None
    assert sample.stamp_ns == pytest.approx(ROS_NS, abs=2e6)
    # A message that is none of the bridge's is nothing, and no pause of the bus.
    turned.now_s += LONGEST_SILENCE_S - 1e-6
    assert turned.turns.received(None, None, turned.now_s, idle=False) == (NOTHING, NOTHING)
    assert not turned.bench.core._supervision.outdated
    # But where the interface tells when it came it shows how far the bus is read.
    turned.turns.received(None, None, turned.now_s, idle=False, read_to_s=turned.now_s)
    assert turned.bench.core._supervision.outdated


def test_a_frame_before_the_first_sync_has_no_time(turned: Turned) -> None:
    messages = turned.bench.codec.encode_cycle(turned.bench.readings(1))
    assert set(turned.take(messages[1])) == {NOTHING}
    assert turned.bench.core.clock.zero_stamp_ns is None


def test_silence_ends_driving_where_nothing_waits(turned: Turned) -> None:
    turned.drive()
    turned.now_s += 0.0099
    assert turned.take(None)[0] is NOTHING
    assert turned.gate.state is GateState.DRIVING
    turned.now_s += 0.0002
    steps = turned.take(None)
    assert turned.gate.reason == "nothing from the device for 10 ms"
    assert [step.answer is not None for step in steps if step is not NOTHING] == [True]


def test_where_something_always_waits_silence_is_told_later(turned: Turned) -> None:
    turned.drive()
    other = turned.bench.codec.encode_cycle(turned.bench.readings(1))[1]
    start = turned.now_s
    turned.now_s = start + 0.049
    turned.take(other)
    assert turned.gate.state is GateState.DRIVING
    turned.now_s = start + LONGEST_SILENCE_S + 1e-9
    turned.take(other)
    assert turned.gate.reason == "no sync frame from the device for 10 ms"
    assert LONGEST_SILENCE_S == 0.05


def test_sync_frames_that_stay_away_end_driving_though_others_come(turned: Turned) -> None:
    """A frame that did not wait shows that the bus is read up to the present."""
    turned.drive()
    others = turned.bench.codec.encode_cycle(turned.bench.readings(1))[1:]
    for ms in range(1, 10):
        turned.now_s += 0.001
        turned.take(others[ms % 4], told=True)
        assert turned.gate.state is GateState.DRIVING, ms
    turned.now_s += 0.0012
    steps = turned.take(others[0], told=True)
    assert turned.gate.reason == "no sync frame from the device for 10 ms"
    assert [step.answer is not None for step in steps if step is not NOTHING] == [True]


def test_what_waited_behind_a_stall_is_no_silence(turned: Turned) -> None:
    """The next sync frame waits behind it: this process was late, not the device."""
    turned.drive()
    others = turned.bench.codec.encode_cycle(turned.bench.readings(1))[1:]
    turned.now_s += 0.040
    turned.take(others[0], waited_s=0.0399, told=True)
    turned.take(others[1], waited_s=0.031, told=True)
    assert turned.gate.state is GateState.DRIVING
    # So is what was read in time and looked at late.
    turned.drive_on(2)
    turned.now_s += 0.001
    turned.take(others[2], told=True, later_s=0.030)
    assert turned.gate.state is GateState.DRIVING
    turned.drive_on(3)
    turned.now_s += 0.012
    turned.take(others[3], waited_s=0.0015, told=True)
    assert turned.gate.reason == "no sync frame from the device for 10 ms"


@pytest.mark.parametrize("kind", ["the same", "from afar", "late"])
def test_sync_frames_that_begin_no_cycle_end_no_silence(turned: Turned, kind: str) -> None:
    turned.drive()
    turned.cycle(2)
    turned.command(2, 1.0)
    counters = {"the same": [2] * 3, "from afar": [8192 * k for k in (3, 5, 7)], "late": [1, 7, 1]}
    since = turned.now_s
    for counter in counters[kind]:
        turned.now_s += 0.003
        turned.take(turned.bench.codec.encode_cycle(turned.bench.readings(counter))[0])
        turned.take(None)
        if kind == "late" and counter == 7:
            since = turned.now_s  # that one went on
        assert turned.gate.state is GateState.DRIVING
    turned.now_s = since + 0.0101
    assert turned.command(7 if kind == "late" else 2, 1.0)[0] is NOTHING
    assert turned.bench.core.commands.outdated == 1
    turned.take(None)
    assert turned.gate.reason == "the device's sample counter did not go on for 10 ms"


def test_a_device_that_speaks_and_has_no_whole_cycle_lacks_something(turned: Turned) -> None:
    def lacking(counter: int) -> bool:
        """After a cycle without encoders."""
        turned.now_s += 0.5
        frames = turned.bench.codec.encode_cycle(turned.bench.readings(counter))
        for frame in (frames[0], *frames[2:]):
            turned.take(frame)
        return turned.turns.lacking(turned.now_s)

    turned.now_s += 60.0  # nothing was said: nothing was lacking
    assert not turned.turns.lacking(turned.now_s)
    assert [lacking(counter) for counter in range(1, 8)] == [False] * 6 + [True]
    turned.cycle(8)
    assert not turned.turns.lacking(turned.now_s)
    assert [lacking(counter) for counter in range(9, 15)] == [False] * 5 + [True]
    turned.cycle(15)
    turned.cycle(15)  # sent again is whole, too
    assert not turned.turns.lacking(turned.now_s + SILENT_S)
    turned.now_s += 2.0
    turned.cycle(15)
    turned.now_s += 2.0
    assert not lacking(16)


def test_times_are_held_to_and_not_fallen_short_of(turned: Turned) -> None:
    """At the very limit: silence is told, and others are not gone yet."""
    turned.now_s = -PERIOD_S
    turned.drive()
    assert turned.now_s == 0.0
    turned.take(turned.bench.codec.encode_command(9, (1.0, 1.0), enable=True))
    turned.turns.look_for_others(CLAIM_PERIOD_S)
    assert FOREIGN in turned.gate.faults
    core = turned.bench.core
    turned.turns.received(None, None, 0.04, idle=False)
    assert not core._supervision.outdated
    turned.turns.received(None, None, LONGEST_SILENCE_S, idle=False)
    assert core._supervision.outdated


def test_an_arrival_is_as_it_came() -> None:
    arrival = Arrival(1.0, 0.5, 7)
    with pytest.raises(FrozenInstanceError):
        arrival.waited_s = 0.0  # type: ignore[misc]
    assert not hasattr(arrival, "__dict__")


def test_a_command_is_as_old_as_the_last_sync_frame(turned: Turned) -> None:
    turned.drive()
    turned.now_s += 0.011
    assert turned.command(1, 1.0)[0] is NOTHING
    assert turned.bench.core.commands.outdated == 1
    turned.cycle(2)
    assert turned.command(2, 1.0)[0].answer is not None


def test_commands_are_told_their_publishers_numbers(turned: Turned) -> None:
    turned.drive()
    for counter, number in ((2, 7), (3, 8), (4, 3)):
        turned.cycle(counter)
        turned.command(counter, 1.0, number)
    assert turned.gate.state is GateState.TRIPPED


def test_what_waited_too_long_to_be_read_drives_nothing(turned: Turned) -> None:
    turned.drive()
    turned.cycle(2, waited_s=0.010)
    assert turned.gate.state is GateState.DRIVING
    (stop,) = [step for step in turned.cycle(3, waited_s=0.011) if step.answer is not None][:1]
    assert "waited for 11 ms to be read" in turned.gate.reason
    assert not turned.bench.sent(stop.answer).enable


def test_the_pace_of_a_device_is_that_of_when_its_frames_came(turned: Turned) -> None:
    """Read later and later they look slower: one at twice the rate is found all the same."""
    turned.drive()
    for counter in range(2, 4000):
        turned.cycle(counter, waited_s=0.5 * PERIOD_S * (counter - 1))
    assert "other_period" in turned.gate.faults


@pytest.mark.parametrize("how", ["idle", "sync", "tried"])
def test_the_state_of_the_bus_is_looked_at_when_it_may_be_news(turned: Turned, how: str) -> None:
    turned.drive()
    messages = turned.bench.codec.encode_cycle(turned.bench.readings(2))
    turned.take(messages[0])
    turned.bench.wire.off = True
    turned.take(messages[1])
    assert turned.gate.state is GateState.DRIVING
    if how == "idle":
        turned.take(None)
    elif how == "sync":
        turned.take(messages[0])
    else:
        turned.link.tried = True
        turned.take(messages[2])
    assert turned.gate.reason == "bus-off: the CAN controller left the bus"
    assert BUS_OFF in turned.gate.faults


def test_a_command_looks_at_the_bus_itself(turned: Turned) -> None:
    turned.drive()
    turned.cycle(2)
    turned.bench.wire.off = True
    first, *others = turned.command(2, 1.0)
    assert first.answer is not None
    assert [step.answer is not None for step in others if step is not NOTHING] == [True]
    assert turned.gate.reason == "bus-off: the CAN controller left the bus"


def test_valve_frames_of_others_end_driving_until_they_stay_away(turned: Turned) -> None:
    turned.drive()
    message = turned.bench.codec.encode_command(9, (1.0, 1.0), enable=True)
    turned.take(broken(message))
    assert turned.gate.state is GateState.DRIVING
    turned.take(turned.bench.wire.sent[-1])  # its own
    assert turned.gate.state is GateState.DRIVING
    assert turned.take(message)[0].answer is not None
    assert turned.gate.reason == "valve frames of another sender are on the bus"
    turned.now_s += CLAIM_PERIOD_S - 1e-6
    turned.turns.look_for_others(turned.now_s)
    assert FOREIGN in turned.gate.faults
    # Its own, heard once more, are no reason to wait.
    turned.take(turned.bench.wire.sent[-1])
    turned.now_s += 2e-6
    turned.turns.look_for_others(turned.now_s)
    assert FOREIGN not in turned.gate.faults


def test_a_second_bridge_ends_driving_until_it_is_gone(turned: Turned) -> None:
    turned.drive()
    codec, own = turned.bench.codec, turned.claim.instance
    turned.take(codec.encode_claim(own, 3))
    turned.take(broken(codec.encode_claim(own ^ 1, 3)))
    assert turned.gate.state is GateState.DRIVING
    first = turned.take(codec.encode_claim(own ^ 1, 4))[0]
    assert first.answer is not None
    assert turned.gate.reason == "a second bridge is on the bus"
    turned.now_s += GONE_S
    turned.turns.look_for_others(turned.now_s)
    assert SECOND_BRIDGE in turned.gate.faults
    turned.now_s += 1e-3
    turned.turns.look_for_others(turned.now_s)
    assert turned.gate.faults == {}


def test_a_device_is_silent_for_longer_than_one_in_lockstep(turned: Turned) -> None:
    for _ in range(2):
        turned.now_s += SILENT_S
        assert not turned.turns.silent(turned.now_s)
        assert turned.turns.silent(turned.now_s + 1e-6)
        turned.now_s += 1.0
        turned.cycle(1)
    assert SILENT_S == 2.5


def test_it_waits_for_subscribers_while_it_is_active(turned: Turned) -> None:
    core = turned.bench.core
    assert not turned.turns.waits
    turned.turns.matched()
    assert not core.ready
    core.activate()
    assert turned.turns.waits
    turned.turns.matched()
    assert core.ready
    assert not turned.turns.waits


def test_it_is_said_where_the_bus_takes_no_last_frame(turned: Turned) -> None:
    core, wire = turned.bench.core, turned.bench.wire
    assert not turned.turns.deactivate()  # not active
    core.activate()
    assert not turned.turns.deactivate()  # no device
    core.activate()
    turned.cycle(1)
    assert not turned.turns.deactivate()  # taken
    wire.taking = False
    core.activate()
    assert turned.turns.deactivate()
    assert not core.active


def test_a_new_core_takes_over_what_must_outlive_the_one_before(
    turned: Turned, lockstep: Any
) -> None:
    turned.drive()
    turned.gate.trip("test")
    turned.turns.begin(lockstep.core)
    assert turned.turns.core is lockstep.core
    assert lockstep.core.gate.reason == "test"
