"""`calibrate --signs`, which drives valves, killed or stopped while it does.

The simulated machine goes on by its own count, answered or not, however busy the computer is: what
is promised in device time is held to that.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus
from hydro_hw_bridge.faults.injection import WATCHDOG
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.device import Device
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import Robot

pytestmark = pytest.mark.processes
PATIENCE_S = 120.0
PORT = 2_000 + (os.getpid() + 1_500) % 5_000
CAN = f"udp_multicast:239.74.163.2:{PORT}"
#: How long a cycle is held open for an answer that is to come, and for one that is not.
ANSWER_S, NO_ANSWER_S = 0.5, 0.02
#: A reference takes 250 cycles, and a valve's rest 200.
BEGIN_CYCLES = 1000
STOPPED = (False, (0.0, 0.0))
#: Alone on its bus it need not listen for bridges.
ALONE = """
import sys
from hydro_hw_bridge.bus import claims
from hydro_hw_bridge.commissioning import calibrate
claims.LISTEN_S = claims.CONTEST_S = 0.05
sys.exit(calibrate.main())
"""


@dataclass
class Machine:
    """The rig behind the device's end of the bus, a cycle at a time."""

    device: Device
    bus: Bus
    rows: list[tuple[bool, tuple[float, ...]]] = field(default_factory=list)

    def say(self) -> None:
        for message in self.device.frames():
            self.bus.send(message)

    def advance(self, wait_s: float) -> bool:
        """Take the cycle's answer, if one comes, and go on to the next; whether one came."""
        command, end = None, time.monotonic() + wait_s
        while command is None and (left := end - time.monotonic()) > 0.0:
            message = self.bus.receive(left)
            heard = None if message is None else self.device.decoded(message)
            command = heard if heard is not None and self.device.takes(heard) else None
        core = self.device.core
        core.actuate(*((None,) if command is None else (command.voltages, command.enable)))
        self.rows.append((core.amplifier.enabled, tuple(map(float, core.amplifier.output_v))))
        return command is not None

    def driven(self) -> bool:
        return bool(self.rows) and self.rows[-1][0] and any(self.rows[-1][1])

    def answered_cycle(self, process: subprocess.Popen[str]) -> None:
        """One cycle, told until it is answered: in lockstep the machine waits."""
        end = time.monotonic() + PATIENCE_S
        while process.poll() is None and time.monotonic() < end:
            self.say()
            if self.advance(ANSWER_S):
                return


@pytest.fixture
def machine(codec: Codec, robot: Robot) -> Iterator[Machine]:
    rig = RigCore(robot, load_truth("realistic", robot), seed=1)
    with open_bus(CAN, codec.bridge_ids) as bus:
        yield Machine(Device(rig, codec, bus, lockstep=True), bus)


@pytest.fixture
def process(machine: Machine, robot: Robot, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """`calibrate --signs` of a machine that stands where it is said to stand."""
    positions = machine.device.core.readings().measurement.positions
    at = [f"{j.name}={q:.6f}" for j, q in zip(robot.joints, positions, strict=True)]
    words = ["--can", CAN, "--out", str(tmp_path), "--signs", "--reference", *at]
    command = [sys.executable, "-c", ALONE, *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as found:
        yield found
        found.kill()
    assert list(tmp_path.iterdir()) == []


def drive(machine: Machine, process: subprocess.Popen[str], cycles: int) -> None:
    """From the first cycle on that is answered, until a valve was driven for so many."""
    begin = len(machine.rows)
    driven = 0
    while driven <= cycles:
        machine.answered_cycle(process)
        driven += machine.driven()
        assert process.poll() is None, process.communicate()[1]
        assert len(machine.rows) - begin < BEGIN_CYCLES + PATIENCE_S / ANSWER_S, "nothing driven"
    assert machine.driven()


def cycles_to_stop(machine: Machine) -> int:
    """Cycles without an answer to 0 V and off; one may have been on its way."""
    machine.say()
    answered = int(machine.advance(NO_ANSWER_S))
    begin = len(machine.rows) - 1 + answered
    while machine.rows[-1] != STOPPED:
        machine.say()
        assert not machine.advance(NO_ANSWER_S)
        assert len(machine.rows) - begin <= 2 * WATCHDOG, "the valves are driven on"
    return len(machine.rows) - begin


@pytest.mark.parametrize("after", [0, 17])
def test_killed_while_a_valve_is_driven_the_watchdog_ends_it(
    machine: Machine, process: subprocess.Popen[str], after: int
) -> None:
    drive(machine, process, after)
    if after:  # in the midst of its answer, and otherwise while it waits for a cycle
        machine.say()
    process.kill()
    process.wait(PATIENCE_S)
    assert cycles_to_stop(machine) == WATCHDOG
    for _ in range(WATCHDOG):
        machine.say()
        assert not machine.advance(0.0)
        assert machine.rows[-1] == STOPPED


@pytest.mark.parametrize("after", [0, 17])
def test_stopped_while_a_valve_is_driven_the_watchdog_ends_it_and_it_drives_no_more(
    machine: Machine, process: subprocess.Popen[str], after: int
) -> None:
    drive(machine, process, after)
    process.send_signal(signal.SIGSTOP)
    assert cycles_to_stop(machine) == WATCHDOG
    process.send_signal(signal.SIGCONT)
    # It goes on with what waited, and finds that its valve moves nothing.
    begin = len(machine.rows)
    while process.poll() is None:
        machine.answered_cycle(process)
        assert machine.rows[-1] == STOPPED
        assert len(machine.rows) - begin < 2 * BEGIN_CYCLES
    assert process.returncode == 1
    assert process.stderr is not None
    said = process.stderr.read()
    assert "should move" in said or "nothing from the device" in said
