"""One machine of the rig as a user meets it: excitation bags, and what the commands make of them.

The commands run in processes of their own on the bags and the datasheet robot. Nothing of the
machine's truth is written anywhere.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from hydro_control.core.core import ControllerCore
from hydro_control.gains import Gains
from hydro_hw_bridge.rig.core import RigCore
from hydro_hw_bridge.rig.truth import Truth
from hydro_ident.bag.writer import BagWriter
from hydro_ident.errors import IdentError
from hydro_ident.identify.results import MODEL_FILE
from hydro_ident.study.closed_loop import Run, run_closed_loop
from hydro_ident.study.patience import run_within
from hydro_model.motion.paths import JointPath, TipPath, load_path
from hydro_model.robot import Robot
from hydro_msgs_docs.topics import CHAMBER_PRESSURES, JOINT_REFERENCE, JOINT_STATES, VALVE_STATE

RUNS = ("excitation", "validation")
#: Recorded after the end of a path, as by the demo.
AFTER_S = 2.5
#: What a command may take, s: of minutes of recording on a busy computer, some minutes.
_PATIENCE_S = 3600.0
_START_NS, _SECOND_NS = 1_700_000_000_000_000_000, 1_000_000_000


def design_experiment(robot: str, start_tip_m: tuple[float, ...], folder: Path) -> None:
    """Design the excitation and validation run, unless the folder has them.

    Parameters
    ----------
    robot : str
    start_tip_m : tuple of float
    folder : Path

    Raises
    ------
    IdentError
        The command failed.
    """
    if not all((folder / f"{run}.yaml").is_file() for run in RUNS):
        tip = [f"{value:g}" for value in start_tip_m]
        command(folder.parent / "excite.txt", "excite", "--robot", robot, "--out", str(folder),
                "--start-tip", *tip)  # fmt: skip


def record_runs(
    robot: Robot, truth: Truth, experiment: Path, start_tip_m: tuple[float, ...], folder: Path
) -> tuple[Path, ...]:
    """Drive a machine with its datasheet model along the experiment, recorded.

    Parameters
    ----------
    robot : Robot
        The datasheet.
    truth : Truth
    experiment : Path
        Of `design_experiment`.
    start_tip_m : tuple of float
        Where the machine stands.
    folder : Path
        Of the bags; those that are there stay.

    Returns
    -------
    tuple of Path
        A bag per run of `RUNS`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bags = tuple(folder / run for run in RUNS)
    for noise_seed, bag in enumerate(bags, start=1):
        if bag.is_dir():
            continue
        path = load_path(experiment / f"{bag.name}.yaml")
        if not isinstance(path, JointPath | TipPath):
            raise IdentError(f"{bag.name}: expected a path of joints or tip")
        rig = RigCore(robot, truth, seed=noise_seed, tip_m=list(start_tip_m))
        core = ControllerCore(robot, Gains(), path)
        run = run_closed_loop(rig, core, path.duration_s + AFTER_S)
        part = folder / f"{bag.name}.part"
        shutil.rmtree(part, ignore_errors=True)
        write_bag(part, robot, run)
        part.rename(bag)
    return bags


def write_bag(path: Path, robot: Robot, run: Run) -> None:
    """A run as a bag: joints, pressures, valves and what the controller followed.

    Parameters
    ----------
    path : Path
        Of the new bag.
    robot : Robot
    run : Run
    """
    absolute = run.pressure_read + robot.atmospheric_pressure_pa
    columns = (
        (JOINT_STATES, robot.joint_names, "position", run.q_read),
        (CHAMBER_PRESSURES, robot.pressure_names, "effort", absolute),
        (VALVE_STATE, robot.valve_names, "effort", run.voltage_v),
        (JOINT_REFERENCE, robot.joint_names, "position", run.q_reference),
    )
    stamps = _START_NS + np.round(run.time_s * _SECOND_NS).astype(np.int64)
    with BagWriter(path, {"robot": robot.name}) as writer:
        for topic, *_ in columns:
            writer.add_topic(topic, "sensor_msgs/msg/JointState")
        for k, stamp in enumerate(stamps.tolist()):
            for topic, names, field, values in columns:
                writer.write_stamped(topic, stamp, {field: values[k]}, names=names)


def model_of(name: str, robot: str, bags: tuple[Path, ...], folder: Path) -> Path:
    """The model that `identify` or `diagnose` makes of the bags; one that is there is kept.

    Parameters
    ----------
    name : {"identify", "diagnose"}
    robot : str
    bags : tuple of Path
        To fit, and to validate on.
    folder : Path
        Of the results.

    Returns
    -------
    Path
        Of the model file.

    Raises
    ------
    IdentError
        The command failed or found too little for a model.
    """
    model = folder / MODEL_FILE
    if not model.is_file():
        command(folder.parent / f"{name}.txt", name, str(bags[0]), "--validate", str(bags[1]),
                "--robot", robot, "--out", str(folder))  # fmt: skip
    return model


def command(log: Path, name: str, *arguments: str) -> None:
    """Run a command of the package in a process of its own.

    `log` is the file that its output goes to.

    Raises
    ------
    IdentError
        It failed; says what it said. Or it did not end.
    """
    line = [sys.executable, "-m", f"hydro_ident.commands.{name}", *arguments]
    with log.open("w", encoding="utf-8") as out:
        how = {"stdout": out, "stderr": subprocess.PIPE, "text": True, "check": False}
        done = run_within(_PATIENCE_S, name, line, **how)
    if done.returncode:
        raise IdentError(f"{name} ended with {done.returncode}: {done.stderr.strip()}")
