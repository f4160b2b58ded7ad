"""`can_bridge` as a process that is killed or stopped, or whose own end of the bus fails.

What counts is what stands at the rig's valves.

The simulated machine goes on by its own count, answered or not, however busy the computer is: what
is promised in device time is held to that.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.faults.injection import AGE, WATCHDOG
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.device import Device
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import Robot

pytestmark = pytest.mark.ros

PERIOD_NS = 2_000_000
CONFIGURE, ACTIVATE = 1, 3
#: How long a cycle is held open for an answer that is to come, and for one that is not.
ANSWER_S, NO_ANSWER_S = 20.0, 0.02
#: Longer than the interface takes to look at its file.
LOOK_S = 0.05
VOLTS = 1.0


@dataclass
class Machine:
    """The rig behind the device's end of the bus, a cycle at a time."""

    device: Device
    bus: Bus
    codec: Codec
    ros: Any
    zero_stamp_ns: int = 0
    sent: dict[int, tuple[float, ...]] = field(default_factory=dict)
    rows: list[tuple[bool, tuple[float, ...]]] = field(default_factory=list)

    @property
    def counter(self) -> int:
        return self.device.core.counter

    def say(self, first: int = 0, last: int | None = None) -> None:
        """Frames of the cycle at hand, or some of them."""
        for message in self.device.frames()[first:last]:
            self.bus.send(message)
        self.sent[self.counter] = self.device.core.readings().measurement.positions

    def advance(self, wait_s: float) -> None:
        """Take the cycle's answer, if one comes, and go on to the next."""
        command, end = None, time.monotonic() + wait_s
        while command is None and (left := end - time.monotonic()) > 0.0:
            message = self.bus.receive(left)
            heard = None if message is None else self.device.decoded(message)
            command = heard if heard is not None and self.device.takes(heard) else None
        core = self.device.core
        core.actuate(*((None,) if command is None else (command.voltages, command.enable)))
        self.rows.append((core.amplifier.enabled, tuple(map(float, core.amplifier.output_v))))

    def stamp_ns(self) -> int:
        return self.zero_stamp_ns + self.counter * PERIOD_NS

    def asked(self, *, hears: bool, answered: bool) -> None:
        """A cycle that is told, and a command for it."""
        if hears:
            self.say()
            self.ros.until(lambda: self.stamp_ns() in self.samples())
        self.ros.ask(self.stamp_ns(), VOLTS, -VOLTS)
        self.advance(ANSWER_S if answered else NO_ANSWER_S)

    def unanswered(self) -> None:
        """A cycle that is told, with a command for it, whoever hears either."""
        self.say()
        self.ros.ask(self.stamp_ns(), VOLTS, -VOLTS)
        self.advance(NO_ANSWER_S)

    def drive(self) -> None:
        """From the first sample of an active bridge on, until the valves are driven."""
        for _ in range(20):
            self.asked(hears=True, answered=True)
        assert self.driven()

    def driven(self) -> bool:
        on, volts = self.rows[-1]
        return on and any(volts)

    def stopped_after(self, *, hears: bool) -> int:
        """Cycles to 0 V and off, of those that are not answered."""
        begin = len(self.rows)
        while self.rows[-1] != (False, (0.0, 0.0)):
            assert len(self.rows) - begin <= 2 * WATCHDOG, "the valves are driven on"
            self.asked(hears=hears, answered=False)
        return len(self.rows) - begin

    def samples(self) -> list[int]:
        return [self.ros.stamp_of(m) for m in self.ros.heard["/chamber_pressures"]]

    def first_sample(self) -> None:
        """Tell the cycle at hand until it is heard; it stays open."""
        known = len(self.samples())
        while len(self.samples()) == known:
            self.say()
            for _ in range(10):
                self.ros.executor.spin_once(0.02)
        self.zero_stamp_ns = self.samples()[-1] - self.counter * PERIOD_NS

    def no_partial_sample(self) -> None:
        """What was published is what was sent in one cycle, of every cycle on both topics."""
        states, stamp_of = self.ros.heard["/joint_states"], self.ros.stamp_of
        self.ros.until(lambda: {stamp_of(m) for m in states} == set(self.samples()))
        for message in states:
            cycle = (stamp_of(message) - self.zero_stamp_ns) // PERIOD_NS
            assert message.position.tolist() == pytest.approx(self.sent[cycle], abs=1e-5)


@pytest.fixture
def machine(can_name: str, codec: Codec, robot: Robot, ros: Any) -> Iterator[Machine]:
    rig = RigCore(robot, load_truth("realistic", robot), seed=1)
    with open_bus(can_name, codec.bridge_ids) as bus:
        yield Machine(Device(rig, codec, bus, lockstep=True), bus, codec, ros)


@pytest.fixture
def faults(tmp_path: Path) -> Path:
    return tmp_path / "faults"


@pytest.fixture
def near_end(can_name: str, faults: Path) -> str:
    """The bridge's end of the bus, with faults on command of a file."""
    return f"{can_name.replace('udp_multicast', 'simulated_faults')}:{faults}"


def begin(machine: Machine, ros: Any) -> None:
    """Activate, and drive from a first command on."""
    machine.first_sample()
    ros.transition(ACTIVATE)
    machine.drive()


CUT_OFF: dict[str, tuple[str, str, Callable[[dict[str, str]], bool]]] = {
    "bus_off": (
        "bus-off: the CAN controller left the bus",
        "bus_error_frames",
        lambda said: said["bus_off"] == "yes",
    ),
    "queue_full": (
        "valve frames cannot be sent",
        "bus_dropped",
        lambda said: int(said["bus_dropped"]) > AGE,
    ),
}


@pytest.mark.parametrize("kind", CUT_OFF)
def test_cut_off_the_valves_are_at_0_v_by_the_watchdog_and_until_it_is_cleared(
    ros: Any, machine: Machine, processes: Any, near_end: str, faults: Path, kind: str
) -> None:
    reason, counter, shown = CUT_OFF[kind]
    ros.bring_up(processes, near_end, "clock:=lockstep")
    begin(machine, ros)
    before = ros.diagnosis()
    split = machine.counter
    if kind == "bus_off":
        machine.say(last=2)  # the rest of this cycle comes when it is back
        time.sleep(LOOK_S)
    faults.write_text(kind)
    if kind == "bus_off":
        ros.until(lambda: ros.diagnosis()["bus_off"] == "yes")
    else:
        time.sleep(LOOK_S)
    assert machine.stopped_after(hears=kind == "queue_full") <= WATCHDOG
    ros.until(lambda: ros.diagnosis()["message"] == f"tripped: {reason}")
    ros.until(lambda: shown(ros.diagnosis()))
    said = ros.diagnosis()
    assert int(said[counter]) > int(before[counter])
    assert int(said["trips"]) == int(before["trips"]) + 1
    assert ros.clear().message == f"still there: {reason}"
    # Back: whatever is commanded, 0 V and off until it is cleared.
    faults.write_text("ok")
    if kind == "bus_off":
        ros.until(lambda: ros.diagnosis()["bus_off"] == "no")
    else:
        time.sleep(LOOK_S)
    for _ in range(2 * AGE):
        machine.asked(hears=True, answered=True)
        assert machine.rows[-1] == (False, (0.0, 0.0))
    assert ros.diagnosis()["gate"] == "tripped"
    assert ros.clear().success
    at = len(machine.rows)
    machine.drive()
    volts = [row[1][0] for row in machine.rows[at - 1 :]]
    assert max(b - a for a, b in pairwise(volts)) < 0.021  # 10 V/s
    machine.no_partial_sample()
    assert kind != "bus_off" or machine.zero_stamp_ns + split * PERIOD_NS not in machine.samples()


def test_an_interface_that_is_gone_is_at_0_v_said_and_not_driven_unasked_once_it_is_back(
    ros: Any, machine: Machine, processes: Any, near_end: str, faults: Path
) -> None:
    ros.bring_up(processes, near_end, "clock:=lockstep")
    begin(machine, ros)
    faults.write_text("gone")
    assert processes.wait(0) == 1
    log = processes.log.read_text(encoding="utf-8")
    words = "receiving failed: simulated: the interface is gone"
    assert log.count(words) == 1
    assert "Traceback" not in log
    assert machine.stopped_after(hears=False) <= WATCHDOG
    # The last that it says of itself is why.
    ros.until(lambda: words in ros.diagnosis()["message"])
    machine.no_partial_sample()
    faults.write_text("ok")
    ros.heard["/joint_states"].clear()
    ros.heard["/chamber_pressures"].clear()
    processes.start(near_end, "clock:=lockstep")
    ros.until(lambda: ros.command.get_subscription_count() == 1)
    ros.transition(CONFIGURE)
    ros.until(lambda: all(ros.publishers.values()))
    machine.first_sample()
    for _ in range(AGE):
        machine.asked(hears=True, answered=False)
        assert machine.rows[-1] == (False, (0.0, 0.0))
    machine.first_sample()
    ros.transition(ACTIVATE)
    # Amplifiers that shut themselves down are not driven again before that is cleared, either.
    for _ in range(WATCHDOG):
        machine.asked(hears=True, answered=True)
        assert machine.rows[-1] == (False, (0.0, 0.0))
    ros.until(lambda: "amplifiers' watchdog shut them down" in ros.diagnosis()["message"])
    assert ros.clear().success
    machine.drive()
    machine.no_partial_sample()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_killed_or_stopped_while_it_drives_the_watchdog_ends_it(
    ros: Any, machine: Machine, processes: Any, can_name: str, number: signal.Signals
) -> None:
    """One that goes on drives nothing with the frames and commands that waited for it."""
    ros.bring_up(processes, can_name, "clock:=lockstep")
    begin(machine, ros)
    process = processes[0]
    process.send_signal(number)
    if number is signal.SIGKILL:
        processes.wait(0)
    else:
        assert os.WIFSTOPPED(os.waitpid(process.pid, os.WUNTRACED)[1])
    for _ in range(WATCHDOG):
        assert machine.driven()
        machine.unanswered()
    assert machine.rows[-1] == (False, (0.0, 0.0))
    if number is signal.SIGSTOP:
        process.send_signal(signal.SIGCONT)
        ros.until(lambda: ros.diagnosis()["gate"] == "tripped")
    for _ in range(2 * AGE):
        machine.unanswered()
        assert machine.rows[-1] == (False, (0.0, 0.0))
