"""`can_bridge` as a process between a scripted device on the bus and ROS over DDS."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from hydro_hw_bridge.bus import Bus, open_bus
from hydro_hw_bridge.claims import GONE_S
from hydro_hw_bridge.codec import Codec, CommandFrame, Readings
from hydro_hw_bridge.parameters import PARAMETERS, parameter_table

pytestmark = pytest.mark.ros

DOMAIN = 10 + os.getpid() % 90
PERIOD_NS = 2_000_000
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 120.0
#: How long until what was published is published again: before the far end matched, it is lost.
AGAIN_S = 1.0
NAMES = ["lift_valve", "tilt_valve"]
Make = Callable[..., Readings]
_ports = itertools.count(20_000 + os.getpid() % 20_000)


def executable() -> str:
    from ament_index_python.packages import get_package_prefix

    return str(Path(get_package_prefix("hydro_hw_bridge")) / "lib/hydro_hw_bridge/can_bridge")


def start(can_name: str, *parameters: str, log: Any = subprocess.PIPE) -> subprocess.Popen[str]:
    environment = os.environ | {
        "ROS_DOMAIN_ID": str(DOMAIN),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    arguments = [word for p in (f"can:={can_name}", *parameters) for word in ("-p", p)]
    return subprocess.Popen(
        [executable(), "--ros-args", *arguments],
        env=environment,
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

    def send(self, counter: int, **changes: Any) -> None:
        self.counter = counter
        changes = {"lockstep": self.lockstep} | changes
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
        while (left := end - time.monotonic()) > 0:
            message = self.bus.receive(left)
            frame = None if message is None else self.codec.receive(message)
            if frame is not None and frame.role == "command":
                assert frame.intact
                return self.codec.decode_command(frame)
        return None

    def answer(self, wait_s: float = PATIENCE_S) -> CommandFrame:
        """The next valve frame."""
        found = self.next_command(wait_s)
        assert found is not None, f"no valve frame within {wait_s} s of cycle {self.counter}"
        return found


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

    def transition(self, number: int) -> None:
        from lifecycle_msgs.srv import ChangeState

        request = ChangeState.Request()
        request.transition.id = number
        assert self.call(self.change_state, request).success

    def clear(self) -> Any:
        from std_srvs.srv import Trigger

        return self.call(self.clear_trip, Trigger.Request())

    def ask(self, stamp_ns: int, *voltages: float) -> None:
        from hydro_msgs_docs.messages import joint_state

        self.command.publish(joint_state(stamp_ns, NAMES, effort=list(voltages)))

    def answer_to(self, device: Device, stamp_ns: int, *voltages: float) -> CommandFrame:
        """Ask until a valve frame comes: the first one. A repeated command changes nothing."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            self.ask(stamp_ns, *voltages)
            if (answer := device.next_command(AGAIN_S)) is not None:
                return answer
        raise AssertionError(f"no valve frame within {PATIENCE_S} s of a command")

    def diagnosis(self) -> dict[str, str]:
        self.until(lambda: self.heard["/diagnostics"])
        status = self.heard["/diagnostics"][-1].status[0]
        return {v.key: v.value for v in status.values} | {"message": status.message}

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.shutdown()


CONFIGURE, ACTIVATE, DEACTIVATE = 1, 3, 4


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


class Processes:
    """Started bridges and their log: a file, as an unread pipe blocks its writer."""

    def __init__(self, log: Path) -> None:
        self.log = log
        self.started: list[subprocess.Popen[str]] = []

    def start(self, can_name: str, *parameters: str) -> None:
        with self.log.open("a", encoding="utf-8") as log:
            self.started.append(start(can_name, *parameters, log=log))

    def __getitem__(self, index: int) -> subprocess.Popen[str]:
        return self.started[index]

    def close(self) -> None:
        for process in self.started:
            process.terminate()
        for process in self.started:
            process.communicate(timeout=PATIENCE_S)
        print(self.log.read_text(encoding="utf-8"))  # pytest shows it where the test failed


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    processes = Processes(tmp_path / "log.txt")
    yield processes
    processes.close()


def bring_up(ros: Ros, processes: Processes, can_name: str, *parameters: str) -> None:
    processes.start(can_name, *parameters)
    ros.transition(CONFIGURE)
    # What the bridge knows of this end is complete, as it answered a service made after all else.
    ros.until(lambda: all(ros.publishers.values()))
    ros.until(lambda: ros.command.get_subscription_count() == 1)
    assert ros.clear_trip.wait_for_service(PATIENCE_S)


def stamp_of(message: Any) -> int:
    from hydro_msgs_docs.messages import stamp_ns

    return stamp_ns(message)


def first_sample(ros: Ros, device: Device, counter: int) -> int:
    """Send a cycle until it is heard; its stamp."""
    states = ros.heard["/joint_states"]
    while not states:
        device.send(counter)
        for _ in range(10):
            ros.executor.spin_once(0.02)
    ros.until(lambda: ros.heard["/chamber_pressures"])
    return stamp_of(states[-1])


def send_and_hear(ros: Ros, device: Device, counter: int, stamp: int) -> None:
    """Send a cycle and wait for its sample: a command before it would be of no cycle."""
    heard = ros.heard["/chamber_pressures"]
    before = len(heard)
    device.send(counter)
    ros.until(lambda: stamp in map(stamp_of, heard[before:]))


def test_a_day_in_lockstep(
    ros: Ros, device: Device, processes: Processes, can_name: str, robot: Any
) -> None:
    required = "/joint_states:1 /chamber_pressures:1 /valve_state:1"
    bring_up(ros, processes, can_name, "clock:=lockstep", f"required_subscribers:='{required}'")
    device.lockstep = True
    # Inactive: reads, publishes, says nothing on the bus.
    stamp = first_sample(ros, device, 50)
    state, pressure = ros.heard["/joint_states"][-1], ros.heard["/chamber_pressures"][-1]
    assert stamp_of(pressure) == stamp
    assert list(state.name) == ["lift", "tilt"]
    assert list(state.position) == pytest.approx([0.3, -0.5], abs=3.1e-6)
    assert list(state.velocity) == [0.0, 0.0]
    assert list(pressure.name) == list(robot.pressure_names)
    gauge = [5.0e6, 2.0e6, 3.0e6, 4.0e6, 19.0e6, 1.0e6]
    assert list(pressure.effort) == [p + robot.atmospheric_pressure_pa for p in gauge]
    ros.until(lambda: ros.heard["/pressure/lift_cylinder/a"] and ros.heard["/oil_temperature"])
    reading = ros.heard["/pressure/lift_cylinder/a"][0]
    assert reading.fluid_pressure == 5.0e6 + robot.atmospheric_pressure_pa
    assert stamp_of(reading) == stamp
    assert ros.heard["/oil_temperature"][0].temperature == 40.0
    assert device.commands(0.2) == []
    # Active: the command answers its cycle, at the very same stamps when the cycle is repeated.
    ros.transition(ACTIVATE)
    send_and_hear(ros, device, 50, stamp)
    assert device.commands(0.2) == []
    answer = ros.answer_to(device, stamp, 1.5, -0.5)
    assert answer.answers(50)
    assert answer.enable
    assert answer.voltages == (1.5, -0.5)
    ros.until(lambda: ros.heard["/valve_state"])
    applied = ros.heard["/valve_state"][-1]
    assert stamp_of(applied) == stamp
    assert list(applied.effort) == [1.5, -0.5]
    assert list(applied.position) == pytest.approx([0.1, -0.2])
    assert {stamp_of(m) for m in ros.heard["/joint_states"]} == {stamp}
    device.send(50)
    assert device.answer().voltages == (1.5, -0.5)
    # The next cycle, a period later whatever the wall clock says.
    send_and_hear(ros, device, 51, stamp + PERIOD_NS)
    answer = ros.answer_to(device, stamp + PERIOD_NS, 9.0, -0.5)
    assert answer.answers(51)
    assert not answer.enable
    assert answer.voltages == (0.0, 0.0)
    ros.until(lambda: "step of 7.500 V" in ros.diagnosis()["message"])
    # Tripped: device time goes on, at 0 V, until cleared.
    for counter in range(52, 60):
        device.send(counter)
        answer = device.answer()
        assert answer.answers(counter)
        assert not answer.enable
    assert ros.clear().success
    send_and_hear(ros, device, 60, stamp + 10 * PERIOD_NS)
    assert device.commands(0.2) == []
    assert ros.answer_to(device, stamp + 10 * PERIOD_NS, 1.0, 0.0).enable
    # Deactivation is 0 V at once.
    ros.transition(DEACTIVATE)
    assert not device.answer().enable
    ros.until(lambda: ros.diagnosis()["message"] == "inactive: reading")
    diagnosis = ros.diagnosis()
    assert diagnosis["sample_zero_stamp_ns"] == str(stamp - 50 * PERIOD_NS)
    assert diagnosis["calibration"] == "none"
    assert diagnosis["mapping"] == "xs031"
    assert diagnosis["commands_accepted"] == "2"
    assert diagnosis["cycles_complete"] == "11"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=["term", "hup"])
def test_real_time_stale_commands_end_at_zero_and_signals_too(
    ros: Ros, device: Device, processes: Processes, can_name: str, number: signal.Signals
) -> None:
    bring_up(ros, processes, can_name)
    stamp = first_sample(ros, device, 0)
    ros.transition(ACTIVATE)
    device.send(1)
    assert not device.answer().enable
    assert ros.answer_to(device, stamp + PERIOD_NS, 1.0, 1.0).enable
    # Five cycles without a command are legal, the sixth is not.
    for counter in range(2, 7):
        device.send(counter)
    device.send(7)
    answer = device.answer()
    assert not answer.enable
    assert answer.voltages == (0.0, 0.0)
    # The device's own silence stops it as well, where the machine is too busy for this test.
    stops = ("no command for 12 ms", "nothing from the device for 50 ms")
    ros.until(lambda: ros.diagnosis()["trip_reason"].startswith(stops))
    # The emergency stop keeps it tripped, with the reason said.
    device.send(8, emergency_stop_ok=False)
    ros.until(lambda: stamp_of(ros.heard["/joint_states"][-1]) == stamp + 8 * PERIOD_NS)
    refused = ros.clear()
    assert not refused.success
    assert refused.message == "still there: emergency stop"
    device.send(9)
    ros.until(lambda: stamp_of(ros.heard["/joint_states"][-1]) == stamp + 9 * PERIOD_NS)
    assert ros.clear().success
    device.commands(0.1)
    assert ros.answer_to(device, stamp + 9 * PERIOD_NS, 1.0, 1.0).enable
    processes[0].send_signal(number)
    assert not device.answer().enable
    assert processes[0].wait(PATIENCE_S) == 0
    assert "Traceback" not in processes.log.read_text(encoding="utf-8")


def test_it_waits_for_the_subscribers_it_was_told_of(
    ros: Ros, device: Device, processes: Processes, can_name: str
) -> None:
    from sensor_msgs.msg import JointState

    from hydro_msgs_docs.topics import reliable

    required = "required_subscribers:='valve_state:2'"
    bring_up(ros, processes, can_name, "clock:=lockstep", required)
    device.lockstep = True
    stamp = first_sample(ros, device, 0)
    ros.transition(ACTIVATE)
    device.send(0)
    ros.ask(stamp, 1.0, 1.0)
    assert device.commands(0.5) == []
    ros.until(lambda: "/valve_state (1 of 2)" in ros.diagnosis()["message"])
    ros.node.create_subscription(JointState, "/valve_state", lambda _: None, reliable())
    ros.until(lambda: ros.node.count_subscribers("/valve_state") == 2)

    def answered() -> bool:
        device.send(0)
        ros.ask(stamp, 1.0, 1.0)
        return any(answer.enable for answer in device.commands(0.1))

    ros.until(answered)


def test_a_second_bridge_is_refused_and_the_first_goes_on(
    ros: Ros, device: Device, processes: Processes, can_name: str
) -> None:
    # In lockstep the device may be silent, so nothing but the other bridge can trip this one.
    bring_up(ros, processes, can_name, "clock:=lockstep")
    device.lockstep = True
    second = start(can_name, "robot:=xs031")
    out, error = second.communicate(timeout=PATIENCE_S)
    assert second.returncode == 2
    assert out == ""
    assert error.count("\n") == 1
    assert error.startswith("can_bridge: another bridge (instance ")
    assert processes[0].poll() is None
    # One that appears without asking first trips the bridge that drives.
    stamp = first_sample(ros, device, 0)
    ros.transition(ACTIVATE)
    send_and_hear(ros, device, 1, stamp + PERIOD_NS)
    assert ros.answer_to(device, stamp + PERIOD_NS, 0.5, 0.5).enable
    device.bus.send(device.codec.encode_claim(0x1234, 7))
    answer = device.answer()
    assert (answer.voltages, answer.enable) == ((0.0, 0.0), False)
    ros.until(lambda: "a second bridge is on the bus" in ros.diagnosis()["message"])
    heard_at = time.monotonic()
    device.bus.send(device.codec.encode_claim(0x1234, 8))
    assert "still there: a second bridge is on the bus" in ros.clear().message
    # Gone, once it was not heard for long enough.
    ros.until(lambda: ros.clear().success)
    assert time.monotonic() - heard_at > GONE_S


def test_bus_off_trips_and_comes_back_at_zero(
    ros: Ros, device: Device, processes: Processes, can_name: str, tmp_path: Path
) -> None:
    faults = tmp_path / "faults"
    simulated = f"{can_name.replace('udp_multicast', 'simulated_faults')}:{faults}"
    bring_up(ros, processes, simulated, "clock:=lockstep")
    assert "bus-off and error frames are SIMULATED" in processes.log.read_text(encoding="utf-8")
    device.lockstep = True
    stamp = first_sample(ros, device, 0)
    faults.write_text("error_frames 3")
    ros.until(lambda: ros.diagnosis()["bus_error_frames"] == "3")
    assert ros.diagnosis()["bus_last_error_frame"] == "protocol violation, bus error"
    ros.transition(ACTIVATE)
    assert ros.answer_to(device, stamp, 1.0, 1.0).enable
    faults.write_text("bus_off")
    ros.until(lambda: ros.diagnosis()["message"].startswith("tripped: bus-off"))
    assert ros.diagnosis()["bus_off"] == "yes"
    device.send(1)
    assert device.commands(0.3) == []
    assert ros.clear().message.startswith("still there: bus-off")
    # Back on the bus: 0 V until cleared.
    faults.write_text("ok")
    ros.until(lambda: ros.diagnosis()["bus_off"] == "no")
    assert ros.diagnosis()["bus_last_error_frame"] == "controller restarted"
    for counter in range(1, 8):
        device.send(counter)
        answer = device.answer()
        assert answer.answers(counter)
        assert (answer.voltages, answer.enable) == ((0.0, 0.0), False)
    assert ros.clear().success
    send_and_hear(ros, device, 8, stamp + 8 * PERIOD_NS)
    # After a cleared trip the first second is slow: 10 V/s.
    answer = ros.answer_to(device, stamp + 8 * PERIOD_NS, 1.0, 1.0)
    assert answer.voltages == (0.02, 0.02)
    assert "Traceback" not in processes.log.read_text(encoding="utf-8")


def test_silence_is_counted_from_sync_frames_not_from_any(
    ros: Ros, device: Device, processes: Processes, can_name: str
) -> None:
    bring_up(ros, processes, can_name)
    stamp = first_sample(ros, device, 0)
    ros.transition(ACTIVATE)
    device.send(1)
    assert not device.answer().enable
    assert ros.answer_to(device, stamp + PERIOD_NS, 1.0, 1.0).enable
    encoders = device.codec.encode_cycle(device.readings(1))[1]
    claim = device.codec.encode_claim(0, 0)
    claim.data[0] ^= 1
    end = time.monotonic() + 0.2
    while time.monotonic() < end:
        for message in (encoders, claim):
            device.bus.send(message)
        time.sleep(0.005)
    ros.until(lambda: "nothing from the device for 50 ms" in ros.diagnosis()["message"])


@pytest.mark.parametrize(
    ("parameter", "text"),
    [
        ("robot:=nowhere", "no robot file 'nowhere'"),
        ("mapping:=/nowhere.yaml", "no mapping file '/nowhere.yaml'"),
        ("dbc:=/nowhere.dbc", "no DBC file '/nowhere.dbc'"),
        ("calibration:=/nowhere.yaml", "no calibration file '/nowhere.yaml'"),
        ("can:=can77", "cannot open CAN bus socketcan:can77"),
        ("clock:=sundial", "should be one of real_time, lockstep, found 'sundial'"),
        ("max_age_ms:=0.0", "max_age_ms out of range"),
        ("slew_limit_v_s:=fast", "expecting type 'DOUBLE'"),
        ("required_subscribers:=all", "'required_subscribers' should be"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(can_name: str, parameter: str, text: str) -> None:
    process = start(can_name, parameter)
    out, error = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert out == ""
    assert error.startswith("can_bridge: ")
    assert text in error
    assert error.count("\n") == 1


def test_help_names_every_parameter() -> None:
    done = subprocess.run([executable(), "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    for rule in PARAMETERS:
        assert rule.name in done.stdout
        assert f"`{rule.name}`" in parameter_table()
    wrong = subprocess.run([executable(), "--wrong"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 2
