"""How `can_bridge` falls silent: whatever delays or refuses a frame, the last one is 0 V."""

from __future__ import annotations

import gc
import itertools
import os
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_name import BusName
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.gate.gate import GateState
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame, Readings

rclpy = pytest.importorskip("rclpy")
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

from hydro_hw_bridge.bus import claims  # noqa: E402
from hydro_hw_bridge.bus.link import UNSENT  # noqa: E402
from hydro_hw_bridge.core.bridge_turns import BridgeTurns  # noqa: E402
from hydro_hw_bridge.node import bridge as bridge_module  # noqa: E402
from hydro_hw_bridge.node import bridge_loops as loops_module  # noqa: E402
from hydro_hw_bridge.node.bridge import CanBridge  # noqa: E402
from hydro_msgs_docs.messages import joint_state  # noqa: E402
from hydro_msgs_docs.topics import VALVE_COMMAND, reliable  # noqa: E402

pytestmark = pytest.mark.ros

CAN = f"udp_multicast:239.74.163.2:{2_000 + (os.getpid() + 2_000) % 5_000}"
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 60.0
NAMES = ["lift_valve", "tilt_valve"]
#: One each: a bridge that a thread holds stays in its domain.
_domains = itertools.count(os.getpid() + 10)
Make = Callable[..., Readings]


class SlowBus(Bus):
    """A real bus that can hold enabled frames back, refuse disabled ones or all, and read late."""

    def __init__(self, name: BusName, bus: can.BusABC, codec: Codec) -> None:
        super().__init__(name, bus)
        self._codec = codec
        self.holding = False
        self.held, self.go = threading.Event(), threading.Event()
        self.refusals = 0
        self.deaf = False
        self.read_after_s = 0.0
        self.reads_late, self.read_on = threading.Event(), threading.Event()

    def receive(self, timeout_s: float) -> can.Message | None:
        if self.read_after_s > 0.0:
            self.reads_late.set()
            self.read_on.wait(self.read_after_s)
        return super().receive(timeout_s)

    def send(self, message: can.Message) -> bool:
        frame = self._codec.receive(message)
        if frame is not None and frame.role == "command":
            enabled = self._codec.decode_command(frame).enable
            if enabled and self.holding:
                self.held.set()
                assert self.go.wait(PATIENCE_S)
            if self.deaf:
                return False
            if not enabled and self.refusals > 0:
                self.refusals -= 1
                return False
        return super().send(message)


class Bench:
    """A bridge in this process, a scripted device on its bus and a controller."""

    def __init__(self, bridge: CanBridge, device: Bus, codec: Codec, readings: Make) -> None:
        self.bridge, self.device, self.codec, self.readings = bridge, device, codec, readings
        self.node = rclpy.create_node("bridge_ends_test")
        self.publisher = self.node.create_publisher(JointState, VALVE_COMMAND, reliable())
        self.frames: list[CommandFrame] = []

    @property
    def bus(self) -> SlowBus:
        bus = self.bridge._parts.bus
        assert isinstance(bus, SlowBus)
        return bus

    def until(self, true: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not true():
            assert time.monotonic() < end
            time.sleep(0.005)

    def send(self, counter: int, *, lockstep: bool = True) -> None:
        for message in self.codec.encode_cycle(self.readings(counter, lockstep=lockstep)):
            self.device.send(message)

    def cycle(self, counter: int, *, lockstep: bool = True) -> None:
        self.send(counter, lockstep=lockstep)
        self.until(
            lambda: (s := self.bridge._loops.core.sample) is not None and s.counter == counter
        )

    def ask(self, counter: int, *voltages: float) -> None:
        clock = self.bridge._loops.core.clock
        self.publisher.publish(joint_state(clock.stamp_ns(counter), NAMES, effort=voltages))

    def collect(self) -> list[CommandFrame]:
        while (message := self.device.receive(0.2)) is not None:
            frame = self.codec.receive(message)
            if frame is not None and frame.role == "command":
                self.frames.append(self.codec.decode_command(frame))
        return self.frames

    def drive(self) -> None:
        """Until a command is on the bus."""
        self.bridge.trigger_configure()
        self.cycle(1)
        self.bridge.trigger_activate()
        end = time.monotonic() + PATIENCE_S
        # Again until it is there: before both ends have matched it is lost; a repeat does nothing.
        while self.bridge._loops.core.commands.accepted == 0:
            assert time.monotonic() < end
            self.ask(1, 1.0, 0.0)
            time.sleep(0.05)
        self.cycle(2)


@pytest.fixture
def bench(
    codec: Codec,
    readings: Make,
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> Iterator[Bench]:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    gc.collect()  # the node of the test before is in its domain until then

    def slow(text: str, identifiers: Any) -> SlowBus:
        bus = open_bus(text, identifiers)
        return SlowBus(bus.name, bus._bus, codec)

    monkeypatch.setattr(bridge_module, "open_bus", slow)
    # Nobody else is on this bus; how long it listens is tested in test_claims.py.
    monkeypatch.setattr(claims, "LISTEN_S", 0.02)
    monkeypatch.setattr(claims, "CONTEST_S", 0.02)
    # Time for all its last frames, should the machine be busy.
    monkeypatch.setattr(loops_module, "LAST_S", PATIENCE_S)
    rclpy.init(
        args=[
            "--ros-args",
            "-p",
            f"can:={CAN}",
            "-p",
            f"clock:={getattr(request, 'param', 'lockstep')}",
        ],
        domain_id=10 + next(_domains) % 90,
    )
    with open_bus(CAN, codec.bridge_ids) as device:
        bridge = CanBridge(threading.Event())
        bench = Bench(bridge, device, codec, readings)
        yield bench
        bench.bus.go.set()
        monkeypatch.undo()  # a bus that a test has closed takes no frame however long
        bridge.close()
        bench.node.destroy_node()
        bridge.destroy_node()
    rclpy.try_shutdown()


def assert_ended_at_zero(bench: Bench) -> None:
    frames = bench.collect()
    assert any(frame.enable for frame in frames)
    assert (frames[-1].voltages, frames[-1].enable) == ((0.0, 0.0), False)


@pytest.mark.parametrize("end", ["trigger_deactivate", "trigger_shutdown", "close", "end"])
def test_a_command_held_back_by_the_bus_is_not_the_last_frame(bench: Bench, end: str) -> None:
    bench.drive()
    bench.bus.holding = True
    bench.ask(2, 2.0, 0.0)
    assert bench.bus.held.wait(PATIENCE_S)
    ending = threading.Thread(target=getattr(bench.bridge, end))
    ending.start()
    time.sleep(0.2)
    bench.bus.go.set()
    ending.join(PATIENCE_S)
    assert not ending.is_alive()
    assert_ended_at_zero(bench)


@pytest.mark.parametrize("end", ["trigger_deactivate", "close"])
def test_zero_is_sent_until_the_bus_takes_it(bench: Bench, end: str) -> None:
    bench.drive()
    bench.bus.refusals = 4
    getattr(bench.bridge, end)()
    assert_ended_at_zero(bench)
    assert bench.bus.refusals == 0


def test_the_last_frames_are_several(bench: Bench) -> None:
    bench.drive()
    bench.bridge.close()
    assert_ended_at_zero(bench)
    off = [frame.enable for frame in bench.frames][::-1].index(True)
    assert off >= 5


def test_a_bridge_that_ends_is_not_activated_any_more(bench: Bench) -> None:
    bench.drive()
    bench.bridge.trigger_deactivate()
    bench.bridge.end()
    bench.bridge.end()
    bench.bridge.trigger_activate()
    assert not bench.bridge._loops.core.active
    assert_ended_at_zero(bench)


def test_a_trip_survives_cleanup_and_configure(bench: Bench) -> None:
    bench.drive()
    bench.ask(2, 99.0, 0.0)
    bench.until(lambda: bench.bridge._loops.core.gate.state is GateState.TRIPPED)
    reason = bench.bridge._loops.core.gate.reason
    assert "command of 99.000 V" in reason
    before = bench.bridge._loops.core
    for transition in ("deactivate", "cleanup", "configure", "activate"):
        getattr(bench.bridge, f"trigger_{transition}")()
    gate = bench.bridge._loops.core.gate
    assert bench.bridge._loops.core is not before
    assert (gate.state, gate.reason, gate.trips) == (GateState.TRIPPED, reason, 1)
    bench.cycle(10)
    assert not any(frame.enable for frame in bench.collect()[-3:])
    assert gate.clear() == (True, f"cleared: {reason}")


@pytest.mark.parametrize("bench", ["real_time"], indirect=True)
def test_frames_that_wait_to_be_read_are_noticed(bench: Bench) -> None:
    bench.bridge.trigger_configure()
    bench.bus.read_after_s = 0.1
    assert bench.bus.reads_late.wait(PATIENCE_S)
    bench.cycle(1, lockstep=False)
    bench.cycle(2, lockstep=False)
    bench.until(lambda: bench.bridge._loops.core.read_late > 0)


@pytest.mark.parametrize("bench", ["real_time"], indirect=True)
def test_what_came_while_nobody_read_is_no_sample(bench: Bench) -> None:
    bench.send(1, lockstep=False)
    for counter in (300, 600):
        bench.bridge.trigger_configure()
        bench.cycle(counter, lockstep=False)
        assert bench.bridge._loops.core.assembler.counters.complete == 1
        bench.bridge.trigger_cleanup()
        bench.send(counter + 1, lockstep=False)


@pytest.mark.parametrize("bench", ["real_time"], indirect=True)
def test_stamps_begin_when_the_first_frame_came_not_when_it_was_read(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench.bus, "drain", lambda: None)
    sent_ns = time.time_ns()
    bench.send(7, lockstep=False)
    came_ns = time.time_ns()
    time.sleep(0.5)
    bench.bridge.trigger_configure()
    core = bench.bridge._loops.core
    bench.until(lambda: core.sample is not None)
    assert core.sample is not None
    # The frame's own time and the two readings of the clock are a moment apart.
    assert sent_ns - 50_000_000 < core.sample.stamp_ns < came_ns + 50_000_000


def test_bytes_that_are_no_command_are_passed_over_and_counted(bench: Bench) -> None:
    bench.drive()
    accepted = bench.bridge._loops.core.commands.accepted
    whole = serialize_message(joint_state(1, NAMES, effort=[1.0, 0.0]))
    endless = whole[:12] + b"\xff" * 8 + whole[20:]
    for data in (whole[:40], whole[:5], b"\x00\x07\x00\x00" + whole[4:], bytes(4), endless):
        bench.publisher.publish(data)
    bench.ask(2, 1.5, 0.0)
    bench.until(lambda: bench.bridge._loops.core.commands.accepted == accepted + 1)
    _, _, values = bench.bridge._loops.report({})
    assert values["unreadable_commands"] == 5
    assert bench.bridge.failure == ""
    assert bench.bridge._loops.core.gate.state is not GateState.TRIPPED


def test_a_bus_that_takes_no_frame_is_told_though_nobody_commands(bench: Bench) -> None:
    """The device asks for its answer again and again; the bus is looked at all the same."""
    bench.drive()
    bench.ask(2, 1.5, 0.0)
    bench.until(lambda: bench.bridge._loops.core.commands.accepted >= 2)
    bench.bus.deaf = True
    gate, end = bench.bridge._loops.core.gate, time.monotonic() + PATIENCE_S
    while UNSENT not in gate.faults:
        assert time.monotonic() < end
        bench.cycle(2)
        time.sleep(0.01)
    assert "valve frames cannot be sent" in gate.reason
    bench.bus.deaf = False


def test_a_thread_that_the_bus_holds_is_told_and_never_comes_alive_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loops_module, "JOIN_S", 0.1)
    bench.bridge.trigger_configure()
    bench.bus.read_after_s = PATIENCE_S
    assert bench.bus.reads_late.wait(PATIENCE_S)
    (held,) = (t for t in bench.bridge._loops._threads if t.name == "can")
    bench.bridge.trigger_cleanup()
    assert "expected threads to end within 0.1 s, found can held on" in bench.bridge.failure
    assert bench.bridge._stop.is_set()  # the process ends
    bench.bus.read_after_s = 0.0
    bench.bridge.trigger_configure()
    bench.bus.read_on.set()
    held.join(PATIENCE_S)
    assert not held.is_alive()


@pytest.mark.parametrize("asking", ["report", "_look_for_subscribers"])
def test_what_is_told_of_the_turns_is_asked_between_them(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, asking: str
) -> None:
    bench.bridge.trigger_configure()
    loops, asked = bench.bridge._loops, list[float]()

    def late(*_: object) -> bool:
        asked.append(time.monotonic())
        return True

    monkeypatch.setattr(BridgeTurns, "silent", late)
    monkeypatch.setattr(BridgeTurns, "waits", property(late))
    argument = {} if asking == "report" else loops._topics
    other = threading.Thread(target=getattr(loops, asking), args=(argument,))
    with loops._lock:  # a turn
        other.start()
        other.join(0.3)
        assert other.is_alive()
        assert not asked
    other.join(PATIENCE_S)
    assert asked
