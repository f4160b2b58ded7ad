"""The bridge's end of a bus that takes no frames, is gone, and comes back, on a real interface."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.bus.claims import Claim
from hydro_hw_bridge.bus.link import CommandLink
from hydro_hw_bridge.core.bridge_core import CLOSING_CYCLES, BridgeCore
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame, Echo, Readings

NAMES = ("lift_valve", "tilt_valve")
LIMITS = GateLimits(NAMES, (10.0, 10.0), 0.002, 1000.0, 5, 2.0e6)
PLACE = f"239.74.163.2:{2_000 + (os.getpid() + 500) % 5_000}"
#: Longer than the interface takes to look at its file.
LOOK_S = 0.03


class Ends:
    """Bridge and machine on one bus, the bridge's end with faults on command of a file."""

    def __init__(
        self, near: Bus, far: Bus, control: Path, codec: Codec, readings: Callable[..., Readings]
    ) -> None:
        self.near, self.far, self.control = near, far, control
        self.codec, self.readings = codec, readings
        self.link = CommandLink(near, LIMITS.max_age_cycles)
        self.core = BridgeCore(codec, LIMITS, lockstep=False, send=self.link.send)
        self.core.activate(ready=True)
        self.counter = 0

    def say(self, text: str) -> None:
        self.control.write_text(text)
        time.sleep(LOOK_S)

    def cycle(self, volts: float | None) -> None:
        """A cycle of the machine, and a command or none."""
        self.counter += 1
        heard = Echo(self.near.counters.sent, 0)
        for message in self.codec.encode_cycle(self.readings(self.counter, echo=heard)):
            self.far.send(message)
        for _ in self.codec.cycle_frames:
            message = self.near.receive(1.0)
            frame = None if message is None else self.codec.receive(message)
            if frame is not None:
                self.core.receive(frame, 1)
        if volts is not None and self.core.sample is not None:
            self.core.command(self.core.sample.stamp_ns, NAMES, (volts, 0.0))
        for condition in self.link.conditions():
            self.core.condition(*condition)

    def heard(self) -> list[CommandFrame]:
        found = []
        while (message := self.far.receive(0.05)) is not None:
            frame = self.codec.receive(message)
            if frame is not None and frame.role == "command":
                found.append(self.codec.decode_command(frame))
        return found


@pytest.fixture
def ends(tmp_path: Path, codec: Codec, readings: Callable[..., Readings]) -> Iterator[Ends]:
    control = tmp_path / "faults"
    with (
        open_bus(f"simulated_faults:{PLACE}:{control}", codec.device_ids) as near,
        # All identifiers: passing over its own frames would use up the time to wait for others.
        open_bus(f"udp_multicast:{PLACE}") as far,
    ):
        yield Ends(near, far, control, codec, readings)


def test_a_full_send_queue_trips_and_zero_is_the_first_that_leaves_again(ends: Ends) -> None:
    ends.cycle(1.0)
    assert ends.heard()[-1].enable
    ends.say("queue_full")
    for _ in range(LIMITS.max_age_cycles + 1):
        ends.cycle(1.0)
    assert ends.core.gate.state is GateState.TRIPPED
    assert ends.core.gate.reason == "valve frames cannot be sent"
    assert ends.near.counters.dropped >= LIMITS.max_age_cycles + 1
    assert ends.heard() == []
    assert ends.core.gate.clear()[1] == "still there: valve frames cannot be sent"
    ends.say("ok")
    for _ in range(3):
        ends.cycle(1.0)
    assert {(frame.enable, *frame.voltages) for frame in ends.heard()} == {(False, 0.0, 0.0)}
    assert ends.core.gate.clear()[0]
    ends.cycle(1.0)
    assert ends.heard()[-1].voltages == (0.02, 0.0)


def test_an_inactive_bridge_says_no_more_that_nothing_can_be_sent_once_its_claims_are(
    ends: Ends,
) -> None:
    ends.cycle(1.0)
    ends.say("queue_full")
    for _ in range(LIMITS.max_age_cycles + 1):
        ends.cycle(1.0)
    ends.core.deactivate()
    for _ in range(CLOSING_CYCLES + 3):
        ends.cycle(None)
    claim = Claim(ends.near, ends.codec)
    claim.send()
    assert ends.core.gate.clear() == (False, "still there: valve frames cannot be sent")
    ends.say("ok")
    for _ in range(LIMITS.max_age_cycles + 1):
        assert not ends.core.gate.clear()[0]
        claim.send()
        ends.cycle(None)
    assert ends.core.gate.faults == {}
    assert ends.core.gate.clear()[0]
    ends.core.activate(ready=True)
    ends.heard()
    ends.cycle(1.0)
    assert ends.heard()[-1].enable


def test_an_interface_that_is_gone_is_said_and_carries_again_once_it_is_back(ends: Ends) -> None:
    ends.cycle(1.0)
    ends.say("gone")
    assert not ends.near.send(ends.codec.encode_command(1, (0.0, 0.0), False))
    assert ends.near.counters.send_errors == 1
    with pytest.raises(BridgeError, match="receiving failed: simulated: the interface is gone"):
        ends.near.receive(0.1)
    ends.say("ok")
    ends.heard()
    ends.cycle(1.0)
    assert ends.heard()[-1].enable
