"""Rig, bridge and controller, or the echo in the place of these two, in real time.

The rig is the simulated one in a thread of this process, its bus a `TimedBus`; the others are
processes as an installation starts them, in a ROS domain and on a multicast port of their own.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from hydro_hw_bridge.bus.bus_name import parse_bus
from hydro_hw_bridge.bus.bus_open import open_multicast, quiet_python_can
from hydro_hw_bridge.protocol.codec import Codec
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.device import Device
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_ident.bench.processes import Processes, entry
from hydro_ident.bench.timed_bus import TimedBus
from hydro_ident.errors import IdentError
from hydro_model.robot_files import load_robot

ROBOT, TRUTH, TIP_M = "xs031", "realistic", (2.0, 0.0, -1.2)
#: Executables as their set-up files name them.
BRIDGE = "hydro_hw_bridge.node.bridge_node"
CONTROLLER = "hydro_control.node.node"
#: Of the bridge, ms: what it takes at most, and what it has unless told otherwise.
LARGEST_AGE_MS, MAX_AGE_MS = 50.0, 10.0
TRIPPED = "tripped"
#: How long to wait for the first answers, and how many make a beginning.
_PATIENCE_S, _ANSWERS = 120.0, 100
_STROKE_S, _STROKE_M = 3.0, 0.6


@dataclass(frozen=True, slots=True)
class Running:
    """A chain that answers.

    Attributes
    ----------
    bus : TimedBus
    processes : mapping from name to process
    device : Thread
        Of the rig.
    rearm : callable
        Clears the bridge's trip; whether there was one that could be cleared.
    """

    bus: TimedBus
    processes: Mapping[str, subprocess.Popen[bytes]]
    device: threading.Thread

    rearm: Callable[[], bool] = lambda: False

    def check(self) -> None:
        """Raise IdentError where a part has ended before its time."""
        ended = [name for name, one in self.processes.items() if one.poll() is not None]
        ended += [] if self.device.is_alive() else ["rig"]
        if ended:
            raise IdentError(f"chain: {', '.join(ended)} ended before its time")


@contextmanager
def product(
    minutes: float, max_age_ms: float = MAX_AGE_MS, rt_priority: int = 0
) -> Iterator[Running]:
    """Bridge and controller, the tip going to and fro.

    Parameters
    ----------
    minutes : float
        How long the path is at least.
    max_age_ms : float
        The bridge's parameter: an older command makes it trip, and ends the answers.
    rt_priority : int
        Of both, as their parameter, with their memory locked; 0: neither is asked for.
    """
    real_time = {"rt_priority": f"{rt_priority}", "lock_memory": "true"} if rt_priority else {}
    with ExitStack() as stack:
        bus_name, bus, device, folder = _rig(stack)
        path = folder / "path.yaml"
        path.write_text(_path(minutes), encoding="utf-8")
        processes = _started(stack, folder)
        for name, module, given in (
            ("bridge", BRIDGE, {"can": bus_name, "max_age_ms": f"{max_age_ms:.1f}"}),
            ("controller", CONTROLLER, {"path": str(path)}),
        ):
            parameters = {"robot": ROBOT, **given, **real_time}
            words = [w for key, value in parameters.items() for w in ("-p", f"{key}:={value}")]
            processes.start(name, [*entry(module), "--ros-args", *words])
        for what in ("configure", "activate"):
            processes.transition(what, "can_bridge")
            processes.transition(what, "controller")
        running = Running(bus, processes.by_name, device, processes.clear_trip)
        yield _answering(running, processes)


@contextmanager
def echo() -> Iterator[Running]:
    """The echo in the place of bridge and controller."""
    with ExitStack() as stack:
        bus_name, bus, device, folder = _rig(stack)
        processes = _started(stack, folder)
        for part in ("commands", "frames"):
            processes.start(part, ["-m", "hydro_ident.bench.echo", part, bus_name])
        yield _answering(Running(bus, processes.by_name, device), processes)


def _rig(stack: ExitStack) -> tuple[str, TimedBus, threading.Thread, Path]:
    """The rig on a bus of its own, running until the stack ends."""
    quiet_python_can()
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    robot = load_robot(ROBOT)
    codec = Codec.load(None, None, robot)
    bus_name = f"udp_multicast:239.74.163.2:{45200 + os.getpid() % 2000}"
    name = parse_bus(bus_name)
    filters = [{"can_id": i, "can_mask": 0x1FFFFFFF} for i in codec.bridge_ids]
    bus = TimedBus(name, open_multicast(name, filters), codec)
    stack.callback(bus.close)
    core = RigCore(robot, load_truth(TRUTH, robot), seed=1, tip_m=TIP_M)
    device = Device(core, codec, bus, lockstep=False)
    thread = threading.Thread(target=device.run, name="rig", daemon=True)

    def end() -> None:
        device.stopping = True
        thread.join()

    thread.start()
    stack.callback(end)
    return bus_name, bus, thread, folder


def _started(stack: ExitStack, folder: Path) -> Processes:
    processes = Processes(folder)
    stack.callback(processes.stop)
    return processes


def _answering(running: Running, processes: Processes) -> Running:
    """Wait until the chain answers; what its parts said last where it does not."""
    end = time.monotonic() + _PATIENCE_S
    running.bus.begin()
    while running.bus.answered < _ANSWERS:
        try:
            running.check()
        except IdentError as error:
            raise IdentError(f"{error}: {processes.last_words()}") from None
        said = processes.last_words()
        if time.monotonic() > end or (TRIPPED in said and not running.rearm()):
            raise IdentError(f"chain: fewer than {_ANSWERS} cycles were answered: {said}")
        time.sleep(0.2)
    return running


def _path(minutes: float) -> str:
    """A tip path to and fro along x."""
    strokes = int(60.0 * minutes / _STROKE_S) + 2
    x, y, z = TIP_M
    corners = [[x + _STROKE_M * (k % 2), y, z] for k in range(strokes + 1)]
    durations = [_STROKE_S] * strokes
    return (
        f"frame: base_link\ntip_link: tip_link\ncorners_m: {corners}\ndurations_s: {durations}\n"
    )
