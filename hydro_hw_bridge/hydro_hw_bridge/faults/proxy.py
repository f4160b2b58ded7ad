"""The fault line as a process between two buses: the machine on one, the bridge on the other.

    python -m hydro_hw_bridge.faults.proxy MACHINE_BUS BRIDGE_BUS

Every line of standard input is a fault as JSON, the fields of `BusFault` without `first_cycle`: it
begins with the next cycle, and the line `at MONOTONIC_NS` is printed when it does.
"""

from __future__ import annotations

import json
import queue
import sys
import threading
import time

from hydro_hw_bridge.bus.bus import Bus
from hydro_hw_bridge.bus.bus_open import open_bus, quiet_python_can
from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE, BusFault
from hydro_hw_bridge.faults.line import FaultLine
from hydro_hw_bridge.protocol.codec import Codec
from hydro_model.robot_files import load_robot
from hydro_msgs_docs.endings import on_end

TIMEOUT_S = 0.05


class Proxy:
    """Carries frames both ways through one fault line.

    Parameters
    ----------
    codec : Codec
    machine, bridge : Bus
        Receiving the machine's identifiers, and the bridge's.
    """

    def __init__(self, codec: Codec, machine: Bus, bridge: Bus) -> None:
        self.stopping = threading.Event()
        self.asked: queue.Queue[dict[str, object]] = queue.Queue()
        self._line = FaultLine(codec)
        self._lock = threading.Lock()
        self._ends = {DEVICE: (machine, bridge), BRIDGE: (bridge, machine)}
        self._sync = codec.device_ids[0]

    def carry(self, direction: str) -> None:
        """Carry one direction until stopped.

        Parameters
        ----------
        direction : {"device", "bridge"}
        """
        source, target = self._ends[direction]
        while not self.stopping.is_set():
            message = source.receive(TIMEOUT_S)
            if message is None:
                continue
            with self._lock:
                if message.arbitration_id == self._sync:
                    self._begin()
                out = self._line.take(message, direction)
                if direction == BRIDGE:
                    out = self._line.late_answers() + out
                for one in out:
                    target.send(one)

    def _begin(self) -> None:
        while not self.asked.empty():
            fields = self.asked.get()
            fields["frames"] = tuple(fields.get("frames", ()))  # type: ignore[arg-type]
            fault = BusFault(first_cycle=self._line.cycle + 1, **fields)  # type: ignore[arg-type]
            self._line.add(fault)
            print(f"at {time.monotonic_ns()}", flush=True)


def main() -> int:
    """Entry point."""
    quiet_python_can()
    codec = Codec.load(None, None, load_robot("xs031"))
    with (
        open_bus(sys.argv[1], codec.device_ids) as machine,
        open_bus(sys.argv[2], codec.bridge_ids) as bridge,
    ):
        proxy = Proxy(codec, machine, bridge)
        on_end(proxy.stopping.set)
        threads = [
            threading.Thread(target=proxy.carry, args=(way,), daemon=True)
            for way in (DEVICE, BRIDGE)
        ]
        for thread in threads:
            thread.start()
        print("ready", flush=True)
        for text in sys.stdin:
            proxy.asked.put(json.loads(text))
        proxy.stopping.wait()
        for thread in threads:
            thread.join(1.0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
