"""Time for which processes were ready to run and had no core, by the kernel's own counts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hydro_ident.errors import IdentError
from hydro_ident.study.faults import waiting
from hydro_ident.study.faults.stage import Stage
from hydro_ident.study.faults.waiting import check_counted, longest_wait_ms, threads_waited_ns
from hydro_model.robot import Robot

SPAN_S = 0.4
BUSY = "import os, sys\nos.sched_setaffinity(0, {int(sys.argv[1])})\nprint('ready')\nwhile 1: pass"


@pytest.fixture
def stage(tmp_path: Path, robot: Robot) -> Iterator[Stage]:
    """A bridge and a rig that both want all of one core."""
    found = Stage(tmp_path, robot)
    core = str(min(os.sched_getaffinity(0)))
    try:
        for name in ("bridge", "rig"):
            found.start(name, sys.executable, "-uc", BUSY, core, ready="ready")
        yield found
    finally:
        found.end()


def test_of_two_processes_on_one_core_one_waits_and_a_stopped_one_does_not(stage: Stage) -> None:
    stage.mark()
    time.sleep(SPAN_S)
    waited = stage.waited_ms(publishing=False)
    assert set(waited) == {"bridge", "rig"}
    # At any time one of them at least has no core.
    assert waited["bridge"] + waited["rig"] > 0.6e3 * SPAN_S
    stage.send("rig", signal.SIGSTOP)
    time.sleep(0.05)
    stage.mark()
    time.sleep(SPAN_S)
    assert stage.waited_ms(publishing=False)["rig"] < 0.1e3 * SPAN_S
    # The campaign is on the way where it publishes, and what is gone waits for nothing.
    stage.end("rig")
    assert "rig" not in stage.waited_ms(publishing=True)


def test_a_signal_begins_the_count_anew(stage: Stage) -> None:
    stage.mark()
    time.sleep(2.0 * SPAN_S)
    before = sum(stage.waited_ms(publishing=False).values())
    stage.send("bridge", signal.SIGSTOP)
    assert sum(stage.waited_ms(publishing=False).values()) < 0.5 * before


def test_the_campaigns_own_threads_count_without_the_one_that_looks_on() -> None:
    me = os.getpid()
    assert me in threads_waited_ns(me)
    assert me not in threads_waited_ns(me, without=me)


def test_the_longest_wait_is_of_one_thread_and_a_new_one_began_with_none() -> None:
    assert longest_wait_ms({1: 5_000_000, 2: 0}, {1: 6_000_000, 2: 2_000_000}) == 2.0
    assert longest_wait_ms({1: 5_000_000}, {1: 5_000_000, 3: 4_000_000}) == 4.0
    assert longest_wait_ms({1: 5_000_000}, {}) == 0.0


def test_a_process_that_is_gone_has_no_threads_and_a_kernel_that_does_not_count_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as gone:
        gone.wait()
    assert threads_waited_ns(gone.pid) == {}
    check_counted(os.getpid())
    monkeypatch.setattr(waiting, "COUNTS", "none_such")
    with pytest.raises(IdentError, match="CONFIG_SCHED_INFO"):
        check_counted(os.getpid())
