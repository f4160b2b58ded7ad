"""The simulated machine in real time, with the wall time of every change at its valves.

    python -m hydro_hw_bridge.faults.measured_rig BUS FILE [ROBOT]

The device, plant and amplifiers of `sim_rig`; FILE gets a record per cycle: monotonic time in ns,
then enabled, watchdog and the amplifiers' voltages as doubles. SIGUSR1 turns all permissive
inputs on, SIGUSR2 opens the emergency stop.
"""

from __future__ import annotations

import signal
import struct
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

from hydro_hw_bridge.bus import open_bus, quiet_python_can
from hydro_hw_bridge.codec import Codec
from hydro_hw_bridge.endings import on_end
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.device import Device
from hydro_hw_bridge.rig.truth import Truth
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot


def record_of(valves: int) -> struct.Struct:
    """Layout of a record of so many valves."""
    return struct.Struct(f"<q{2 + valves}d")


class MeasuredRig(RigCore):
    """A rig that writes down what stands at its valves, and when.

    `stream` is the file of records that it writes.
    """

    def __init__(self, robot: Robot, truth: Truth, stream: BinaryIO) -> None:
        super().__init__(robot, truth)
        self._stream = stream
        self._record = record_of(len(robot.valves))

    def actuate(self, voltages: Sequence[float] | None, enable: bool = True) -> None:
        """Advance one cycle; the time is that of the amplifiers' step, at its begin.

        `enable` is the bridge's bit that lets the amplifiers drive.
        """
        now_ns = time.monotonic_ns()
        super().actuate(voltages, enable)
        amplifier = self.amplifier
        values = (float(amplifier.enabled), float(amplifier.tripped), *amplifier.output_v)
        self._stream.write(self._record.pack(now_ns, *values))


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
        signal.signal(signal.SIGUSR1, lambda *_: rig.set_inputs(emergency_stop_ok=True))
        signal.signal(signal.SIGUSR2, lambda *_: rig.set_inputs(emergency_stop_ok=False))
        print("ready", flush=True)
        device.run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
