"""Bus names, and frames between processes over the real multicast interface."""

from __future__ import annotations

import errno
import os
import socket
import subprocess
import sys
import time
from functools import partial
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest

from hydro_hw_bridge.bus import bus as bus_module
from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_name import BusName, parse_bus
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.bus.error_frames import BUS_OFF, error_frame, name_of
from hydro_hw_bridge.bus.simulated_faults import begun_ns
from hydro_hw_bridge.errors import BridgeError

GROUP = "239.74.163.2"
PORT = 2_000 + (os.getpid() + 4_000) % 5_000
NAME = f"udp_multicast:{GROUP}:{PORT}"
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 120.0


def message(identifier: int = 0x80, data: bytes = b"\x01\x02\x03") -> can.Message:
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=data)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("can0", BusName("socketcan", "can0")),
        ("socketcan:vcan1", BusName("socketcan", "vcan1")),
        (f"udp_multicast:{GROUP}", BusName("udp_multicast", GROUP, 43113)),
        (f"udp_multicast:{GROUP}:1234", BusName("udp_multicast", GROUP, 1234)),
        ("pcan:PCAN_USBBUS1", BusName("pcan", "PCAN_USBBUS1")),
    ],
)
def test_bus_names(text: str, expected: BusName) -> None:
    assert parse_bus(text) == expected
    assert parse_bus(str(expected)) == expected


@pytest.mark.parametrize(
    "text",
    [
        "",
        ":",
        ":can0",
        "udp_multicast:127.0.0.1:43113",
        "udp_multicast:ff15::1",
        "udp_multicast:239.0.0.1:0",
        "udp_multicast:239.0.0.1:99999",
        "udp_multicast:239.0.0.1:port",
    ],
)
def test_malformed_bus_names(text: str) -> None:
    with pytest.raises(BridgeError, match="expected"):
        parse_bus(text)


@pytest.mark.parametrize("text", ["can77", "socketcan:can77", "no_such_interface:0", "kvaser:0"])
def test_absent_interfaces_are_one_line(text: str) -> None:
    with pytest.raises(BridgeError) as raised:
        open_bus(text)
    assert str(raised.value).startswith("cannot open CAN bus")
    assert "\n" not in str(raised.value)


def test_a_port_taken_by_another_program_is_busy() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        port = taken.getsockname()[1]
        with pytest.raises(BridgeError, match="Address already in use"):
            open_bus(f"udp_multicast:{GROUP}:{port}")


def test_frames_stay_on_this_machine() -> None:
    with open_bus(NAME) as bus, socket.socket(fileno=os.dup(bus._bus.fileno())) as inner:
        assert inner.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
        interface = inner.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4)
        assert interface == socket.inet_aton("127.0.0.1")
        assert inner.family == socket.AF_INET


ECHO = """
import can, sys
from hydro_hw_bridge.bus.bus_open import open_bus
with open_bus(sys.argv[1], [0x80]) as bus:
    print("ready", flush=True)
    for _ in range(200):
        message = None
        while message is None:
            message = bus.receive(5.0)
        bus.send(can.Message(arbitration_id=0x90, is_extended_id=False, data=message.data[::-1]))
"""


def test_two_processes_exchange_frames() -> None:
    with open_bus(NAME, [0x90]) as bus:
        process = subprocess.Popen(
            [sys.executable, "-c", ECHO, NAME], stdout=subprocess.PIPE, text=True
        )
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            for number in range(200):
                data = number.to_bytes(4, "little") + b"rest"
                assert bus.send(message(0x80, data))
                answer = bus.receive(PATIENCE_S)
                assert answer is not None
                assert answer.arbitration_id == 0x90
                assert bytes(answer.data) == data[::-1]
            assert process.wait(PATIENCE_S) == 0
        finally:
            process.kill()
            process.wait()
        assert bus.counters.received == bus.counters.sent == 200


def test_only_the_asked_identifiers_are_received() -> None:
    with open_bus(NAME, [0x80]) as bus, open_bus(NAME) as other:
        other.send(message(0x81))
        other.send(message(0x80))
        received = bus.receive(2.0)
        assert received is not None
        assert received.arbitration_id == 0x80
        assert bus.receive(0.05) is None


def test_error_frames_come_through_where_python_can_itself_would_filter_them() -> None:
    with (
        can.Bus("errors", interface="virtual") as other,
        open_bus("virtual:errors", [0x80]) as bus,
    ):
        other.send(error_frame(BUS_OFF))
        assert bus.receive(2.0) is None
        assert (bus.counters.error_frames, bus.off) == (1, True)


@pytest.mark.parametrize(
    ("name", "own"), [("virtual:own", False), (NAME, True)], ids=["virtual", "multicast"]
)
def test_whether_a_sender_hears_itself_is_known(name: str, own: bool) -> None:
    with open_bus(name, [0x80]) as bus:
        assert bus.hears_itself is own
        assert bus.tells_waiting
        assert bus.send(message(0x80))
        assert (bus.receive(2.0 if own else 0.05) is not None) is own


def test_what_waits_is_taken_whatever_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_module, "_DRAIN_S", 60.0)
    with open_bus(NAME, [0x80]) as bus, open_bus(NAME) as other:
        bus.drain()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            loopback = socket.inet_aton("127.0.0.1")
            stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
            # Frames of others, which are filtered out, and what is no frame, end nothing.
            for garbage in (b"\x00", b"hello"):
                other.send(message(0x80))
                other.send(message(0x81))
                stranger.sendto(garbage, (GROUP, PORT))
        other.send(message(0x80))
        with monkeypatch.context() as patched:
            # A filtered frame takes 0.6 ms of the pause, however busy the machine is.
            patched.setattr("can.bus.time", partial(next, count(0.0, 0.0006)))
            bus.drain()
        assert bus.counters.received == 3
        assert bus.receive(0.05) is None


def test_a_bus_that_never_rests_is_drained_for_so_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_module, "_DRAIN_S", 0.02)
    clock, taken = SimpleNamespace(now_s=0.0), list[float]()

    def frame(pause_s: float) -> can.Message:
        taken.append(pause_s)
        clock.now_s += 1.0e-3
        return message()

    with open_bus(NAME) as bus, monkeypatch.context() as patched:
        patched.setattr(bus, "receive", frame)
        patched.setattr(bus_module, "time", SimpleNamespace(monotonic=lambda: clock.now_s))
        bus.drain()
    assert 20 <= len(taken) <= 21


def test_garbage_on_the_port_is_counted_and_survived() -> None:
    with open_bus(NAME) as bus, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        loopback = socket.inet_aton("127.0.0.1")
        stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
        for garbage in (b"", b"\x00", b"hello" * 100, b"\x81\xa1a\x01", os.urandom(64)):
            stranger.sendto(garbage, (GROUP, PORT))
        for _ in range(5):
            assert bus.receive(2.0) is None
        assert bus.counters.malformed == 5
        bus.send(message())
        assert bus.receive(2.0) is not None


class RefusingBus(can.BusABC):
    """An interface whose send queue is full, or that is gone, as the kernel reports it."""

    def __init__(self, number: int) -> None:
        super().__init__(channel="refusing")
        self._number = number

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        cause = OSError(self._number, os.strerror(self._number))
        raise can.CanOperationError("Failed to transmit") from cause

    def _recv_internal(self, timeout: float | None) -> Any:
        raise can.CanOperationError("Network is down", errno.ENETDOWN)


def test_a_full_send_queue_drops_and_counts() -> None:
    with Bus(BusName("socketcan", "x"), RefusingBus(errno.ENOBUFS)) as bus:
        assert not bus.send(message())
        assert not bus.send(message())
        assert bus.counters.dropped == 2
        assert bus.counters.send_errors == bus.counters.sent == 0


def test_other_send_errors_are_counted_apart() -> None:
    with Bus(BusName("socketcan", "x"), RefusingBus(errno.ENETDOWN)) as bus:
        assert not bus.send(message())
        assert bus.counters.send_errors == 1


def test_an_interface_that_goes_away_raises() -> None:
    with (
        Bus(BusName("socketcan", "x"), RefusingBus(0)) as bus,
        pytest.raises(BridgeError, match="socketcan:x: receiving failed: Network is down"),
    ):
        bus.receive(0.1)


def test_error_frames_are_counted_not_delivered() -> None:
    with open_bus(NAME) as bus, open_bus(NAME) as other:
        other.send(can.Message(is_error_frame=True, data=bytes(8)))
        assert bus.receive(2.0) is None
        assert bus.counters.error_frames == 1


#: So often is asked for what should not come.
NONE = 5


def taken(bus: Bus, tries: int = 20) -> can.Message | None:
    """The next data frame, past error frames and what is none."""
    for _ in range(tries):
        if (received := bus.receive(0.05)) is not None:
            return received
    return None


def test_simulated_faults_on_command(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    control = tmp_path / "faults"
    name = f"simulated_faults:{GROUP}:{PORT}:{control}"
    with open_bus(name, [0x80]) as bus, open_bus(NAME) as other:
        assert str(bus.name) == name
        assert f"SIMULATED, on command of '{control}'" in caplog.text
        other.send(message(0x81))
        other.send(message())
        received = taken(bus)
        assert received is not None
        assert received.arbitration_id == 0x80
        control.write_text("error_frames 2\n")
        assert taken(bus, NONE) is None
        assert (bus.counters.error_frames, bus.off) == (2, False)
        assert bus.last_error == "protocol violation, bus error"
        before_ns = time.monotonic_ns()
        control.write_text("bus_off")
        time.sleep(0.02)
        assert not bus.send(message(0x90))
        assert (bus.off, bus.counters.send_errors) == (True, 1)
        begun = begun_ns(caplog.text, "bus_off")
        assert begun is not None
        assert before_ns < begun < time.monotonic_ns()
        assert begun_ns(caplog.text, "gone") is None
        other.send(message())
        assert taken(bus, NONE) is None
        assert bus.last_error == "bus-off"
        control.unlink()
        assert taken(bus, NONE) is None
        assert (bus.off, bus.last_error) == (False, "controller restarted")
        assert bus.send(message(0x90))
        other.send(message())
        assert taken(bus) is not None
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            loopback = socket.inet_aton("127.0.0.1")
            stranger.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, loopback)
            stranger.sendto(b"hello", (GROUP, PORT))
            assert taken(bus, NONE) is None
        assert bus.counters.malformed == 1
        control.write_text("meteorite")
        with pytest.raises(BridgeError, match=r"should say ok, bus_off, .* or error_frames N"):
            taken(bus)


def test_simulated_faults_without_a_file_never_happen(caplog: pytest.LogCaptureFixture) -> None:
    with open_bus(f"simulated_faults:{GROUP}:{PORT}") as bus:
        assert "SIMULATED, never" in caplog.text
        assert bus.send(message())
        assert taken(bus) is not None


@pytest.mark.parametrize(
    ("classes", "state", "text"),
    [
        (0x40, 0, "bus-off"),
        (0x88, 0, "protocol violation, bus error"),
        (0x04, 0x30, "controller (receive passive, transmit passive)"),
        (0x04, 0x40, "controller (active again)"),
        (0x100, 0, "controller restarted"),
        (0x00, 0, "unknown"),
    ],
)
def test_error_frames_are_named_as_linux_does(classes: int, state: int, text: str) -> None:
    frame = error_frame(classes)
    frame.data[1] = state
    assert name_of(frame) == text
    frame.data = bytearray()
    assert name_of(frame) == text.partition(" (")[0]


def test_how_long_a_frame_waited_to_be_read_is_known() -> None:
    with open_bus(NAME) as sender, open_bus(NAME) as reader:
        # Linux begins to stamp what comes a little after the first socket has asked for it, by a
        # thread of its own; until then a frame is stamped as it is read.
        waited_s, end = 0.0, time.monotonic() + PATIENCE_S
        while waited_s < 0.05 and time.monotonic() < end:
            before = time.time()
            assert sender.send(message())
            time.sleep(0.05)
            received = reader.receive(10.0)
            assert received is not None
            waited_s = reader.waited_s(received)
        assert 0.05 <= waited_s <= time.time() - before
        # Drivers that count from when they were opened tell nothing.
        received.timestamp = 3.0
        assert Bus(BusName("pcan", "PCAN_USBBUS1"), reader._bus).waited_s(received) == 0.0
        received.timestamp = time.time() + 100.0
        assert reader.waited_s(received) == 0.0


@pytest.mark.parametrize("step_s", [60.0, -60.0])
def test_a_system_clock_that_is_set_while_a_frame_waits_is_taken_for_its_waiting(
    monkeypatch: pytest.MonkeyPatch, step_s: float
) -> None:
    """A limit, as the page says it: late by the step, which ends driving, or not late at all."""
    now_s = 1_700_000_000.0
    monkeypatch.setattr(bus_module.time, "time", lambda: now_s)
    frame = message()
    with open_bus("virtual:clock") as reader:
        frame.timestamp = now_s - 0.02
        assert reader.waited_s(frame) == pytest.approx(0.02)
        now_s += step_s
        assert reader.waited_s(frame) == pytest.approx(max(step_s + 0.02, 0.0))
        # The next one came after it: both times are of the clock as it is now.
        frame.timestamp = now_s - 0.02
        assert reader.waited_s(frame) == pytest.approx(0.02)
