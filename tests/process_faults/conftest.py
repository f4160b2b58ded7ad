"""A machine and its processes, which get signals: what stands at the rig's valves then.

The rig is in this process and counts its cycles itself, answered or not, however busy the computer
is; bridge and controllers are processes, and so is the rig where it is the one that gets them.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.faults.injection import AGE, WATCHDOG
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.device import Device
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_ident.study.faults.stage import executable
from hydro_model.robot_files import load_robot
from hydro_msgs_docs import topics
from hydro_msgs_docs.messages import stamp_ns

DOMAIN = 10 + (os.getpid() + 65) % 90
CAN = f"udp_multicast:239.74.163.2:{2_000 + (os.getpid() + 4_500) % 5_000}"
#: How long to wait for what must come, however busy the computer is.
PATIENCE_S = 120.0
#: How long a cycle is held open for an answer before it is told again, and for one that is not to
#: come.
REPEAT_S, NO_ANSWER_S = 1.0, 0.02
CONFIGURE, ACTIVATE = 1, 3
PERIOD_NS = 2_000_000
ROBOT = load_robot("xs031")
NAMED = ("--ros-args", "-r")
#: A cycle's step at the slew limit, and half a count of the wire.
SLEW_V = 2.001
STOPPED = (False, (0.0, 0.0))
#: V, from which on a valve counts as driven, and cycles within which a motion drives one.
DRIVEN_V, BEGIN_CYCLES = 0.4, 1000
#: A request is made again: before whoever shall play it is met, it is lost.
AGAIN_CYCLES = 100
#: The second after a trip was cleared.
SLOW_CYCLES = 500
GOLDEN = Path(__file__).parents[1] / "golden"
PATH = "joints: [tilt]\nstart: [{}]\nsegments: [{{kind: move, to: [{}], duration_s: 3.0}}]\n"


class Ros:
    """The ROS end: transitions, a motion to ask for, and what is said and commanded."""

    def __init__(self) -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from lifecycle_msgs.srv import ChangeState
        from rclpy.executors import SingleThreadedExecutor
        from sensor_msgs.msg import JointState
        from std_srvs.srv import Trigger
        from trajectory_msgs.msg import JointTrajectory

        self._context = rclpy.Context()
        self._context.init()
        self.node = node = rclpy.create_node("process_faults", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        self.commands: list[int] = []
        self.asked: list[Any] = []
        self.said: dict[str, dict[str, str]] = {}
        self.bridge_ns = 0
        make, deep = node.create_subscription, topics.reliable(1000)
        make(JointState, topics.VALVE_COMMAND, lambda m: self.commands.append(stamp_ns(m)), deep)
        make(JointTrajectory, topics.JOINT_TRAJECTORY, self.asked.append, deep)
        make(DiagnosticArray, topics.DIAGNOSTICS, self._on_diagnostics, deep)
        self.motion = node.create_publisher(
            JointTrajectory, topics.JOINT_TRAJECTORY, topics.reliable()
        )
        self._change = {
            name: node.create_client(ChangeState, f"/{name}/change_state")
            for name in ("can_bridge", "controller", "controller_2")
        }
        self._clear = node.create_client(Trigger, "/can_bridge/clear_trip")

    def _on_diagnostics(self, message: Any) -> None:
        for one in message.status:
            self.said[one.name] = {v.key: v.value for v in one.values} | {"message": one.message}
            if one.name == "can_bridge":
                self.bridge_ns = stamp_ns(message)

    def until(self, condition: Callable[[], object]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, f"nothing within {PATIENCE_S} s; said: {self.said}"
            self._executor.spin_once(0.02)

    def spin(self) -> None:
        """Take what has come."""
        self._executor.spin_once(0.0)

    def _call(self, client: Any, request: Any) -> Any:
        assert client.wait_for_service(PATIENCE_S), client.srv_name
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def transition(self, name: str, number: int) -> None:
        from lifecycle_msgs.srv import ChangeState

        request = ChangeState.Request()
        request.transition.id = number
        assert self._call(self._change[name], request).success, name

    def clear(self) -> None:
        from std_srvs.srv import Trigger

        found = self._call(self._clear, Trigger.Request())
        assert found.message.startswith("cleared: "), found.message
        self.until(lambda: self.said["can_bridge"]["gate"] != "tripped")

    def bridge(self) -> dict[str, str]:
        """What the bridge says from now on, not what waits here to be read."""
        now_ns = self.node.get_clock().now().nanoseconds
        self.said.pop("can_bridge", None)
        self.until(lambda: "can_bridge" in self.said and self.bridge_ns > now_ns)
        return self.said["can_bridge"]

    def until_tripped(self) -> str:
        """Wait for it; its reason."""
        self.until(lambda: self.said["can_bridge"]["gate"] == "tripped")
        return self.said["can_bridge"]["trip_reason"]

    @property
    def zero_ns(self) -> int:
        """Stamp of cycle 0 of the machine at hand, as the bridge said last."""
        return int(self.said["can_bridge"]["sample_zero_stamp_ns"])

    def until_commanded(self, since_ns: int, cycles: int) -> int:
        """Wait for a command of so many cycles after a stamp; its own stamp."""
        self.until(lambda: self.commands[-1] >= since_ns + cycles * PERIOD_NS)
        return self.commands[-1]

    def until_caught_up(self, counter: int) -> None:
        """Wait for the command of a cycle: a tripped gate lets the machine run ahead of them."""
        self.until_commanded(self.zero_ns, counter)

    def ask(self, to: float) -> None:
        """A motion of the tilt joint of whoever listens."""
        from builtin_interfaces.msg import Duration
        from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

        point = JointTrajectoryPoint(positions=[to], time_from_start=Duration(sec=2))
        self.motion.publish(JointTrajectory(joint_names=["tilt"], points=[point]))

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.shutdown()


@dataclass
class Chain:
    """The machine and its processes."""

    codec: Codec
    ros: Ros
    folder: Path
    bus: Bus = field(init=False)
    processes: dict[str, subprocess.Popen[str]] = field(default_factory=dict)
    rows: list[tuple[bool, tuple[float, ...]]] = field(default_factory=list)
    idle: list[str] = field(default_factory=lambda: ["controller", "controller_2"])
    active: str = ""

    def __post_init__(self) -> None:
        self._switch_on()

    def new_machine(self) -> None:
        """One that was just switched on: it counts anew, and has heard nothing."""
        self.bus.close()
        self._switch_on()

    def _switch_on(self) -> None:
        self.bus = open_bus(CAN, self.codec.bridge_ids)
        core = RigCore(ROBOT, load_truth("realistic", ROBOT), seed=1)
        self.device = Device(core, self.codec, self.bus, lockstep=True)

    # -- processes

    def start(self, name: str, package: str, program: str, *words: str, nice: int = 0) -> None:
        """Start a program of a package under a name of its own."""
        command = ["nice", "-n", str(nice), executable(package, program), *words]
        with (self.folder / f"{name}.log").open("w", encoding="utf-8") as log:
            self.processes[name] = subprocess.Popen(command, stdout=log, stderr=log, text=True)

    def ended_while_it_stands(self, name: str) -> int:
        """Tell a stopped process to end, and let it go on; its exit code."""
        for number in (signal.SIGTERM, signal.SIGCONT):
            self.processes[name].send_signal(number)
        return self.processes[name].wait(PATIENCE_S)

    def start_rig(self, name: str) -> Path:
        """A machine as a process, in the place of the one at hand; its record of the valves."""
        file = self.folder / f"{name}.npz"
        words = ("--can", CAN, "--lockstep", "--truth-out", str(file))
        self.start(name, "hydro_hw_bridge", "sim_rig", *words)
        return file

    def controller(self) -> str:
        """The controller that is active; where there is none, the next one is."""
        if not self.active:
            self.active = self.idle.pop(0)
            for number in (CONFIGURE, ACTIVATE):
                self.ros.transition(self.active, number)
        return self.active

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(encoding="utf-8")

    def signal(self, name: str, number: signal.Signals) -> int | None:
        """Send a signal and wait until it has done what it does; the exit code of who ends."""
        process = self.processes[name]
        assert process.poll() is None, self.log(name)
        process.send_signal(number)
        if number is signal.SIGSTOP:
            assert os.WIFSTOPPED(os.waitpid(process.pid, os.WUNTRACED)[1])
        if number in (signal.SIGSTOP, signal.SIGCONT):
            return None
        self.active = self.active if name != self.active else ""
        return process.wait(PATIENCE_S)

    def close(self) -> None:
        self.bus.close()
        for process in self.processes.values():
            process.kill()
            process.wait()
        for name in self.processes:
            print(f"-- {name}\n{self.log(name)}")  # pytest shows it where the test failed

    # -- cycles

    def _answer(self, wait_s: float) -> Any:
        """Tell the cycle at hand; the frame that answers it, if one comes."""
        for message in self.device.frames():
            self.bus.send(message)
        end = time.monotonic() + wait_s
        while (left := end - time.monotonic()) > 0.0:
            message = self.bus.receive(left)
            heard = None if message is None else self.device.decoded(message)
            if heard is not None and self.device.takes(heard):
                return heard
        return None

    def _advance(self, voltages: Any, *, enable: bool) -> None:
        core = self.device.core
        core.actuate(voltages, enable)
        self.rows.append((core.amplifier.enabled, tuple(map(float, core.amplifier.output_v))))

    def answered(self, cycles: int = 1) -> None:
        """Cycles that are told until they are answered."""
        end = time.monotonic() + PATIENCE_S
        for _ in range(cycles):
            while (command := self._answer(REPEAT_S)) is None:
                assert time.monotonic() < end, f"no answer to cycle {self.device.core.counter}"
            self._advance(command.voltages, enable=command.enable)

    def unanswered(self, cycles: int) -> None:
        """Cycles that nobody answers: the machine goes on all the same."""
        for _ in range(cycles):
            assert self._answer(NO_ANSWER_S) is None
            self._advance(None, enable=True)

    def driven(self, least_v: float = DRIVEN_V) -> bool:
        """By a motion: the noise of a hold is less."""
        last = self.rows[-5:]
        return bool(last) and all(on and max(map(abs, v)) > least_v for on, v in last)

    def drive(self) -> None:
        """Ask for a motion of the tilt joint, until it drives a valve well: later it may less."""
        self.controller()
        tilt = float(self.device.core.plant.q[1])
        begin = len(self.rows)
        while not self.driven(1.5 * DRIVEN_V):
            if (len(self.rows) - begin) % AGAIN_CYCLES == 0:
                self.ros.ask(tilt + (0.3 if tilt < -1.275 else -0.3))
            self.answered()
            assert len(self.rows) - begin < BEGIN_CYCLES, "nothing driven"

    def clear_and_drive(self) -> None:
        """Driven again, as slowly as promised."""
        self.ros.until_caught_up(self.device.core.counter - 1)
        self.ros.clear()
        begin = len(self.rows) - 1
        self.drive()
        volts = np.array([row[1] for row in self.rows[begin:][:SLOW_CYCLES]])
        assert np.abs(np.diff(volts, axis=0)).max() < 0.021  # 10 V/s

    def stays_stopped(self, cycles: int = 2 * AGE) -> None:
        """A gate that has tripped answers with 0 V and enable off."""
        for _ in range(cycles):
            self.answered()
            assert self.rows[-1] == STOPPED

    def commanded_and_stopped(self) -> None:
        """Commands come for the cycles from now on, and none reaches the valves."""
        now_ns = self.ros.zero_ns + self.device.core.counter * PERIOD_NS
        end = time.monotonic() + PATIENCE_S
        while sum(stamp >= now_ns for stamp in self.ros.commands) < 2 * AGE:
            assert time.monotonic() < end, self.log(self.active)
            self.stays_stopped(1)
            self.ros.spin()

    def played(self) -> None:
        """Cycles, answered or not, until somebody has commanded what was recorded."""
        old_ns = self.ros.zero_ns
        known = sum(stamp < old_ns for stamp in self.ros.commands)
        end = time.monotonic() + PATIENCE_S
        while sum(stamp < old_ns for stamp in self.ros.commands) < known + WATCHDOG:
            assert time.monotonic() < end, self.log("player")
            self.answered_or_not(advance=True)
            self.ros.spin()

    def told_to_end(self) -> None:
        """The controller ramps to 0 V on the samples that come; then the machine is on its own."""
        process, begin = self.processes[self.active], len(self.rows) - 1
        process.send_signal(signal.SIGTERM)
        while process.poll() is None:
            self.answered_or_not(advance=False)
        assert process.returncode == 0, self.log(self.active)
        self.active = ""
        volts = np.array([row[1] for row in self.rows[begin:]])
        assert np.abs(np.diff(volts, axis=0)).max(initial=0.0) <= SLEW_V
        # Its last command may still be on its way.
        self.ros.until(lambda: self.ros.bridge()["gate"] == "waiting")
        begin = len(self.rows)
        while self.rows[-1] != STOPPED:
            self.answered_or_not(advance=True)
            assert len(self.rows) - begin <= WATCHDOG + 1  # so may be an answer to it

    def answered_or_not(self, *, advance: bool) -> None:
        """A cycle; without an answer time goes on only where it shall."""
        command = self._answer(NO_ANSWER_S)
        if command is not None:
            self._advance(command.voltages, enable=command.enable)
        elif advance:
            self._advance(None, enable=True)

    def stopped_by_the_gate(self) -> None:
        """Without commands: driven until the last one is too old, then 0 V and enable off."""
        assert self.driven()
        self.unanswered(AGE - 1)
        assert self.driven()
        self.stays_stopped(1)
        assert self.ros.until_tripped() == "no command for 12 ms (limit 10 ms)"


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chain]:
    folder = tmp_path_factory.mktemp("chain")
    codec = Codec.load(None, None, ROBOT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(DOMAIN))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        ros = Ros()
        found = Chain(codec, ros, folder)
        try:
            _start_all(found)
            for number in (CONFIGURE, ACTIVATE):
                ros.transition("can_bridge", number)
            yield found
        finally:
            found.close()
            ros.close()


def _start_all(chain: Chain) -> None:
    """What takes a while to start, all at once; of those that get two signals there are two."""
    clock = ("-p", f"can:={CAN}", "-p", "clock:=lockstep")
    chain.start("can_bridge", "hydro_hw_bridge", "can_bridge", "--ros-args", *clock)
    path = chain.folder / "path.yaml"
    tilt = float(chain.device.core.plant.q[1])
    path.write_text(PATH.format(tilt, tilt + 0.2), encoding="utf-8")
    bags = f"bags:=['{GOLDEN / 'diagnosis_bag'}']"
    for k in ("", "_2"):
        chain.start(f"send_path{k}", "hydro_control", "send_path", str(path), "--timeout", "999")
        words = (*NAMED, f"__node:=controller{k}")
        chain.start(f"controller{k}", "hydro_control", "controller", *words)
    for k in ("", "_2"):
        words = (*NAMED, f"__node:=visual_joints{k}", "-p", "robot:=xs031")
        chain.start(f"visual_joints{k}", "hydro_msgs_docs", "visual_joints", *words)
        name = f"identification_node{k}"
        words = (*NAMED, f"__node:={name}", "-p", bags, "-p", "robot:=xs031")
        # It works all the time: not in the way of the others.
        chain.start(name, "hydro_ident", "identification_node", *words, nice=19)
