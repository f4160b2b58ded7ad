"""A terminal gets colours, a bar and completions; a pipe, a file and a program get none."""

from __future__ import annotations

import io
import os
import pty
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hydro_model.command_line import terminal
from hydro_model.command_line.command import run_command


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Screen:
    made = Screen()
    # sys itself belongs to pytest, which puts files of its own in place for each test.
    monkeypatch.setattr(terminal, "sys", SimpleNamespace(stderr=made, stdout=sys.stdout))
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    return made


def test_colours_are_for_terminals_that_want_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert terminal.coloured("x", "red", Screen()) == "\x1b[31mx\x1b[0m"
    assert terminal.coloured("x", "red", io.StringIO()) == "x"
    monkeypatch.setenv("NO_COLOR", "1")
    assert terminal.coloured("x", "red", Screen()) == "x"
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "dumb")
    assert terminal.coloured("x", "red", Screen()) == "x"


def test_a_bar_shows_stages_and_leaves_nothing_behind(screen: Screen, capsys) -> None:
    with terminal.progress_bar():
        terminal.advance("first", 0, 4)
        terminal.advance("second", 2, 4)
        terminal.say("a line")
    text = screen.getvalue()
    assert "  0%" in text
    assert " 50%" in text
    assert "############............" in text
    assert text.endswith("\r\x1b[2K")
    assert capsys.readouterr().out == "a line\n"


def test_a_stage_is_not_drawn_over_and_over(screen: Screen) -> None:
    with terminal.progress_bar():
        for k in range(10_000):
            terminal.advance("many", k, 10_000)
    assert 0 < screen.getvalue().count("many") < 1000


def test_all_of_it_is_what_is_done_and_is_drawn_no_more_often(screen: Screen) -> None:
    """`100%` had stood there from 99.5 % on, and been written at every call from 100 % on."""
    with terminal.progress_bar():
        terminal.advance("nearly", 999, 1000)
        for _ in range(10_000):
            terminal.advance("many", 1, 1)
    assert " 99%" in screen.getvalue()
    assert 0 < screen.getvalue().count("100%") < 1000


def test_nothing_is_written_of_what_is_soon_done(screen: Screen, monkeypatch) -> None:
    pipe = io.StringIO()
    monkeypatch.setattr(terminal.sys, "stderr", pipe)
    with terminal.progress_bar():
        terminal.advance("x", 1, 2)
    assert pipe.getvalue() == screen.getvalue() == ""
    terminal.advance("x", 1, 2)  # outside of any bar


def test_a_log_gets_a_line_per_stage_and_one_now_and_then(monkeypatch) -> None:
    """Of work that takes long: whoever reads the log sees that it goes on, and where."""
    log, clock = io.StringIO(), [100.0]
    monkeypatch.setattr(terminal, "sys", SimpleNamespace(stderr=log, stdout=sys.stdout))
    monkeypatch.setattr(terminal, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(terminal, "_TICK_S", 60.0)  # between setting the clock and `advance`
    with terminal.progress_bar():
        for second in range(120):
            clock[0] = 100.0 + second
            terminal.advance("reading" if second < 20 else "fitting", second, 120)
    lines = log.getvalue().splitlines()
    assert lines == [
        "15 s: reading (12%)", "20 s: fitting (17%)", "50 s: fitting (42%)",
        "80 s: fitting (67%)", "110 s: fitting (92%)",
    ]  # fmt: skip


def _until(what: Callable[[], object]) -> None:
    """Wait for a thread's work; of one that does not come the caller's assertion tells."""
    until = time.monotonic() + 20.0
    while not what() and time.monotonic() < until:
        time.sleep(0.005)


def test_a_log_names_the_stage_that_began_before_the_quiet_time_ended(monkeypatch) -> None:
    """A stage that said so once, and then nothing for minutes, had left a log empty."""
    log, clock = io.StringIO(), [100.0]
    monkeypatch.setattr(terminal, "sys", SimpleNamespace(stderr=log, stdout=sys.stdout))
    monkeypatch.setattr(terminal, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(terminal, "_TICK_S", 0.001)
    with terminal.progress_bar():
        clock[0] += 3.0
        terminal.advance("reading", 1, 4)
        terminal.advance("searching", 3, 7)
        for count, seconds in enumerate((16.0, 46.0, 76.0), 1):
            clock[0] = 100.0 + seconds
            _until(lambda count=count: len(log.getvalue().splitlines()) == count)
    assert log.getvalue().splitlines() == [
        "16 s: searching (43%)", "46 s: searching (43%)", "76 s: searching (43%)",
    ]  # fmt: skip


def test_the_seconds_of_a_bar_go_on_while_a_stage_says_nothing(
    screen: Screen, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr(terminal, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(terminal, "_TICK_S", 0.001)
    with terminal.progress_bar():
        terminal.advance("searching", 3, 7)
        clock[0] += 71.0
        _until(lambda: " 43%    71 s  searching" in screen.getvalue())
    assert " 43%    71 s  searching" in screen.getvalue()


@pytest.mark.parametrize("fails", [False, True])
def test_no_thread_is_left_and_nothing_is_written_behind_a_bar(
    screen: Screen, fails: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, inside = threading.enumerate(), list[threading.Thread]()
    monkeypatch.setattr(terminal, "_TICK_S", 0.001)

    def work() -> None:
        with terminal.progress_bar():
            terminal.advance("x", 1, 2)
            inside.extend(set(threading.enumerate()) - set(before))
            if fails:
                raise ValueError("inside")

    with pytest.raises(ValueError, match="inside") if fails else nullcontext():
        work()
    (thread,) = inside
    assert not thread.is_alive()
    assert screen.getvalue().endswith("\r\x1b[2K")


FORKS = """
import os, sys, threading, time
from hydro_model.command_line import terminal

class Slow:
    # As a stream has it, a lock while it writes; here nearly always.
    lock = threading.Lock()
    def isatty(self):
        return False
    def write(self, text):
        with self.lock:
            time.sleep(0.001)
            os.write(2, text.encode())
    def flush(self):
        pass

sys.stderr = Slow()
terminal._TICK_S = terminal._QUIET_S = terminal._LINE_EVERY_S = 0.0
with terminal.progress_bar():
    terminal.advance("parent", 1, 2)
    for _ in range(100):
        child = os.fork()
        if child == 0:
            terminal.advance("child", 1, 2)
            with terminal.progress_bar():
                terminal.advance("child", 1, 2)
            sys.stderr.write("own\\n")
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
"""


def test_a_process_that_is_forked_while_a_line_is_written_neither_waits_nor_writes() -> None:
    """The thread writes without a pause: forked amid that, a child would wait for its lock."""
    done = subprocess.run(
        [sys.executable, "-c", FORKS], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout == ""
    assert done.stderr.count("own") == 100
    assert "parent" in done.stderr
    assert "child" not in done.stderr


def test_without_a_thread_more_the_work_is_done_and_drawn_as_it_says_something(
    screen: Screen, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    clock = [100.0]
    monkeypatch.setattr(terminal, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(threading.Thread, "start", refused)
    for what in ("fitting", "rolling out"):
        with terminal.progress_bar():
            clock[0] += 71.0
            terminal.advance(what, 1, 3)
        assert what in screen.getvalue()


def test_a_failure_clears_the_bar(screen: Screen) -> None:
    def fails() -> None:
        with terminal.progress_bar():
            terminal.advance("x", 1, 2)
            raise ValueError("inside")

    with pytest.raises(ValueError, match="inside"):
        fails()
    terminal.advance("later", 1, 2)
    assert "later" not in screen.getvalue()


COMMAND = """
import argparse, sys
from hydro_model.command_line.command import run_command
def main(arguments):
    p = argparse.ArgumentParser()
    p.add_argument("--robot"); p.add_argument("--out"); p.add_argument("--round")
    p.parse_args(arguments)
    return 0
sys.exit(run_command("tool", main))
"""


def test_a_shell_gets_the_options_that_begin_so(tmp_path: Path) -> None:
    pytest.importorskip("argcomplete", reason="argcomplete is optional and not installed")
    line = "tool --ro"
    asked = {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "words"),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    subprocess.run([sys.executable, "-c", COMMAND], env={**os.environ, **asked}, check=False)
    assert set((tmp_path / "words").read_text().split()) == {"--robot", "--round"}


def test_memory_that_ends_is_said_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    def main(arguments: Sequence[str]) -> int:
        return len(np.ones((1 << 60) // 8))

    assert run_command("tool", main, []) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("tool: out of memory: Unable to allocate")


def test_a_real_terminal_shows_the_bar() -> None:
    script = (
        "from hydro_model.command_line.terminal import advance, progress_bar\n"
        "with progress_bar():\n    advance('counting', 1, 2)\n"
    )
    master, slave = pty.openpty()
    environment = {**os.environ, "TERM": "xterm"}
    done = subprocess.run(
        [sys.executable, "-c", script], stderr=slave, stdout=subprocess.PIPE, env=environment
    )
    seen = os.read(master, 10_000).decode()
    os.close(slave)
    os.close(master)
    assert done.stdout == b""
    assert "counting" in seen
