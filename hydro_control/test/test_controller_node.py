"""The controller process between scripted sensors and a listening bridge, over DDS."""

from __future__ import annotations

import importlib
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_control.core import Answer, ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_model.cylinder import lever
from hydro_model.rigid_body import inverse_dynamics
from hydro_model.robot_files import load_robot
from hydro_msgs_docs import topics
from hydro_msgs_docs.messages import joint_state, stamp_ns

rclpy = pytest.importorskip("rclpy")
from hydro_control import hot_path  # noqa: E402
from hydro_control.hot_path import HotPath  # noqa: E402

DOMAIN = 10 + (os.getpid() + 50) % 90
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 120.0
ENVIRONMENT = {
    **os.environ,
    "ROS_DOMAIN_ID": str(DOMAIN),
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
}
ROBOT = load_robot("xs031")
POSE = np.array([0.6, -1.5])
PERIOD_NS = 2_000_000
START_NS = 1_000_000_000_000


def run_module(module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"hydro_control.{module}", *arguments]
    return subprocess.run(
        command, env=ENVIRONMENT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


def resting_pressures() -> list[float]:
    """Absolute pressures that hold the reference pose, then supply and tank."""
    torque = inverse_dynamics(ROBOT, POSE, 0 * POSE, 0 * POSE)
    values = []
    for i, cylinder in enumerate(ROBOT.cylinders):
        force = torque[i] / float(lever(cylinder, POSE[i]))
        p_b = 8e6
        values += [(force + p_b * cylinder.area_b_m2) / cylinder.area_a_m2, p_b]
    gauge = [*values, ROBOT.supply_pressure_pa, ROBOT.tank_pressure_pa]
    return [p + ROBOT.atmospheric_pressure_pa for p in gauge]


class Machine:
    """Sensors that are published by hand, and a bridge that listens."""

    def __init__(self) -> None:
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node("machine", context=self.context)
        kinds = {"joints": topics.JOINT_STATES, "pressures": topics.CHAMBER_PRESSURES}
        self.publishers = {
            name: self.node.create_publisher(_kind(topic), topic, topics.reliable())
            for name, topic in kinds.items()
        }
        self.heard: dict[str, list[Any]] = {}
        for topic in (topics.VALVE_COMMAND, topics.JOINT_REFERENCE, topics.TIP_REFERENCE):
            self.listen(topic)
        self.listen(topics.DIAGNOSTICS)
        executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        executor.add_node(self.node)
        self._spinner = threading.Thread(target=self._spin, args=(executor,))
        self._ended = False
        self._spinner.start()

    def _spin(self, executor: Any) -> None:
        while not self._ended:
            executor.spin_once(timeout_sec=0.02)

    def listen(self, topic: str) -> None:
        heard = self.heard.setdefault(topic, [])
        self.node.create_subscription(_kind(topic), topic, heard.append, topics.reliable(1000))

    def transition(self, name: str) -> None:
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState

        number = getattr(Transition, f"TRANSITION_{name.upper()}")
        client = self.node.create_client(ChangeState, "/controller/change_state")
        assert client.wait_for_service(PATIENCE_S)
        request = ChangeState.Request()
        request.transition.id = number
        future = client.call_async(request)
        assert wait_for(future.done)
        assert future.result().success

    def close(self) -> None:
        self._ended = True
        self._spinner.join()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def publish(self, cycle: int, q: Any = POSE, *, pressures_first: bool = False) -> int:
        stamp = START_NS + cycle * PERIOD_NS
        sends = [
            ("joints", joint_state(stamp, ROBOT.joint_names, position=list(q))),
            ("pressures", joint_state(stamp, ROBOT.pressure_names, effort=resting_pressures())),
        ]
        for name, message in reversed(sends) if pressures_first else sends:
            self.publishers[name].publish(message)
        return stamp

    def commands(self) -> list[Any]:
        return list(self.heard[topics.VALVE_COMMAND])

    def answer(self, cycle: int, q: Any = POSE, **options: bool) -> Any:
        """Publish a cycle and wait for its command, repeating it as a device would."""
        before, end = len(self.commands()), time.monotonic() + PATIENCE_S
        found: list[Any] = []
        while not found and time.monotonic() < end:
            stamp = self.publish(cycle, q, **options)
            found = self.commands_of(stamp, before, 0.2)
        assert found, f"no command for cycle {cycle}"
        return found[0]

    def commands_of(self, stamp: int, before: int, wait_s: float) -> list[Any]:
        """Commands of a stamp from a place in the list on, as soon as there is one."""
        wait_for(lambda: any(stamp_ns(c) >= stamp for c in self.commands()[before:]), wait_s)
        commands = self.commands()[before:]
        # Others can only be repeats that were late, of cycles that were sent more than once.
        assert all(stamp_ns(c) <= stamp for c in commands)
        return [c for c in commands if stamp_ns(c) == stamp]


def _kind(topic: str) -> Any:
    package, _, name = topics.MESSAGE_TYPES[topic].split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def wait_for(true: Callable[[], bool], timeout_s: float = PATIENCE_S) -> bool:
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.002)
    return true()


@pytest.fixture
def machine() -> Iterator[Machine]:
    machine = Machine()
    yield machine
    machine.close()


@pytest.fixture
def controller(machine: Machine) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts an active controller with parameters; kills what is left at the end."""
    started: list[subprocess.Popen[str]] = []

    def start(*parameters: str, activate: bool = True) -> subprocess.Popen[str]:
        ros = [part for p in parameters for part in ("-p", p)]
        command = [sys.executable, "-m", "hydro_control.node", "--ros-args", *ros]
        process = subprocess.Popen(
            command, env=ENVIRONMENT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        for transition in ("configure", "activate") if activate else ():
            machine.transition(transition)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.mark.ros
def test_one_command_per_stamp_and_repeats_are_identical(
    machine: Machine, controller: Callable[..., subprocess.Popen[str]]
) -> None:
    controller()
    commands = [machine.answer(k, pressures_first=bool(k % 2)) for k in range(40)]
    stamps = [stamp_ns(c) for c in commands]
    assert stamps == sorted(set(stamps))
    # At rest in balance the valves stay shut.
    assert max(abs(v) for c in commands for v in c.effort) < 0.02
    moved = machine.answer(40, POSE + np.array([0.0, 0.002]))
    again = machine.answer(40, POSE + np.array([0.0, 0.003]))
    assert again == moved
    assert list(moved.name) == list(ROBOT.valve_names)
    assert abs(moved.effort[1]) > 0.01
    wait_for(lambda: len(machine.heard[topics.TIP_REFERENCE]) > 41)
    reference = machine.heard[topics.JOINT_REFERENCE][-1]
    assert stamp_ns(reference) == stamp_ns(moved)
    np.testing.assert_allclose(reference.position, POSE, atol=1e-12)
    assert len(reference.effort) == 2
    assert machine.heard[topics.TIP_REFERENCE][-1].header.frame_id == "base_link"


@pytest.mark.ros
@pytest.mark.parametrize(
    "number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP], ids=["term", "int", "hup"]
)
def test_a_signal_ends_at_zero_volts(
    machine: Machine, controller: Callable[..., subprocess.Popen[str]], number: int
) -> None:
    process = controller()
    for k in range(5):
        machine.answer(k)
    assert any(machine.answer(k, POSE - 0.02).effort[0] for k in range(5, 8))
    # Configured anew, it answers as before.
    for transition in ("deactivate", "cleanup", "configure", "activate"):
        machine.transition(transition)
    assert wait_for(lambda: list(machine.commands()[-1].effort) == [0.0, 0.0])
    assert any(machine.answer(k, POSE + 0.02 * (k % 2)).effort[0] for k in range(8, 11))
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == 0
    assert wait_for(lambda: list(machine.commands()[-1].effort) == [0.0, 0.0])


@pytest.mark.ros
def test_it_ends_on_a_ramp_to_zero_while_samples_come(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Its last samples are waited for, however long a busy machine keeps this process from them.
    for name in ("_LAST_SAMPLE_S", "_RAMP_S"):
        monkeypatch.setattr(hot_path, name, PATIENCE_S)
    node = rclpy.create_node("hot", context=machine.context)
    core = ControllerCore(ROBOT, replace(Gains(), slew_limit_v_s=100.0))
    hot = HotPath(node, core, 0, lambda error: None)
    hot.start()
    cycle = 0
    while abs(machine.answer(cycle, POSE if cycle == 0 else POSE - 0.05).effort[0]) < 1.0:
        cycle += 1
    ending = threading.Thread(target=hot.stop)
    ending.start()
    while ending.is_alive():
        cycle += 1
        before, stamp = len(machine.commands()), machine.publish(cycle, POSE - 0.05)
        machine.commands_of(stamp, before, 0.2)
    hot.destroy()
    node.destroy_node()
    voltage = np.array([c.effort for c in machine.commands()])
    assert np.abs(np.diff(voltage, axis=0)).max() <= 0.2 + 1e-9
    assert voltage[-1].tolist() == [0.0, 0.0]


@pytest.mark.ros
def test_values_that_are_no_numbers_give_zero_volts(
    machine: Machine, controller: Callable[..., subprocess.Popen[str]]
) -> None:
    controller()
    machine.answer(0)
    machine.answer(1, POSE - 0.02)
    assert list(machine.answer(2, [np.nan, -1.5]).effort) == [0.0, 0.0]

    def said() -> list[str]:
        return [d.status[0].message for d in machine.heard[topics.DIAGNOSTICS]]

    assert wait_for(lambda: any("joint position [nan, -1.5]" in text for text in said()))


class FailingCore(ControllerCore):
    """A controller whose law breaks down at the tenth sample."""

    def answer(self, sample: Sample) -> Answer | None:
        if self.counts.answered == 9:
            raise ZeroDivisionError("a defect")
        return super().answer(sample)


@pytest.mark.ros
def test_an_exception_in_the_loop_ends_at_zero_volts_and_is_told(machine: Machine) -> None:
    node = rclpy.create_node("hot", context=machine.context)
    told: list[BaseException] = []
    hot = HotPath(node, FailingCore(ROBOT, Gains()), 0, told.append)
    hot.start()
    for k in range(9):
        last = machine.answer(k, POSE - 0.001 * k)
    assert any(last.effort)
    machine.publish(9)
    assert wait_for(lambda: bool(told))
    assert isinstance(told[0], ZeroDivisionError)
    assert wait_for(lambda: list(machine.commands()[-1].effort) == [0.0, 0.0])
    hot.stop()
    hot.destroy()
    node.destroy_node()


@pytest.mark.ros
def test_waits_for_the_recorders(
    machine: Machine, controller: Callable[..., subprocess.Popen[str]]
) -> None:
    controller("required_recorders:=1")
    for _ in range(5):
        machine.publish(0)
        time.sleep(0.05)
    assert machine.commands() == []
    heard = len(machine.heard[topics.JOINT_REFERENCE])
    for topic in (topics.VALVE_COMMAND, topics.JOINT_REFERENCE, topics.TIP_REFERENCE):
        machine.listen(topic)
    assert heard == 0
    machine.answer(0)


@pytest.mark.ros
def test_a_sent_path_is_played_and_a_far_one_refused(
    machine: Machine, controller: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    process = controller()
    for k in range(3):
        machine.answer(k)
    near, far = tmp_path / "near.yaml", tmp_path / "far.yaml"
    text = "joints: [tilt]\nstart: [{}]\nsegments: [{{kind: move, to: [{}], duration_s: 2.0}}]\n"
    near.write_text(text.format(-1.5, -1.4))
    far.write_text(text.format(-0.5, -0.6))
    assert run_module("send_path", str(far), "--timeout", "100").returncode == 0

    def refused() -> bool:
        messages = [d.status[0].message for d in machine.heard[topics.DIAGNOSTICS]]
        return any("starts 1.000 rad or m from where the robot stands" in m for m in messages)

    assert wait_for(refused)
    sent = run_module("send_path", str(near), "--timeout", "100")
    assert sent.returncode == 0, sent.stderr
    cycle, speed = 3, 0.0
    end = time.monotonic() + PATIENCE_S
    while speed < 0.05 and time.monotonic() < end:
        machine.answer(cycle)
        cycle += 1
        if machine.heard[topics.JOINT_REFERENCE]:
            speed = machine.heard[topics.JOINT_REFERENCE][-1].velocity[1]
    assert speed >= 0.05
    assert process.poll() is None


@pytest.mark.ros
@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["-p", "robot:=nowhere.yaml"], "no robot file 'nowhere.yaml'"),
        (["-p", "path:=nowhere.yaml"], "no path file 'nowhere.yaml'"),
        (["-p", "k_v:=-1.0"], "k_v should be a number with a decimal point from 0"),
        (["-p", "robot:=3"], "robot should be a text"),
        (["--params-file", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(arguments: list[str], expected: str) -> None:
    done = run_module("node", "--ros-args", *arguments)
    assert done.returncode == 2
    assert expected in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.ros
def test_lifecycle_command_says_what_is_open(
    controller: Callable[..., subprocess.Popen[str]],
) -> None:
    controller(activate=False)
    patient = ("--timeout", str(PATIENCE_S))
    refused = run_module("lifecycle_command", "activate", "controller", *patient)
    assert refused.returncode == 1
    assert "controller is unconfigured and cannot activate" in refused.stderr
    assert (
        run_module("lifecycle_command", "get", "controller", *patient).stdout == "unconfigured\n"
    )
    assert run_module("lifecycle_command", "configure", "controller", *patient).returncode == 0
    absent = run_module("lifecycle_command", "get", "nobody", "--timeout", "0.2")
    assert absent.returncode == 1
    assert "no node answers at /nobody/get_state" in absent.stderr
    assert run_module("lifecycle_command", "fly", "controller").returncode == 2


@pytest.mark.ros
def test_adaptation_is_told_and_reset(
    machine: Machine, controller: Callable[..., subprocess.Popen[str]]
) -> None:
    from std_srvs.srv import Trigger

    controller("adaptation:=payload null_bias")
    for k in range(20):
        machine.answer(k)

    def told() -> dict[str, str]:
        statuses = [s for m in machine.heard[topics.DIAGNOSTICS] for s in m.status]
        return {v.key: v.value for s in statuses[-1:] for v in s.values}

    assert wait_for(lambda: told().get("adaptation") == "payload null_bias")
    assert told()["adaptation_frozen"] == "yes"
    assert float(told()["adapted/payload_kg"]) == 0.0
    client = machine.node.create_client(Trigger, "/controller/reset_adaptation")
    assert client.wait_for_service(PATIENCE_S)
    future = client.call_async(Trigger.Request())
    assert wait_for(future.done)
    assert future.result().success


@pytest.mark.ros
def test_adaptation_of_an_unknown_kind_ends_the_node_with_one_line() -> None:
    done = run_module("node", "--ros-args", "-p", "adaptation:=mass")
    assert done.returncode == 2
    assert "expected some of payload, friction, null_bias" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.ros
def test_commands_that_the_valves_do_not_get_are_noticed(
    machine: Machine, controller: Callable[..., subprocess.Popen[str]]
) -> None:
    valves = machine.node.create_publisher(
        _kind(topics.VALVE_STATE), topics.VALVE_STATE, topics.reliable(1000)
    )
    controller()
    assert wait_for(lambda: valves.get_subscription_count() == 1)
    time.sleep(0.2)

    def said() -> str:
        return str(machine.heard[topics.DIAGNOSTICS][-1].status[0].message)

    def drive(cycles: range, share: float) -> Any:
        for k in cycles:
            # Not at the pose of the first sample, so something is commanded.
            command = machine.answer(k, POSE - 0.02 * (k > 0))
            applied = [share * v for v in command.effort]
            valves.publish(joint_state(stamp_ns(command), command.name, effort=applied))
        return machine.heard[topics.JOINT_REFERENCE][-1]

    drive(range(20), 1.0)
    reference = drive(range(20, 60), 0.0)
    np.testing.assert_allclose(reference.position, POSE - 0.02, atol=1e-12)
    assert wait_for(lambda: "the valves do not get the commands" in said())
    # Anchored where it is there is little to command: enough to see that it is applied.
    for k in range(60, 120):
        drive(range(k, k + 1), 1.0)
    machine.answer(120, POSE - 0.03)
    valves.publish(
        joint_state(stamp_ns(machine.commands()[-1]), ROBOT.valve_names, effort=[0.1, 0.1])
    )
    cycles = itertools.count(121)

    def holding() -> bool:
        machine.answer(next(cycles), POSE - 0.03)
        return wait_for(lambda: said() == "holding", 0.1)

    assert wait_for(holding)
