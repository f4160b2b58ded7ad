"""The whole chain as processes over CAN and DDS: rig, bridge, recorder, controller."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from hydro_hw_bridge.rig.truth_log import TruthRecord, read_truth_log
from hydro_ident.bag.reader import read_bag
from hydro_ident.bag.recording import RECORDING_TOPICS, recording_of
from hydro_ident.commands.tracking import tracking_of
from hydro_model.robot_files import load_robot

pytestmark = pytest.mark.ros
ROOT = Path(__file__).parents[1]
DOMAIN = 10 + (os.getpid() + 12) % 90
#: How long to wait for what must come, however busy the machine is.
PATIENCE_S = 480.0
STOPPING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
PATH = """\
frame: base_link
tip_link: tip_link
corners_m: [[2.0, 0.0, -1.2], [2.15, 0.0, -1.2]]
durations_s: [1.0]
"""


def start(folder: Path, name: str, *options: str) -> subprocess.Popen[str]:
    (folder / "path.yaml").write_text(PATH)
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}
    script = str(ROOT / "scripts/rig_run.sh")
    named = ["--name", name, "--out", str(folder), "--path", str(folder / "path.yaml")]
    return subprocess.Popen(
        ["bash", script, *named, *options],
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
        preexec_fn=_default_signals,
    )


def _default_signals() -> None:
    """In the child: a shell neither traps nor resets a signal that was ignored at its start."""
    for number in STOPPING:
        signal.signal(number, signal.SIG_DFL)


def finish(process: subprocess.Popen[str]) -> None:
    try:
        _, error = process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.terminate()  # the script takes down what it has started
        process.communicate(timeout=PATIENCE_S)
        raise
    assert process.returncode == 0, error


@contextmanager
def hindered(word: str, seed: int) -> Iterator[list[int]]:
    """Stop a random process whose command has a word, for 1 to 50 ms, again and again.

    Whatever a busy computer does to processes comes down to this. Yields whom it stopped.
    """
    stopped, done, rng = list[int](), threading.Event(), random.Random(seed)

    def hinder() -> None:
        while not done.wait(rng.uniform(0.001, 0.1)):
            with suppress(IndexError, ProcessLookupError):  # none yet, or none any more
                pid = rng.choice(_processes_with(word))
                os.kill(pid, signal.SIGSTOP)
                stopped.append(pid)
                done.wait(rng.uniform(0.001, 0.05))
                os.kill(pid, signal.SIGCONT)

    thread = threading.Thread(target=hinder)
    thread.start()
    try:
        yield stopped
    finally:
        done.set()
        thread.join()


@pytest.fixture(scope="module")
def idle_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("idle")
    finish(start(folder, "idle"))
    return folder


def bag_of(folder: Path, name: str) -> Path:
    (bag,) = (folder / "bags").glob(f"*_{name}")
    return bag


def truth_of(folder: Path, name: str) -> TruthRecord:
    return read_truth_log(folder / "truth" / f"{name}.npz")


def test_the_bag_holds_every_cycle_of_the_run(idle_run: Path) -> None:
    robot = load_robot("xs031")
    recording = recording_of(read_bag(bag_of(idle_run, "idle"), RECORDING_TOPICS), robot)
    truth = truth_of(idle_run, "idle")
    assert len(recording) == len(truth.rows)
    assert not recording.gaps
    assert np.array_equal(np.unique(np.diff(recording.stamp_ns)), [2_000_000])
    # Encoders of 2^20 counts and half a count of noise, read back through frames and messages.
    step = 2.0 * np.pi / 2**20
    assert np.abs(recording.q - truth.columns("position")).max() < 6.0 * step
    # What the bridge says it applied reaches the amplifiers one cycle later, to the wire's step.
    applied = truth.columns("voltage")
    assert recording.valve_v is not None
    assert np.allclose(recording.valve_v[:-2], applied[2:], atol=1e-3)


def test_the_tip_follows(idle_run: Path) -> None:
    rows = tracking_of(
        read_bag(bag_of(idle_run, "idle"), RECORDING_TOPICS),
        load_robot("xs031"),
        idle_run / "truth/idle.npz",
    )
    # A datasheet model on a machine that is 20 % another one: follows, by no means exactly.
    assert rows["truth"].max_error_mm < 60.0
    assert rows["truth"].rmse_mm == pytest.approx(rows["encoders"].rmse_mm, abs=0.1)


@pytest.mark.thorough
def test_lockstep_does_not_depend_on_how_busy_the_machine_is(
    idle_run: Path, tmp_path: Path
) -> None:
    with hindered(str(tmp_path), seed=12) as stopped:
        finish(start(tmp_path, "busy"))
    assert len(set(stopped)) >= 4  # rig, bridge, recorder, controller
    idle, loaded = truth_of(idle_run, "idle"), truth_of(tmp_path, "busy")
    assert idle.names == loaded.names
    assert idle.rows.tobytes() == loaded.rows.tobytes()
    robot = load_robot("xs031")
    first = recording_of(read_bag(bag_of(idle_run, "idle"), RECORDING_TOPICS), robot)
    second = recording_of(read_bag(bag_of(tmp_path, "busy"), RECORDING_TOPICS), robot)
    for name in ("q", "p_a", "p_b", "valve_v", "tip_ref"):
        assert np.array_equal(getattr(first, name), getattr(second, name)), name


# Ctrl-C is tried with the commands of the README (test_docs_tour.py).
@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.thorough)]
)
def test_stopping_the_script_ends_every_child_with_the_valves_at_zero(
    number: signal.Signals, tmp_path: Path
) -> None:
    # Long enough that it is the signal that ends the run.
    process = start(tmp_path, "stopped", "--real-time", "--duration", "600")
    log = tmp_path / "logs/stopped.bridge.log"
    deadline = time.monotonic() + PATIENCE_S
    # A machine that is too busy for 500 Hz may trip before it is seen to drive.
    words = ("driving", "tripped")
    while not (log.exists() and any(word in log.read_text() for word in words)):
        assert time.monotonic() < deadline, log.read_text() if log.exists() else "no log"
        assert process.poll() is None
        time.sleep(0.05)
    time.sleep(0.5)
    assert len(_processes_with(str(tmp_path))) >= 4  # rig, bridge, recorder, controller
    os.killpg(process.pid, number)  # as a terminal does: the whole foreground group
    process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 128 + number
    assert _processes_with(str(tmp_path)) == []
    truth = truth_of(tmp_path, "stopped")
    voltage, enabled = truth.columns("voltage"), truth.column("enabled")
    # On a machine that is too busy for 500 Hz the bridge ends the driving before the signal does.
    stopped = "tripped" in log.read_text()
    assert enabled.max() == 1.0 or stopped
    assert enabled[-1] == 0.0
    assert np.all(voltage[-1] == 0.0)
    robot = load_robot("xs031")
    recording = recording_of(read_bag(bag_of(tmp_path, "stopped"), RECORDING_TOPICS), robot)
    assert recording.valve_v is not None
    stated = recording.valve_v[np.isfinite(recording.valve_v).all(axis=1)]
    assert np.abs(stated).max() > 0.0 or stopped
    assert np.all(stated[-1] == 0.0)


def _processes_with(text: str) -> list[int]:
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            command = (folder / "cmdline").read_bytes().decode()
        except OSError:
            continue  # it ended meanwhile
        if text in command:
            found.append(int(folder.name))
    return found
