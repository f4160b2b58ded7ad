"""The controller process, cycle by cycle: a command for every sample, and 0 V at every end."""

from __future__ import annotations

import itertools
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hydro_control.core.core import Answer, ControllerCore, Sample
from hydro_control.gains import Gains
from hydro_hw_bridge.gate.gate import Gate, GateState, Output
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.permissives import Inputs
from hydro_model.robot import Robot
from hydro_msgs_docs import topics
from hydro_msgs_docs.messages import joint_state, stamp_ns

rclpy = pytest.importorskip("rclpy")

from rclpy.serialization import serialize_message  # noqa: E402

from hydro_control.core import winding_down  # noqa: E402
from hydro_control.node.hot_path import HotPath  # noqa: E402
from hydro_msgs_docs.nodes import ERROR, OK  # noqa: E402
from hydro_msgs_docs.real_time import RealTime, RealTimeOptions  # noqa: E402

pytestmark = pytest.mark.ros

QUIET = RealTime(RealTimeOptions(), print)


def test_one_command_per_stamp_and_repeats_are_identical(
    machine: Any, controller: Callable[..., subprocess.Popen[str]], wait_for: Callable[..., bool]
) -> None:
    controller()
    commands = [machine.answer(k, pressures_first=bool(k % 2)) for k in range(40)]
    stamps = [stamp_ns(c) for c in commands]
    assert stamps == sorted(set(stamps))
    # At rest in balance the valves stay shut.
    assert max(abs(v) for c in commands for v in c.effort) < 0.02
    moved = machine.answer(40, machine.pose + np.array([0.0, 0.002]))
    again = machine.answer(40, machine.pose + np.array([0.0, 0.003]))
    assert again == moved
    assert list(moved.name) == list(machine.robot.valve_names)
    assert abs(moved.effort[1]) > 0.01
    for topic in (topics.JOINT_REFERENCE, topics.TIP_REFERENCE):
        heard = machine.heard[topic]
        assert wait_for(lambda heard=heard: heard and stamp_ns(heard[-1]) == stamp_ns(moved))
    reference = machine.heard[topics.JOINT_REFERENCE][-1]
    np.testing.assert_allclose(reference.position, machine.pose, atol=1e-12)
    assert len(reference.effort) == 2
    assert machine.heard[topics.TIP_REFERENCE][-1].header.frame_id == "base_link"


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP], ids=["term", "int", "hup"]
)
def test_a_signal_ends_at_zero_volts(
    machine: Any,
    controller: Callable[..., subprocess.Popen[str]],
    number: int,
    wait_for: Callable[..., bool],
    patience_s: float,
) -> None:
    process = controller()
    for k in range(5):
        machine.answer(k)
    assert any(machine.answer(k, machine.pose - 0.02).effort[0] for k in range(5, 8))
    # Configured anew, it answers as before.
    for transition in ("deactivate", "cleanup", "configure", "activate"):
        machine.transition(transition)
    assert wait_for(lambda: list(machine.commands()[-1].effort) == [0.0, 0.0])
    assert any(machine.answer(k, machine.pose + 0.02 * (k % 2)).effort[0] for k in range(8, 11))
    process.send_signal(number)
    assert process.wait(patience_s) == 0
    assert wait_for(lambda: list(machine.commands()[-1].effort) == [0.0, 0.0])


class CountingHotPath(HotPath):
    """Counts the commands that it publishes, as a listener may hear the last ones later."""

    published = 0

    def _publish_command(self, stamp: int, voltage_v: Any) -> None:
        self.published += 1
        super()._publish_command(stamp, voltage_v)


def test_it_ends_on_a_ramp_to_zero_while_samples_come(
    machine: Any,
    monkeypatch: pytest.MonkeyPatch,
    wait_for: Callable[..., bool],
    patience_s: float,
) -> None:
    # Its last samples are waited for, however long a busy machine keeps this process from them.
    for name in ("LAST_SAMPLE_S", "RAMP_S"):
        monkeypatch.setattr(winding_down, name, patience_s)
    node = rclpy.create_node("hot", context=machine.context)
    core = ControllerCore(machine.robot, replace(Gains(), slew_limit_v_s=100.0))
    hot = CountingHotPath(node, core, 0, QUIET, lambda error: None)
    hot.start()
    cycle = 0
    while (
        abs(machine.answer(cycle, machine.pose if cycle == 0 else machine.pose - 0.05).effort[0])
        < 1.0
    ):
        cycle += 1
    ending = threading.Thread(target=hot.stop)
    ending.start()
    while ending.is_alive():
        cycle += 1
        before, stamp = len(machine.commands()), machine.publish(cycle, machine.pose - 0.05)
        machine.commands_of(stamp, before, 0.2)
    assert wait_for(lambda: len(machine.commands()) == hot.published)
    hot.destroy()
    node.destroy_node()
    voltage = np.array([c.effort for c in machine.commands()])
    assert np.abs(np.diff(voltage, axis=0)).max() <= 0.2 + 1e-9
    assert voltage[-1].tolist() == [0.0, 0.0]


#: Positions that are no numbers: it is at 0 V by itself, as after a run-away.
FAULT = [np.nan, -1.5]


@pytest.mark.parametrize("samples_come", [True, False], ids=["samples", "no samples"])
@pytest.mark.parametrize("last", [None, FAULT], ids=["driving", "at 0 V"])
def test_its_end_releases_the_gate_without_a_trip(
    machine: Any,
    monkeypatch: pytest.MonkeyPatch,
    wait_for: Callable[..., bool],
    patience_s: float,
    last: list[float] | None,
    samples_come: bool,
) -> None:
    """All that it published until its end, to the gate that the bridge has."""
    if samples_come:
        for name in ("LAST_SAMPLE_S", "RAMP_S"):
            monkeypatch.setattr(winding_down, name, patience_s)
    node = rclpy.create_node("hot", context=machine.context)
    core = ControllerCore(machine.robot, Gains())
    hot = CountingHotPath(node, core, 0, QUIET, lambda error: None)
    hot.start()
    for cycle in range(20):
        machine.answer(cycle, machine.pose - 0.05 * (cycle > 0))
    cycles = itertools.count(20)
    q = machine.pose - 0.05 if last is None else last
    assert any(machine.answer(next(cycles), q).effort) == (last is None)
    ending = threading.Thread(target=hot.stop)
    ending.start()
    while ending.is_alive():
        if samples_come:
            before, stamp = len(machine.commands()), machine.publish(next(cycles), q)
            machine.commands_of(stamp, before, 0.2)
    assert wait_for(lambda: len(machine.commands()) == hot.published)
    hot.destroy()
    node.destroy_node()
    gate = gate_after(machine.robot, machine.commands())
    assert (gate.state, gate.reason, gate.trips) == (GateState.WAITING, "", 0)
    assert gate.output == Output((0.0, 0.0), enable=False)


def gate_after(robot: Robot, commands: list[Any]) -> Gate:
    """A gate that heard these commands, each in the cycle of its stamp, and long nothing more."""
    rated = tuple(valve.rated_voltage_v for valve in robot.valves)
    gate = Gate(GateLimits(robot.valve_names, rated, 0.002, 1000.0, 5, 2.0e6))
    gate.advance(0)
    gate.arm()
    counters: dict[int, int] = {}
    for command in commands:
        counter = counters.setdefault(stamp_ns(command), len(counters))
        gate.advance(max(counters.values()))
        gate.check(Inputs(True, True, True, False, 19.0e6))
        gate.command(counter, command.name, command.effort)
        assert gate.state is GateState.DRIVING or command in commands[-2:]
    for counter in range(len(counters), len(counters) + 100):
        gate.advance(counter)
    return gate


def test_values_that_are_no_numbers_give_zero_volts(
    machine: Any, controller: Callable[..., subprocess.Popen[str]], wait_for: Callable[..., bool]
) -> None:
    controller()
    machine.answer(0)
    machine.answer(1, machine.pose - 0.02)
    assert list(machine.answer(2, FAULT).effort) == [0.0, 0.0]

    def said() -> list[str]:
        return [d.status[0].message for d in machine.heard[topics.DIAGNOSTICS]]

    assert wait_for(lambda: any("joint position [nan, -1.5]" in text for text in said()))


class FailingCore(ControllerCore):
    """A controller whose law breaks down at the tenth sample."""

    def answer(self, sample: Sample) -> Answer | None:
        if self.counts.answered == 9:
            raise ZeroDivisionError("a defect")
        return super().answer(sample)


class FailingTwiceCore(FailingCore):
    """And once more on the way down to 0 V."""

    def wind_down(self) -> Any:
        super().wind_down()
        raise ArithmeticError("another defect")


@pytest.mark.parametrize("core", [FailingCore, FailingTwiceCore])
def test_an_exception_in_the_loop_ends_at_zero_volts_and_is_told(
    machine: Any,
    wait_for: Callable[..., bool],
    monkeypatch: pytest.MonkeyPatch,
    patience_s: float,
    core: type[FailingCore],
) -> None:
    for name in ("LAST_SAMPLE_S", "RAMP_S"):
        monkeypatch.setattr(winding_down, name, patience_s)
    node = rclpy.create_node("hot", context=machine.context)
    told: list[BaseException] = []
    wound = []
    plain = ControllerCore.wind_down
    monkeypatch.setattr(ControllerCore, "wind_down", lambda c: wound.append(c) or plain(c))
    hot = HotPath(node, core(machine.robot, Gains()), 0, QUIET, told.append)
    hot.start()
    for k in range(9):
        last = machine.answer(k, machine.pose - 0.001 * k)
    assert any(last.effort)
    cycles = itertools.count(9)

    def ended() -> bool:
        machine.publish(next(cycles), machine.pose - 0.008)
        return bool(told)

    assert wait_for(ended)
    assert wound  # it was on its way down
    assert isinstance(told[0], ZeroDivisionError)
    assert wait_for(lambda: list(machine.commands()[-1].effort) == [0.0, 0.0])
    hot.stop()
    hot.destroy()
    node.destroy_node()


def test_bytes_that_are_no_message_are_passed_over_counted_and_told(
    machine: Any, controller: Callable[..., subprocess.Popen[str]], wait_for: Callable[..., bool]
) -> None:
    process = controller()
    machine.answer(0)
    whole = serialize_message(joint_state(1, ["finger"], position=[0.1]))

    def status() -> Any:
        wait_for(lambda: bool(machine.heard[topics.DIAGNOSTICS]))
        return machine.heard[topics.DIAGNOSTICS][-1].status[0]

    def told() -> bool:
        for name, data in (("joints", whole[:40]), ("pressures", whole[:5]), ("joints", bytes(3))):
            machine.publishers[name].publish(data)
        return wait_for(lambda: "bytes that are no JointState" in status().message, 1.2)

    assert wait_for(told)
    assert process.poll() is None
    # The next sample is answered, and what the newest message was is said no more.
    machine.answer(1)
    assert wait_for(lambda: status().message == "holding")
    assert int({v.key: v.value for v in status().values}["malformed"]) >= 3


def test_samples_that_no_longer_come_are_an_error_until_they_come_again(
    machine: Any, controller: Callable[..., subprocess.Popen[str]], wait_for: Callable[..., bool]
) -> None:
    controller()
    heard = machine.heard[topics.DIAGNOSTICS]

    def status() -> Any:
        return heard[-1].status[0]

    def age_s() -> float:
        return float({v.key: v.value for v in status().values}["sample_age_s"])

    assert wait_for(lambda: bool(heard) and status().message.startswith("waiting for "))
    time.sleep(1.0)
    # Before the first one nothing is missing.
    assert status().level == OK
    assert age_s() == 0.0
    machine.answer(0)
    silence = "waiting for samples: none for more than 1.5 s"
    assert wait_for(lambda: (status().level, status().message) == (ERROR, silence))
    assert wait_for(lambda: age_s() > 2.5)
    machine.answer(1)
    assert wait_for(lambda: (status().level, status().message) == (OK, "holding"))


def test_waits_for_the_recorders(
    machine: Any, controller: Callable[..., subprocess.Popen[str]]
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


def test_commands_that_the_valves_do_not_get_are_noticed(
    machine: Any, controller: Callable[..., subprocess.Popen[str]], wait_for: Callable[..., bool]
) -> None:
    valves = machine.publisher(topics.VALVE_STATE, topics.reliable(1000))
    controller()
    assert wait_for(lambda: valves.get_subscription_count() == 1)

    def said() -> str:
        heard = machine.heard[topics.DIAGNOSTICS]
        return str(heard[-1].status[0].message) if heard else ""

    def drive(cycles: range, share: float) -> Any:
        for k in cycles:
            # Not at the pose of the first sample, so something is commanded.
            command = machine.answer(k, machine.pose - 0.02 * (k > 0))
            applied = [share * v for v in command.effort]
            valves.publish(joint_state(stamp_ns(command), command.name, effort=applied))
        return machine.heard[topics.JOINT_REFERENCE][-1]

    drive(range(20), 1.0)
    reference = drive(range(20, 60), 0.0)
    np.testing.assert_allclose(reference.position, machine.pose - 0.02, atol=1e-12)
    assert wait_for(lambda: "the valves do not get the commands" in said())
    # Anchored where it is there is little to command: enough to see that it is applied.
    for k in range(60, 120):
        drive(range(k, k + 1), 1.0)
    machine.answer(120, machine.pose - 0.03)
    valves.publish(
        joint_state(stamp_ns(machine.commands()[-1]), machine.robot.valve_names, effort=[0.1, 0.1])
    )
    cycles = itertools.count(121)

    def holding() -> bool:
        machine.answer(next(cycles), machine.pose - 0.03)
        return wait_for(lambda: said() == "holding", 0.1)

    assert wait_for(holding)
