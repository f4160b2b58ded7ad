"""Processes of a script end with it, in their order, however often and hard it is asked to end."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[1] / "scripts"
PATIENCE_S = 60.0
#: A controller that takes its time to end, a bridge, and a client that goes on asking.
SCRIPT = """
set -euo pipefail
hydro_exe() { printf '%s' "$stub"; }
source "$scripts/processes.sh"
start controller bash -c 'trap "sleep 1.5; exit 0" TERM; echo up; while :; do sleep 0.05; done'
start bridge sleep 300
wait_for controller up
echo "${process_of[controller]} ${process_of[bridge]}" >"$log_dir/pids.txt"
transition controller controller activate
"""
#: A run of the demo that goes on until it is asked to end.
RUN = """#!/usr/bin/env bash
trap 'echo 0 >"$folder/zero.txt"; exit 143' TERM
echo $$ >"$folder/run.txt"
while :; do sleep 0.05; done
"""
STUB = """#!/usr/bin/env bash
echo $$ >"$log_dir/client.txt"
exec sleep 300
"""

needs_setpriv = pytest.mark.skipif(
    subprocess.run(["setpriv", "--pdeathsig", "TERM", "true"], check=False).returncode != 0
    if shutil.which("setpriv")
    else True,
    reason="no setpriv of util-linux that has --pdeathsig",
)


def _there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "Z" not in Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").split()[2]


def _default_signals() -> None:
    """In the child: a shell neither traps nor resets a signal that was ignored at its start."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def _wait_for(file: Path) -> list[int]:
    end = time.monotonic() + PATIENCE_S
    while not (file.is_file() and file.read_text(encoding="utf-8").strip()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return [int(word) for word in file.read_text(encoding="utf-8").split()]


@pytest.mark.parametrize("again", [[], [signal.SIGTERM], [signal.SIGINT, signal.SIGHUP]])
def test_a_script_that_is_asked_to_end_twice_leaves_nobody_behind(
    tmp_path: Path, again: list[signal.Signals]
) -> None:
    stub = tmp_path / "lifecycle"
    stub.write_text(STUB, encoding="utf-8")
    stub.chmod(0o755)
    own = {"stub": str(stub), "scripts": str(SCRIPTS), "log_dir": str(tmp_path)}
    script = subprocess.Popen(["bash", "-c", SCRIPT], env={**os.environ, **own})
    try:
        children = [*_wait_for(tmp_path / "pids.txt"), *_wait_for(tmp_path / "client.txt")]
        assert all(_there(pid) for pid in children)
        script.send_signal(signal.SIGTERM)
        for one in again:
            time.sleep(0.3)
            script.send_signal(one)
        assert script.wait(PATIENCE_S) == 143
        assert not [pid for pid in children if _there(pid)]
    finally:
        script.kill()


@needs_setpriv
def test_a_script_that_is_killed_leaves_nobody_driving(tmp_path: Path) -> None:
    """They are told to end, as by itself, and have the time for it that they need."""
    ending = 'trap "sleep 0.5; echo 0 V; exit 0" TERM; echo up; while :; do sleep 0.05; done'
    script = f"""
set -euo pipefail
hydro_exe() {{ :; }}
source "$scripts/processes.sh"
start bridge bash -c '{ending}'
wait_for bridge up
echo "${{process_of[bridge]}}" >"$log_dir/pids.txt"
while running bridge; do sleep 0.2; done
"""
    own = {"scripts": str(SCRIPTS), "log_dir": str(tmp_path)}
    process = subprocess.Popen(["bash", "-c", script], env={**os.environ, **own})
    (bridge,) = _wait_for(tmp_path / "pids.txt")
    try:
        process.kill()
        process.wait(PATIENCE_S)
        end = time.monotonic() + PATIENCE_S / 4
        while _there(bridge):
            assert time.monotonic() < end
            time.sleep(0.05)
        assert (tmp_path / "bridge.log").read_text(encoding="utf-8") == "up\n0 V\n"
    finally:
        with suppress(ProcessLookupError):
            os.kill(bridge, signal.SIGKILL)


@needs_setpriv
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_demo_that_is_ended_leaves_no_run_behind(number: signal.Signals, tmp_path: Path) -> None:
    """The shell ends at once, without a word to what it waits for."""
    shutil.copytree(SCRIPTS, tmp_path / "scripts")
    (tmp_path / "scripts/env.sh").write_text("hydro_exe() { printf true; }\n", encoding="utf-8")
    (tmp_path / "scripts/rig_run.sh").write_text(RUN, encoding="utf-8")
    demo = subprocess.Popen(
        ["bash", str(tmp_path / "scripts/demo.sh"), "--out", "out"],
        cwd=tmp_path,
        env={**os.environ, "folder": str(tmp_path)},
        preexec_fn=_default_signals,
    )
    (run,) = _wait_for(tmp_path / "run.txt")
    try:
        demo.send_signal(number)
        assert demo.wait(PATIENCE_S) == -number
        assert _wait_for(tmp_path / "zero.txt") == [0]
        end = time.monotonic() + PATIENCE_S
        while _there(run):
            assert time.monotonic() < end
            time.sleep(0.05)
    finally:
        with suppress(ProcessLookupError):
            os.kill(run, signal.SIGKILL)


def test_a_domain_in_which_somebody_takes_part_is_not_taken() -> None:
    script = 'hydro_exe() { :; }; source "$scripts/processes.sh"; unused_domain "$from"'

    def unused_from(domain: int) -> int:
        own = {"scripts": str(SCRIPTS), "from": str(domain)}
        done = subprocess.run(
            ["bash", "-c", script], env={**os.environ, **own}, capture_output=True, check=True
        )
        return int(done.stdout)

    free = unused_from(99)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        # Where the first participant of a domain is reached (OMG DDSI-RTPS, 9.6.1.1).
        participant.bind(("", 7400 + 250 * free + 10))
        other = unused_from(free)
    assert other != free
    assert 10 <= other <= 99
