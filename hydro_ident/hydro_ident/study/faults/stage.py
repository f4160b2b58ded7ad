"""The processes of the campaign: started, signalled, and looked at from outside."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hydro_hw_bridge.faults import bare_timer
from hydro_hw_bridge.faults.measured_rig import STATES, record_of
from hydro_ident.errors import IdentError
from hydro_ident.study.faults.waiting import check_counted, longest_wait_ms, threads_waited_ns
from hydro_model.robot import FloatArray, Robot

READY_S = 120.0
END_S = 10.0
#: So long the valves were driven where a fault finds them so.
DRIVEN_NS = 20_000_000
#: Processes between a command and the valves; the campaign itself where it publishes.
ON_THE_WAY = ("controller", "bridge", "proxy", "rig")
PUBLISHER = "publisher"


def executable(package: str, name: str) -> str:
    """The path that `ros2 run` would run of a `package`."""
    from ament_index_python.packages import get_package_prefix

    return str(Path(get_package_prefix(package)) / "lib" / package / name)


class Stage:
    """Processes by name, with a log each.

    Parameters
    ----------
    folder : Path
        For logs and records.
    robot : Robot
    """

    def __init__(self, folder: Path, robot: Robot) -> None:
        self.folder = folder
        self._record = record_of(len(robot.valves))
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._rigs = 0
        self._waited: dict[str, dict[int, int]] = {}
        check_counted(os.getpid())

    def start(self, name: str, *command: str, ready: str = "") -> None:
        """Start a process, and wait for a line of its output.

        `ready` is in that line; empty: nothing is waited for.

        Raises
        ------
        IdentError
            It ended, or did not say so in time.
        """
        log = self.folder / f"{name}.log"
        with log.open("w", encoding="utf-8") as stream:
            self._processes[name] = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=stream, stderr=stream, text=True
            )
        end = time.monotonic() + READY_S
        while ready and ready not in log.read_text(encoding="utf-8"):
            if not self.running(name) or time.monotonic() > end:
                raise IdentError(f"{name} did not get ready: {self.said(name)[-300:]}")
            time.sleep(0.02)

    def start_rig(self, bus: str) -> None:
        """Start the measured rig on a `bus`, with a record of its own."""
        self._rigs += 1
        module = "hydro_hw_bridge.faults.measured_rig"
        path = str(self.rig_file)
        self.start("rig", sys.executable, "-m", module, bus, path, ready="ready")

    @property
    def rig_file(self) -> Path:
        """Record of the rig that runs now."""
        return self.folder / f"rig{self._rigs}.bin"

    def start_timer(self) -> None:
        """Start the bare timer."""
        path = str(self.folder / "timer.bin")
        self.start("timer", sys.executable, "-m", "hydro_hw_bridge.faults.bare_timer", path)

    def running(self, name: str) -> bool:
        """Whether a process was started and lives."""
        process = self._processes.get(name)
        return process is not None and process.poll() is None

    def said(self, name: str) -> str:
        """The output of a process so far."""
        return (self.folder / f"{name}.log").read_text(encoding="utf-8", errors="replace")

    def tell(self, name: str, text: str) -> None:
        """A line of standard input."""
        stream = self._processes[name].stdin
        if stream is None:
            raise IdentError(f"{name}: expected a standard input to write to, found none")
        stream.write(f"{text}\n")
        stream.flush()

    def tell_timed(self, name: str, text: str) -> int:
        """A line of standard input that is answered by `at MONOTONIC_NS`: that time."""
        self.mark()
        said = len(self.said(name))
        self.tell(name, text)
        until(lambda: "\n" in self.said(name)[said:], 5.0, f"{name} to do it")
        return int(self.said(name)[said:].split()[1])

    def send(self, name: str, number: signal.Signals) -> int:
        """Send a signal; the monotonic time just before, ns."""
        process = self._processes[name]
        self.mark()
        now_ns = time.monotonic_ns()
        os.kill(process.pid, number)
        return now_ns

    def end(self, *names: str) -> None:
        """End processes, in this order."""
        for name in names or tuple(reversed(self._processes)):
            process = self._processes.pop(name, None)
            if process is None:
                continue
            with contextlib.suppress(BrokenPipeError):
                if process.stdin is not None:
                    process.stdin.close()
            process.send_signal(signal.SIGCONT)
            process.terminate()
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    # -- who waits for a core

    def mark(self) -> None:
        """A fault begins: what `waited_ms` tells counts from now on."""
        self._waited = self._waits()

    def waited_ms(self, *, publishing: bool) -> dict[str, float]:
        """How long each process on the way waited for a core since the mark, its longest thread.

        `publishing` says whether the commands come from the campaign itself. Processes that are
        gone, or were not there, are not told of.
        """
        now = self._waits()
        return {
            name: longest_wait_ms(self._waited[name], now[name])
            for name in now
            if name in self._waited and (publishing or name != PUBLISHER)
        }

    def _waits(self) -> dict[str, dict[int, int]]:
        pids = {name: self._processes[name].pid for name in ON_THE_WAY if self.running(name)}
        waits = {name: threads_waited_ns(pid) for name, pid in pids.items()}
        # The campaign's main thread only looks on.
        waits[PUBLISHER] = threads_waited_ns(os.getpid(), without=os.getpid())
        return {name: threads for name, threads in waits.items() if threads}

    # -- what stands at the valves

    def valves(self, since_ns: int) -> tuple[Any, FloatArray]:
        """Monotonic times in ns (N,); enabled, watchdog, heard and voltages since then.

        Times are (N,), the others (N, 3 + m).
        """
        width = self._record.size
        with self.rig_file.open("rb") as stream:
            size = stream.seek(0, os.SEEK_END) // width * width
            # 30 s of cycles at most: injections are short.
            stream.seek(max(0, size - 15_000 * width))
            body = stream.read(size - stream.tell())
        kind = np.dtype([("at", "<i8"), ("values", "<f8", (width // 8 - 1,))])
        rows = np.frombuffer(body, dtype=kind)
        rows = rows[rows["at"] >= since_ns]
        return rows["at"], rows["values"]

    def first_stop_ns(self, since_ns: int) -> int | None:
        """When the valves first stood at 0 V, not enabled."""
        at, values = self.valves(since_ns)
        stopped = np.flatnonzero((values[:, 0] == 0.0) & ~values[:, STATES:].any(axis=1))
        return int(at[stopped[0]]) if stopped.size else None

    def moved_ns(self, since_ns: int) -> int | None:
        """When the valves first were enabled."""
        at, values = self.valves(since_ns)
        enabled = np.flatnonzero(values[:, 0] != 0.0)
        return int(at[enabled[0]]) if enabled.size else None

    def driven(self) -> bool:
        """Whether the valves have been driven, and not at 0 V, for the last 60 ms."""
        at, values = self.valves(time.monotonic_ns() - 60_000_000)
        return len(at) > 10 and bool(np.all(values[:, 0] != 0.0) and values[-1, STATES:].any())

    def driven_at(self, at_ns: int) -> bool:
        """Whether the valves were driven until a monotonic time: they stood enabled for 20 ms.

        `at_ns` is that time. Of a machine that stood still then its last cycle counts.
        """
        at, values = self.valves(0)
        before = at < at_ns
        near = before & (at >= at_ns - DRIVEN_NS)
        enabled = values[near, 0] if near.any() else values[before, 0][-1:]
        return bool(enabled.size) and bool(np.all(enabled != 0.0))

    def timer_lateness(self) -> tuple[Any, Any]:
        """Deadlines of the bare timer and how late each was, ns."""
        data = np.fromfile(self.folder / "timer.bin", dtype="<i8")
        pairs = data[: data.size - data.size % 2].reshape(-1, 2)
        size = 2 * pairs.itemsize
        if bare_timer.RECORD.size != size:
            found = bare_timer.RECORD.size
            raise IdentError(f"bare timer: expected records of {size} bytes, found {found}")
        return pairs[:, 0], pairs[:, 1]


def until(condition: Callable[[], object], wait_s: float, what: str) -> None:
    """Wait for something.

    `condition` is asked until it holds; the error says `what` should have come.

    Raises
    ------
    IdentError
        It did not come.
    """
    end = time.monotonic() + wait_s
    while not condition():
        if time.monotonic() > end:
            raise IdentError(f"expected {what} within {wait_s:g} s")
        time.sleep(0.005)
