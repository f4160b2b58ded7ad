"""Signals to every process of a running machine, and what follows at the valves."""

from __future__ import annotations

import random
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from hydro_hw_bridge.faults.bus_injections import NOTHING_HEARD
from hydro_ident.bag.reader import read_bag
from hydro_ident.errors import IdentError
from hydro_ident.study.faults.promised import AGE_MS, RAMP_MS, WATCHDOG_MS
from hydro_ident.study.faults.ros_end import ACTIVATE, CONFIGURE
from hydro_ident.study.faults.stage import executable, until
from hydro_ident.study.faults.wall_outcomes import WallOutcome, judgement, worst_of
from hydro_ident.study.faults.wall_time import LATCHED_S, WallRun

SIGNALS = (signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM)
#: When a signal comes after the start: anywhere between importing and being done.
IDENTIFYING_S, SENDING_S = (0.5, 4.0), (0.1, 0.8)
#: A recorder has written so much before it gets a signal, and takes no longer to do so.
WRITTEN_BYTES, WRITING_S = 20_000, 60.0
#: What the gate says of messages whose numbers are not of one publisher.
TWO_PUBLISHERS = "commands of two publishers"
NOT_0_V = "not at 0 V"
#: A path of the tilt joint; from elsewhere the controller refuses it, and holds.
PATH = "joints: [tilt]\nstart: [-1.5]\nsegments: [{kind: move, to: [-1.4], duration_s: 2.0}]\n"


class ProcessDeeds:
    """Injections of signals.

    Parameters
    ----------
    run : WallRun
    bag : Path
        What the identification node identifies from.
    """

    def __init__(self, run: WallRun, bag: Path) -> None:
        self.run, self.stage, self._bag = run, run.stage, bag
        self._recordings = 0

    def deeds(self) -> dict[str, Callable[[random.Random], WallOutcome]]:
        """Every process with every signal, by kind; those with the controller in a row."""
        of: dict[str, Callable[[random.Random, signal.Signals, str], WallOutcome]] = {
            "can_bridge": self._bridge,
            "sim_rig": self._rig,
            "recorder": self._recorder,
            "identification_node": self._identification,
            "send_path": self._send_path,
            "controller": self._controller,
        }
        deeds: dict[str, Callable[[random.Random], WallOutcome]] = {
            kind: partial(_sent, deed, number, kind)
            for name, deed in of.items()
            for number in SIGNALS
            for kind in (f"process: {number.name} of {name}",)
        }
        return deeds | {"process: a second controller": self._second_controller}

    def _bridge(self, source: random.Random, number: signal.Signals, kind: str) -> WallOutcome:
        """Killed, stopped for a while, or told to end: 0 V, and not driven on with what waited."""
        self.run.drive()
        time.sleep(source.uniform(0.0, 0.05))
        since = self.stage.send("bridge", number)
        limit = AGE_MS if number is signal.SIGTERM else WATCHDOG_MS
        found = self.run.measured(kind, since, limit)
        if number is signal.SIGSTOP:
            woken = self.stage.send("bridge", signal.SIGCONT)
            time.sleep(LATCHED_S)
            moved = self.stage.moved_ns(woken) is not None
            broken = "the valves moved as the bridge went on" if moved else found.broken
            return replace(found, broken=broken)
        self.stage.end("bridge")
        self.run.start_bridge()
        return found

    def _controller(self, source: random.Random, number: signal.Signals, kind: str) -> WallOutcome:
        """The gate answers a controller that is gone; one that is told to end stops by itself."""
        self.run.drive(publishing=False)
        time.sleep(source.uniform(0.0, 0.05))
        since = self.stage.send("controller", number)
        limit = RAMP_MS if number is signal.SIGTERM else AGE_MS
        found = self.run.measured(kind, since, limit)
        if number is signal.SIGSTOP:
            self.stage.send("controller", signal.SIGCONT)
            time.sleep(LATCHED_S)
        else:
            self.stage.end("controller")
        return found

    def _second_controller(self, _source: random.Random) -> WallOutcome:
        """Another controller begins while one drives: its messages' numbers are others."""
        self.run.drive(publishing=False)
        words = (executable("hydro_control", "controller"), "--ros-args", "-r", "__node:=second")
        self.stage.start("second", *words)
        if not self.run.ros.transition("second", CONFIGURE):
            raise IdentError(f"the second controller: {self.stage.said('second')[-300:]}")
        # What starts it may have kept the first one waiting.
        self.run.drive(publishing=False)
        since = time.monotonic_ns()
        if not self.run.ros.transition("second", ACTIVATE):
            raise IdentError(f"the second controller: {self.stage.said('second')[-300:]}")
        reason = self.run.until_tripped()
        # When it sent its first command nobody knows from outside: no time is promised.
        found = self.run.measured("process: a second controller", since, None)
        missing = [] if TWO_PUBLISHERS in reason else [f"the bridge tripped: {reason}"]
        stopped = self.stage.first_stop_ns(since) is not None
        self.stage.end("second")
        return worst_of(worst_of(found, judgement(missing, reason)), "" if stopped else NOT_0_V)

    def _rig(self, source: random.Random, number: signal.Signals, kind: str) -> WallOutcome:
        """Standing still: 0 V with its first cycles after it; gone: a new one is not driven."""
        self.run.drive()
        time.sleep(source.uniform(0.0, 0.05))
        since = self.stage.send("rig", number)
        if number is signal.SIGSTOP:
            time.sleep(0.3)
            return self.run.measured(kind, self.stage.send("rig", signal.SIGCONT), AGE_MS)
        # That nothing is heard is the fault itself; another stall stands in its place.
        reason = self.run.until_tripped()
        missing = [] if reason.startswith(NOTHING_HEARD) else [f"the bridge tripped: {reason}"]
        self.stage.end("rig")
        self.stage.start_rig(self.run.machine_bus)
        time.sleep(2 * LATCHED_S)
        moved = self.stage.moved_ns(since) is not None
        broken = "the new machine was driven without being cleared" if moved else ""
        found = WallOutcome(kind, None, None, 0.0, broken)
        return worst_of(found, judgement(missing, reason))

    # -- processes that the valves do not depend on

    def _recorder(self, source: random.Random, number: signal.Signals, kind: str) -> WallOutcome:
        """The valves are driven on, and what was recorded can be read."""
        if not self.stage.running("recorder"):
            self._recordings += 1
            out = str(self._recorded)
            words = (executable("hydro_ident", "recorder"), "--out", out)
            self.stage.start("recorder", *words, ready="recording")
            until(lambda: self._written() > WRITTEN_BYTES, WRITING_S, "the recorder to write")
        self.run.drive()
        found = self._beside("recorder", number, kind, source.uniform(0.0, 0.05))
        if number is signal.SIGSTOP or found.broken:
            return found
        self.stage.end("recorder")
        (bag,) = self._recorded.iterdir()
        try:
            return found if read_bag(bag).series else replace(found, broken=f"{bag.name}: empty")
        except IdentError as error:
            return replace(found, broken=str(error))

    def _written(self) -> int:
        """Bytes of the present recording."""
        return sum(path.stat().st_size for path in self._recorded.rglob("*.mcap"))

    @property
    def _recorded(self) -> Path:
        return self.stage.folder / f"recorded{self._recordings}"

    def _identification(
        self, source: random.Random, number: signal.Signals, kind: str
    ) -> WallOutcome:
        """The valves are driven on, whatever it was about to do."""
        program = executable("hydro_ident", "identification_node")
        words = ("--ros-args", "-p", f"bags:=[{self._bag}]", "-p", "robot:=xs031")
        self.stage.start("identification", program, *words)
        self.run.drive()
        found = self._beside("identification", number, kind, source.uniform(*IDENTIFYING_S))
        self.stage.end("identification")
        return found

    def _send_path(self, source: random.Random, number: signal.Signals, kind: str) -> WallOutcome:
        """The controller drives on, whether the path reached it or not."""
        self.run.drive(publishing=False)
        path = self.stage.folder / "path.yaml"
        path.write_text(PATH, encoding="utf-8")
        self.stage.start("send_path", executable("hydro_control", "send_path"), str(path))
        found = self._beside("send_path", number, kind, source.uniform(*SENDING_S))
        self.stage.end("send_path")
        return found

    def _beside(self, name: str, number: signal.Signals, kind: str, delay_s: float) -> WallOutcome:
        """A signal to a process beside the valves' way: no trip but for lateness."""
        time.sleep(delay_s)
        if not self.stage.running(name):
            raise IdentError(f"{name} ended before its signal: {self.stage.said(name)[-300:]}")
        found = self.run.measured(kind, self.stage.send(name, number), None)
        if number is signal.SIGSTOP:
            self.stage.send(name, signal.SIGCONT)
            time.sleep(LATCHED_S)
        return worst_of(found, self.run.tripped())


def _sent(
    deed: Callable[[random.Random, signal.Signals, str], WallOutcome],
    number: signal.Signals,
    kind: str,
    source: random.Random,
) -> WallOutcome:
    return deed(source, number, kind)
