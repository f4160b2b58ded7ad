"""The controller as a process between scripted sensors and a listening bridge, over DDS."""

from __future__ import annotations

import gc
import importlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from hydro_model.hydraulics.cylinder import lever
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot_files import load_robot
from hydro_msgs_docs import topics
from hydro_msgs_docs.messages import joint_state, stamp_ns

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


def _run_module(module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"hydro_control.node.{module}", *arguments]
    return subprocess.run(
        command, env=ENVIRONMENT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


def _resting_pressures() -> list[float]:
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

    robot, pose = ROBOT, POSE

    def __init__(self) -> None:
        import rclpy
        from lifecycle_msgs.srv import ChangeState
        from rclpy.executors import SingleThreadedExecutor

        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node("machine", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._ended = False
        self._spinner = threading.Thread(target=self._spin)
        self._spinner.start()
        kinds = {"joints": topics.JOINT_STATES, "pressures": topics.CHAMBER_PRESSURES}
        self.publishers = {
            name: self.publisher(topic, topics.reliable()) for name, topic in kinds.items()
        }
        self.heard: dict[str, list[Any]] = {}
        for topic in (topics.VALVE_COMMAND, topics.JOINT_REFERENCE, topics.TIP_REFERENCE):
            self.listen(topic)
        self.listen(topics.DIAGNOSTICS)
        # Made before the controller: a server gives up on a client that it knows for too short.
        self._change_state = self.make(
            lambda: self.node.create_client(ChangeState, "/controller/change_state")
        )

    def _spin(self) -> None:
        while not self._ended:
            self._executor.spin_once(timeout_sec=0.02)

    def make(self, make: Callable[[], Any]) -> Any:
        """What a call creates, called where the node spins: rclpy's wait set takes no others."""
        made = self._executor.create_task(make)
        assert _wait_for(made.done)
        return made.result()

    def publisher(self, topic: str, quality: Any) -> Any:
        return self.make(lambda: self.node.create_publisher(_kind(topic), topic, quality))

    def listen(self, topic: str) -> None:
        heard = self.heard.setdefault(topic, [])
        kind, quality = _kind(topic), topics.reliable(1000)
        self.make(lambda: self.node.create_subscription(kind, topic, heard.append, quality))

    def transition(self, name: str) -> None:
        assert self.tried(name)

    def tried(self, name: str) -> bool:
        """Ask for a transition by its number; whether it was made."""
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState

        client = self._change_state
        number = getattr(Transition, f"TRANSITION_{name.upper()}")
        assert client.wait_for_service(PATIENCE_S)
        request = ChangeState.Request()
        request.transition.id = number
        future = client.call_async(request)
        assert _wait_for(future.done)
        return bool(future.result().success)

    def close(self) -> None:
        import rclpy

        self._ended = True
        self._spinner.join()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def publish(self, cycle: int, q: Any = POSE, *, pressures_first: bool = False) -> int:
        stamp = START_NS + cycle * PERIOD_NS
        sends = [
            ("joints", joint_state(stamp, ROBOT.joint_names, position=list(q))),
            ("pressures", joint_state(stamp, ROBOT.pressure_names, effort=_resting_pressures())),
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
        _wait_for(lambda: any(stamp_ns(c) >= stamp for c in self.commands()[before:]), wait_s)
        commands = self.commands()[before:]
        # Others can only be repeats that were late, of cycles that were sent more than once.
        assert all(stamp_ns(c) <= stamp for c in commands)
        return [c for c in commands if stamp_ns(c) == stamp]


def _kind(topic: str) -> Any:
    package, _, name = topics.MESSAGE_TYPES[topic].split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def _wait_for(true: Callable[[], bool], timeout_s: float = PATIENCE_S) -> bool:
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

    def start(
        *parameters: str,
        activate: bool = True,
        before: Sequence[str] = (),
        log: int = subprocess.PIPE,
    ) -> subprocess.Popen[str]:
        ros = [part for p in parameters for part in ("-p", p)]
        command = [*before, sys.executable, "-m", "hydro_control.node.node", "--ros-args", *ros]
        process = subprocess.Popen(
            command, env=ENVIRONMENT, stderr=log, stdout=subprocess.PIPE, text=True
        )
        started.append(process)
        for transition in ("configure", "activate") if activate else ():
            machine.transition(transition)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def wait_for() -> Callable[..., bool]:
    """`wait_for(true, timeout_s)`: until it is true; whether it was."""
    return _wait_for


@pytest.fixture
def patience_s() -> float:
    return PATIENCE_S


@pytest.fixture
def within(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """`within(*arguments)`: a controller that ends by itself, in this process."""
    from hydro_control.node.node import NAME, run
    from hydro_model.command_line.command import run_command

    monkeypatch.setattr(sys, "setswitchinterval", lambda interval: None)
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"):
        monkeypatch.setenv(name, ENVIRONMENT[name])

    def ended(*arguments: str) -> subprocess.CompletedProcess[str]:
        words = ["--ros-args", *arguments]
        code = run_command(NAME, run, words)
        gc.collect()  # a node that never came to be would still be found by the next test's
        return subprocess.CompletedProcess(words, code, *capfd.readouterr())

    return ended


@pytest.fixture
def run_module() -> Callable[..., subprocess.CompletedProcess[str]]:
    """`run_module(module, *arguments)`: a command of hydro_control that ends by itself."""
    return _run_module


@pytest.fixture
def node(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A controller in this process, in the module's own `DOMAIN`."""
    import rclpy

    from hydro_control.node.controller_node import ControllerNode

    monkeypatch.setitem(os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    gc.collect()  # the node of the test before is in its domain until then
    rclpy.init(domain_id=request.module.DOMAIN)
    node = ControllerNode()
    yield node
    node.close()
    rclpy.try_shutdown()
