"""`can_bridge` as a process between a scripted device on the bus and ROS over DDS."""

from __future__ import annotations

import gc
import itertools
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.protocol.frames import CommandFrame, Echo, Readings

DOMAIN = 10 + os.getpid() % 90
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 120.0
#: How long until what was published is published again: before the far end matched, it is lost.
AGAIN_S = 1.0
#: How long a node that has ended may still be in the graph, where it refuses its namesakes.
GONE_S = 30.0
NAMES = ["lift_valve", "tilt_valve"]
PERIOD_NS = 2_000_000
CONFIGURE = 1
Make = Callable[..., Readings]
#: Each family of tests has ports of its own, below those of DDS and of the system: workers have
#: numbers of processes that follow each other.
_ports = itertools.count(2_000 + os.getpid() % 5_000)


def _executable() -> str:
    from ament_index_python.packages import get_package_prefix

    return str(Path(get_package_prefix("hydro_hw_bridge")) / "lib/hydro_hw_bridge/can_bridge")


_MAIN = "sys.exit(bridge_node.main())"
#: A bridge alone on its bus: there is no other one to listen for.
_ALONE = f"""
import sys
from hydro_hw_bridge.bus import claims
from hydro_hw_bridge.node import bridge, bridge_node
claims.LISTEN_S, claims.CONTEST_S = 0.1, 0.05
{_MAIN}
"""
#: And its main thread waits inside ROS as good as for ever.
_ASLEEP = _ALONE.replace(_MAIN, f"bridge.CLAIM_PERIOD_S = bridge_node.SPIN_S = 1e4\n{_MAIN}")


def _environment() -> dict[str, str]:
    return {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def _words(can_name: str, *parameters: str) -> list[str]:
    words = [word for p in (f"can:={can_name}", *parameters) for word in ("-p", p)]
    return ["--ros-args", *words]


def _start(
    can_name: str,
    *parameters: str,
    log: Any = subprocess.PIPE,
    code: str | None = None,
    before: Sequence[str] = (),
) -> subprocess.Popen[str]:
    """The bridge as it is installed, or what `code` makes of it."""
    program = [_executable()] if code is None else [sys.executable, "-c", code]
    return subprocess.Popen(
        [*before, *program, *_words(can_name, *parameters)],
        env=os.environ | _environment(),
        stdout=subprocess.PIPE,
        stderr=log,
        text=True,
    )


class Device:
    """The machine's end of the bus, cycle by cycle."""

    def __init__(self, bus: Bus, codec: Codec, readings: Make) -> None:
        self.bus, self.codec, self.readings = bus, codec, readings
        self.counter = 0
        self.lockstep = False
        self.taken = 0
        self._came: deque[CommandFrame] = deque()

    def send(self, counter: int, **changes: Any) -> None:
        self.counter = counter
        while self._take(0.0):
            pass  # as amplifiers do: whatever came is theirs as the cycle begins
        changes = {"lockstep": self.lockstep, "echo": Echo(self.taken % 256, 0)} | changes
        for message in self.codec.encode_cycle(self.readings(counter, **changes)):
            self.bus.send(message)

    def commands(self, wait_s: float) -> list[CommandFrame]:
        """Valve frames that come in within a while."""
        found, end = [], time.monotonic() + wait_s
        while (command := self.next_command(end - time.monotonic())) is not None:
            found.append(command)
        return found

    def next_command(self, wait_s: float) -> CommandFrame | None:
        """The next valve frame, if there is one within a while."""
        end = time.monotonic() + wait_s
        while not self._came and (left := end - time.monotonic()) > 0:
            self._take(left)
        return self._came.popleft() if self._came else None

    def _take(self, wait_s: float) -> bool:
        """Whether a frame came, which is kept where it is a valve frame."""
        message = self.bus.receive(wait_s)
        frame = None if message is None else self.codec.receive(message)
        if frame is not None and frame.role == "command":
            assert frame.intact
            self._came.append(self.codec.decode_command(frame))
            self.taken += 1
        return message is not None

    def answer(self, wait_s: float = PATIENCE_S) -> CommandFrame:
        """The next valve frame."""
        found = self.next_command(wait_s)
        assert found is not None, f"no valve frame within {wait_s} s of cycle {self.counter}"
        return found


class Processes:
    """Started bridges and their log: a file, as an unread pipe blocks its writer."""

    def __init__(self, log: Path) -> None:
        self.log = log
        self.started: list[subprocess.Popen[str]] = []

    def start(
        self,
        can_name: str,
        *parameters: str,
        asleep: bool = False,
        installed: bool = False,
        log: int | None = None,
        **how: Any,
    ) -> None:
        """A bridge alone on its bus, or the installed one, which listens for others first.

        Its log goes to the file, or to the descriptor `log`.
        """
        code = _ASLEEP if asleep else None if installed else _ALONE
        with self.log.open("a", encoding="utf-8") as file:
            to = file if log is None else log
            self.started.append(_start(can_name, *parameters, log=to, code=code, **how))

    def until_said(self, text: str) -> str:
        """The log, once it has a text: a line comes a moment after what it is about."""
        end = time.monotonic() + PATIENCE_S
        while text not in (log := self.log.read_text(encoding="utf-8")):
            assert time.monotonic() < end, log
            time.sleep(0.02)
        return log

    def wait(self, index: int) -> int:
        """Until a bridge has ended; its exit code."""
        return self.started[index].wait(PATIENCE_S)

    def __getitem__(self, index: int) -> subprocess.Popen[str]:
        return self.started[index]

    def close(self) -> None:
        for process in self.started:
            process.terminate()
        for process in self.started:
            process.communicate(timeout=PATIENCE_S)
        print(self.log.read_text(encoding="utf-8"))  # pytest shows it where the test failed


class Ros:
    """The ROS end: what the bridge published, and the services it offers."""

    def __init__(self) -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from lifecycle_msgs.srv import ChangeState
        from rclpy.event_handler import SubscriptionEventCallbacks
        from rclpy.executors import SingleThreadedExecutor
        from sensor_msgs.msg import FluidPressure, JointState, Temperature
        from std_srvs.srv import Trigger

        from hydro_msgs_docs.topics import reliable

        self.context = rclpy.Context()
        self.context.init(domain_id=DOMAIN)
        self.node = rclpy.create_node("bridge_test", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard: dict[str, list[Any]] = {}
        self.publishers: dict[str, int] = {}
        for topic, kind in {
            "/joint_states": JointState,
            "/chamber_pressures": JointState,
            "/valve_state": JointState,
            "/pressure/lift_cylinder/a": FluidPressure,
            "/oil_temperature": Temperature,
            "/diagnostics": DiagnosticArray,
        }.items():
            into = self.heard.setdefault(topic, [])
            events = SubscriptionEventCallbacks(matched=self._on_match(topic))
            self.node.create_subscription(
                kind, topic, into.append, reliable(100), event_callbacks=events
            )
        self.command = self.node.create_publisher(JointState, "/valve_command", reliable())
        self.change_state = self.node.create_client(ChangeState, "/can_bridge/change_state")
        self.clear_trip = self.node.create_client(Trigger, "/can_bridge/clear_trip")

    def _on_match(self, topic: str) -> Callable[[Any], None]:
        self.publishers[topic] = 0

        def matched(event: Any) -> None:
            self.publishers[topic] = event.current_count

        return matched

    def until(self, condition: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, f"nothing within {PATIENCE_S} s; heard {self.counts()}"
            self.executor.spin_once(0.02)

    def counts(self) -> dict[str, int]:
        return {topic: len(messages) for topic, messages in self.heard.items()}

    def call(self, client: Any, request: Any) -> Any:
        assert client.wait_for_service(PATIENCE_S)
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def tried(self, number: int) -> bool:
        """Ask for a transition; whether it was made."""
        from lifecycle_msgs.srv import ChangeState

        request = ChangeState.Request()
        request.transition.id = number
        return bool(self.call(self.change_state, request).success)

    def transition(self, number: int) -> None:
        """Make a transition that is open; nodes of the test before are known a while longer."""
        end = time.monotonic() + GONE_S
        while not self.tried(number):
            assert time.monotonic() < end, f"transition {number} was refused for {GONE_S} s"
            self.executor.spin_once(AGAIN_S)

    def clear(self) -> Any:
        from std_srvs.srv import Trigger

        return self.call(self.clear_trip, Trigger.Request())

    def ask(self, stamp_ns: int, *voltages: float) -> None:
        from hydro_msgs_docs.messages import joint_state

        self.command.publish(joint_state(stamp_ns, NAMES, effort=list(voltages)))

    def answer_to(self, device: Device, stamp_ns: int, *voltages: float) -> CommandFrame:
        """Ask until a valve frame comes: the first one. A repeated command changes nothing.

        In real time a device that began no cycle for 10 ms has to before it is driven: what is
        answered is the cycle that it has come to, from the one of the stamp on.
        """
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            if not device.lockstep:
                device.send(device.counter + 1)
                stamp_ns += PERIOD_NS
                device.next_command(AGAIN_S)
            self.ask(stamp_ns, *voltages)
            if (answer := device.next_command(AGAIN_S)) is not None:
                return answer
        raise AssertionError(f"no valve frame within {PATIENCE_S} s of a command")

    def diagnosis(self) -> dict[str, str]:
        self.until(lambda: self.heard["/diagnostics"])
        status = self.heard["/diagnostics"][-1].status[0]
        return {v.key: v.value for v in status.values} | {"message": status.message}

    @staticmethod
    def stamp_of(message: Any) -> int:
        from hydro_msgs_docs.messages import stamp_ns

        return stamp_ns(message)

    def bring_up(self, processes: Processes, can_name: str, *parameters: str, **how: Any) -> None:
        """Start a bridge, configure it and wait until both ends know each other."""
        processes.start(can_name, *parameters, **how)
        self.transition(CONFIGURE)
        # The bridge knows all of this end: it answered a service that was made last.
        self.until(lambda: all(self.publishers.values()))
        self.until(lambda: self.command.get_subscription_count() == 1)
        assert self.clear_trip.wait_for_service(PATIENCE_S)

    def first_sample(self, device: Device, counter: int) -> int:
        """Send a cycle until it is heard; its stamp."""
        states = self.heard["/joint_states"]
        while not states:
            device.send(counter)
            for _ in range(10):
                self.executor.spin_once(0.02)
        self.until(lambda: self.heard["/chamber_pressures"])
        return self.stamp_of(states[-1])

    def send_and_hear(self, device: Device, counter: int, stamp: int, **changes: Any) -> None:
        """Send a cycle and wait for its sample: a command before it would be of no cycle."""
        heard = self.heard["/chamber_pressures"]
        before = len(heard)
        device.send(counter, **changes)
        self.until(lambda: stamp in map(self.stamp_of, heard[before:]))

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.shutdown()


@pytest.fixture
def can_name() -> str:
    return f"udp_multicast:239.74.163.2:{next(_ports)}"


@pytest.fixture
def device(can_name: str, codec: Codec, readings: Make) -> Iterator[Device]:
    with open_bus(can_name, codec.bridge_ids) as bus:
        yield Device(bus, codec, readings)


@pytest.fixture
def ros() -> Iterator[Ros]:
    ros = Ros()
    yield ros
    ros.close()


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    processes = Processes(tmp_path / "log.txt")
    yield processes
    processes.close()


@pytest.fixture
def run_bridge() -> Callable[..., subprocess.CompletedProcess[str]]:
    """`run_bridge(can_name, *parameters)`: a bridge that ends by itself."""

    def run(can_name: str, *parameters: str) -> subprocess.CompletedProcess[str]:
        process = _start(can_name, *parameters)
        out, error = process.communicate(timeout=PATIENCE_S)
        return subprocess.CompletedProcess(process.args, process.returncode, out, error)

    return run


@pytest.fixture
def within(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """`within(can_name, *parameters)`: a bridge that ends by itself, in this process."""
    from hydro_hw_bridge.node import bridge_node

    monkeypatch.setattr(bridge_node, "on_end", lambda end: None)
    for name, value in _environment().items():
        monkeypatch.setenv(name, value)

    def run(can_name: str, *parameters: str) -> subprocess.CompletedProcess[str]:
        words = _words(can_name, *parameters)
        code = bridge_node.main(words)
        gc.collect()  # a node that never came to be would still be found by the next test's
        return subprocess.CompletedProcess(words, code, *capfd.readouterr())

    return run


@pytest.fixture
def executable() -> str:
    return _executable()
