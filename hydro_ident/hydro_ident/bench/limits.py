"""Work that has a time to keep: a tick of the control law, the start of a command."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from hydro_control.gains import Gains
from hydro_control.law import ControlLaw
from hydro_control.required_motion import Reference
from hydro_ident.bench.job import Row, against_limit, seconds_of
from hydro_ident.study.synthetic import STEP_S, synthetic_recording
from hydro_model.robot_files import load_robot

_TICK_LIMIT_S, _START_LIMIT_S = 1e-4, 0.5
_WARM_UP = 100


def control_tick(seconds: float = 20.0) -> Row:
    """99th percentile of a control law's answer to the samples of a recording.

    `seconds` is how long the recording is.
    """
    robot = load_robot("xs031")
    run = synthetic_recording(robot, seconds, seed=1)
    law, still, spent = ControlLaw(robot, Gains()), np.zeros(robot.dof), []
    columns = (run.q, run.p_a, run.p_b, run.supply, run.tank, run.q_ref)
    for k in range(len(run)):
        q, p_a, p_b, supply, tank, wanted = (np.asarray(column)[k] for column in columns)
        reference = Reference("joint", wanted, still, still)
        began = time.perf_counter()
        law.step(k * STEP_S, q, p_a, p_b, supply, tank, reference)
        spent.append(time.perf_counter() - began)
    worst = float(np.percentile(spent[_WARM_UP:], 99.0))
    return against_limit("control law, one tick, p99", "100 us", worst, _TICK_LIMIT_S)


def command_starts(bag: Path, rounds: int) -> list[Row]:
    """Starts of commands: help, and a look at a small bag.

    `rounds` is how often each is started: the median counts.
    """
    starts = {
        "start of a command, diagnose --help": ["hydro_ident.commands.diagnose", "--help"],
        "start of a command, inspect --help": ["hydro_ident.commands.inspect", "--help"],
        "start of a command, inspect of a small bag": ["hydro_ident.commands.inspect", str(bag)],
    }
    return [
        against_limit(name, "0.5 s", _start(arguments, rounds), _START_LIMIT_S)
        for name, arguments in starts.items()
    ]


def _start(arguments: list[str], rounds: int) -> float:
    module, *rest = arguments
    # As the installed executables do it.
    program = f"import sys; from {module} import main; sys.exit(main())"
    command = [sys.executable, "-c", program, *rest]

    def once() -> None:
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)

    once()
    return statistics.median(seconds_of(once) for _ in range(rounds))
