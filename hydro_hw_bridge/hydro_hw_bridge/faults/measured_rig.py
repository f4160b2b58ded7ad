"""The simulated machine in real time, with the wall time of every change at its valves.

    python -m hydro_hw_bridge.faults.measured_rig BUS FILE [ROBOT]

The device, plant and amplifiers of `sim_rig`; FILE gets a record per cycle: monotonic time in ns,
then enabled, watchdog, heard (the voltages came in a frame of their cycle) and the amplifiers'
voltages as doubles.

Every line of standard input is a permissive that opens (emergency_stop, pump, enable), `supply`,
which loses its pressure for as long as nothing else is said, or `all`: everything is there again.
The line `at MONOTONIC_NS` is printed when it is so.
"""

from __future__ import annotations

import struct
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import BinaryIO

from hydro_hw_bridge.bus.bus_open import open_bus, quiet_python_can
from hydro_hw_bridge.errors import BridgeError
from hydro_hw_bridge.faults.machine_faults import PERMISSIVES, SUPPLY
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.device import Device
from hydro_hw_bridge.rig.truth import Truth
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.endings import on_end

#: Doubles of a record before the voltages: enabled, watchdog, heard.
STATES = 3
#: Word that gives everything back.
ALL = "all"


def record_of(valves: int) -> struct.Struct:
    """Layout of a record of so many valves."""
    return struct.Struct(f"<q{STATES + valves}d")


class MeasuredRig(RigCore):
    """A rig that writes down what stands at its valves, and when.

    `stream` is the file of records that it writes.
    """

    def __init__(self, robot: Robot, truth: Truth, stream: BinaryIO) -> None:
        super().__init__(robot, truth)
        self._stream = stream
        self._record = record_of(len(robot.valves))
        # Voltages come out as many cycles after their frame as the amplifiers take.
        delay = truth.command_delay_cycles
        self._heard = deque([False] * (delay + 1), maxlen=delay + 1)
        self._supply_open = False

    def actuate(self, voltages: Sequence[float] | None, enable: bool = True) -> None:
        """Advance one cycle; the time is that of the amplifiers' step, at its begin.

        `enable` is the bridge's bit that lets the amplifiers drive.
        """
        now_ns = time.monotonic_ns()
        super().actuate(voltages, enable)
        self._heard.append(voltages is not None)
        amplifier = self.amplifier
        states = (amplifier.enabled, amplifier.tripped, self._heard[0])
        self._stream.write(self._record.pack(now_ns, *map(float, states), *amplifier.output_v))
        if self._supply_open:
            self.drop_supply(0.0)

    def turn(self, word: str) -> None:
        """Open a permissive, or close all of them.

        `word` is a line of standard input. May be called from any thread: it takes effect in the
        next cycle.

        Raises
        ------
        BridgeError
            The word is none of these.
        """
        if word not in (*PERMISSIVES, SUPPLY, ALL):
            raise BridgeError(f"expected a permissive or '{ALL}', found '{word}'")
        if word == SUPPLY:
            self._supply_open = True
        elif word == ALL:
            self._supply_open = False
            self.set_inputs(**dict.fromkeys(PERMISSIVES.values(), True))
        else:
            self.set_inputs(**{PERMISSIVES[word]: False})


def _obey(rig: MeasuredRig, lines: Iterable[str]) -> None:
    """Do what is said, and say when it was done."""
    for line in lines:
        rig.turn(line.strip())
        print(f"at {time.monotonic_ns()}", flush=True)


def main() -> int:
    """Entry point."""
    bus_name, path, *rest = sys.argv[1:]
    quiet_python_can()
    robot = load_robot(rest[0] if rest else "xs031")
    codec = Codec.load(None, None, robot)
    truth = load_truth("realistic", robot)
    with open_bus(bus_name, codec.bridge_ids) as bus, Path(path).open("wb", buffering=0) as out:
        rig = MeasuredRig(robot, truth, out)
        device = Device(rig, codec, bus, lockstep=False)
        on_end(lambda: setattr(device, "stopping", True))
        threading.Thread(target=_obey, args=(rig, sys.stdin), daemon=True).start()
        print("ready", flush=True)
        device.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
