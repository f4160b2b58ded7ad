"""Work that has a time to keep: a tick of the control law, the start of a command."""

from __future__ import annotations

import importlib.metadata
import shlex
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from hydro_control.core.answer import Answer
from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_control.state.sample import Sample
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth_files import load_truth
from hydro_ident.bench.job import Row, against_limit, seconds_of
from hydro_ident.bench.processes import entry
from hydro_ident.study.closed_loop import run_closed_loop
from hydro_ident.study.known_effects import known_effects
from hydro_ident.study.patience import unended
from hydro_model.motion.paths import load_path
from hydro_model.robot import Robot
from hydro_model.robot_files import load_robot

ROBOT, TRUTH, PATH = "xs031", "realistic", "xs031/parallelogram"
#: Packages whose installed executables are started.
PACKAGES = ("hydro_ident", "hydro_control", "hydro_hw_bridge", "hydro_msgs_docs")
BASE = "control law, one tick, p99"
LISTED = "control law with friction, overlap, leakage and spool lag listed, one tick, p99"
EMPTY, HELP = "start of the interpreter, python -c pass", "start of a command, the slowest --help"
INSPECTED = "start of a command, inspect of a small bag"
_TICK_LIMIT_S, _START_LIMIT_S = 1e-4, 0.5
#: How long a command that is to start in half a second is waited for, s.
_PATIENCE_S = 60.0
_WARM_UP = 100


class TimedCore(ControllerCore):
    """A controller that notes how long its answers take.

    Attributes
    ----------
    spent_s : list of float
    """

    def __post_init__(self) -> None:
        self.spent_s: list[float] = []
        super().__post_init__()

    def answer(self, sample: Sample) -> Answer | None:
        """As `ControllerCore.answer`.

        Parameters
        ----------
        sample : Sample
        """
        began = time.perf_counter()
        found = super().answer(sample)
        self.spent_s.append(time.perf_counter() - began)
        return found


def control_ticks(rounds: int, seconds: float = 20.0) -> list[Row]:
    """99th percentiles of a controller's answers: of the base model, and with listed effects.

    Parameters
    ----------
    rounds : int
        Of both, in turns: the median counts.
    seconds : float
        How long one is driven, at most the path's own time.
    """
    robot = load_robot(ROBOT)
    models = {BASE: robot, LISTED: known_effects(robot, load_truth(TRUTH, robot))}
    turns = [
        {name: tick(robot, model, seconds) for name, model in models.items()}
        for _ in range(rounds)
    ]
    return [
        against_limit(
            name, "100 us", statistics.median(t[name] for t in turns), _TICK_LIMIT_S, rounds=rounds
        )
        for name in models
    ]


def tick(robot: Robot, model: Robot, seconds: float) -> float:
    """99th percentile of a controller's answers that drives the realistic rig along a path, s.

    Parameters
    ----------
    robot : Robot
        By the datasheet.
    model : Robot
        Of the controller: what it lists is evaluated in every tick.
    seconds : float
    """
    truth, path = load_truth(TRUTH, robot), load_path(PATH)
    rig = RigCore(robot, truth, seed=1, tip_m=path.sample(0.0)[0].tolist())
    core = TimedCore(model, Gains(), path)
    run_closed_loop(rig, core, min(seconds, path.duration_s))
    return _p99(core.spent_s)


def _p99(spent_s: list[float]) -> float:
    return float(np.percentile(spent_s[_WARM_UP:], 99.0))


def executables() -> dict[str, str]:
    """Modules of the installed executables' `main`, by name, of `PACKAGES`."""
    return {
        one.name: one.module
        for package in PACKAGES
        for one in importlib.metadata.distribution(package).entry_points
        if one.group == "console_scripts"
    }


def command_starts(bag: Path, rounds: int) -> list[Row]:
    """Starts of the interpreter alone, of every command's help, and of a look at a small bag.

    Parameters
    ----------
    bag : Path
    rounds : int
        How often each is started, in turns: the median counts. Of helps the slowest is a row.
    """
    helps = {name: [*entry(module), "--help"] for name, module in executables().items()}
    look = [*entry("hydro_ident.commands.inspect"), str(bag)]
    words = {EMPTY: ["-c", "pass"], INSPECTED: look, **helps}
    took = in_turns({name: partial(_start, given) for name, given in words.items()}, rounds)
    slowest = max(helps, key=lambda name: took[name])
    limits = {EMPTY: "0.5 s", HELP: f"0.5 s ({slowest}, of {len(helps)})", INSPECTED: "0.5 s"}
    took[HELP] = took[slowest]
    return [
        against_limit(name, limit, took[name], _START_LIMIT_S, rounds=rounds)
        for name, limit in limits.items()
    ]


def in_turns(works: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Medians of the times of works that are done one after the other, each round anew, s.

    Parameters
    ----------
    works : mapping of str to callable
        Each is done once before.
    rounds : int
    """
    for work in works.values():
        work()
    times = [{name: seconds_of(work) for name, work in works.items()} for _ in range(rounds)]
    return {name: statistics.median(one[name] for one in times) for name in works}


def _start(words: list[str]) -> None:
    # Not `wait` with a time to end at: that looks every 50 ms, and this is measured.
    process = subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL)
    watch = threading.Timer(_PATIENCE_S, process.kill)
    watch.start()
    try:
        code = process.wait()
    finally:
        watch.cancel()
        process.kill()
    if code == -signal.SIGKILL:
        raise unended(shlex.join(words), _PATIENCE_S)
    if code:
        raise subprocess.CalledProcessError(code, words)
