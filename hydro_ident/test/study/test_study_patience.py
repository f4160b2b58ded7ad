"""A process that does not end is ended, and named."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hydro_ident.bench import limits, made, processes
from hydro_ident.errors import IdentError
from hydro_ident.study import machine_bags
from hydro_ident.study.patience import run_within
from hydro_ident.study.peak import spent

#: Longer than any test waits.
ENDLESS = "import time; time.sleep(3600)"


def test_what_ends_in_time_is_as_it_was() -> None:
    done = run_within(60.0, "hello", [sys.executable, "-c", "print('hello')"], capture_output=True)
    assert (done.returncode, done.stdout) == (0, b"hello\n")


def test_a_measured_process_that_does_not_end_is_named() -> None:
    with pytest.raises(IdentError, match=r"^timeit: expected its end within 0\.5 s"):
        spent("timeit", ["-n", "1", "-r", "1", ENDLESS], patience_s=0.5)


def test_a_command_that_does_not_start_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "_PATIENCE_S", 0.5)
    with pytest.raises(IdentError, match=r"^-c 'import time.* expected its end within 0\.5 s"):
        limits._start(["-c", ENDLESS])


def test_an_identification_that_does_not_end_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However little it has to do: it is not waited for at all."""
    monkeypatch.setattr(machine_bags, "_PATIENCE_S", 0.0)
    with pytest.raises(IdentError, match=r"^identify: expected its end within 0 s"):
        machine_bags.command(tmp_path / "log", "identify", "--help")


def test_a_lifecycle_node_that_does_not_answer_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "entry", lambda _: ["-c", ENDLESS])
    monkeypatch.setattr(processes, "_BESIDE_S", 0.5)
    monkeypatch.setattr(processes, "_NODE_S", 0.0)
    with pytest.raises(IdentError, match=r"^lifecycle activate /controller: expected its end"):
        processes.Processes(tmp_path).transition("activate", "controller")


def test_a_git_that_does_not_answer_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    git = tmp_path / "git"
    git.write_text("#!/bin/sh\nexec sleep 3600\n", encoding="ascii")
    git.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(made, "_GIT_S", 0.5)
    assert made._commit(tmp_path) == "unknown (git did not answer within 0.5 s)"
