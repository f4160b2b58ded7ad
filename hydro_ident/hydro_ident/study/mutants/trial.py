"""Runs the tests of a module over a changed source, in a fork that nothing else sees."""

from __future__ import annotations

import gc
import importlib
import importlib.abc
import importlib.util
import json
import os
import resource
import signal
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from hydro_ident.errors import IdentError
from hydro_ident.study.mutants.listed import TARGETS, Target

KILLED, SURVIVED, TIMED_OUT, NOT_LOADED = "killed", "survived", "timed_out", "not_loaded"
#: Slow to import, and no part of what is changed.
_SLOW = (
    "numpy",
    "can",
    "cantools",
    "hypothesis",
    "pytest",
    "_pytest.assertion.rewrite",
    "_pytest.cacheprovider",
    "_pytest.doctest",
    "_pytest.junitxml",
    "xdist.scheduler",
    "hydro_model.command_line.command",
    "hydro_model.effects",
    "hydro_model.multibody.kinematics",
    "hydro_model.multibody.rigid_body",
    "hydro_model.robot_files",
)
#: Of processor time, many times what the tests take: a change that never ends is found by it.
_MOST_CPU_S = 20
#: Of wall time, for one that waits for ever.
_PATIENCE_S = 300
#: pytest's exit codes: all passed, some failed, could not collect.
_PASSED, _FAILED = 0, 1


@dataclass(frozen=True, slots=True)
class Coverage:
    """What the tests of a module reach of it.

    Attributes
    ----------
    lines, lines_covered, branches, branches_covered : int
    """

    lines: int
    lines_covered: int
    branches: int
    branches_covered: int


def prepare() -> None:
    """Import what is slow, once for all forks.

    Raises
    ------
    IdentError
        A package of theirs has been imported already: forks would not see a changed module.
    """
    for name in _SLOW:
        importlib.import_module(name)
    gc.collect()
    gc.freeze()
    changed = tuple({f"{target.module.partition('.')[0]}." for target in TARGETS})
    early = [name for name in sys.modules if name.startswith(changed)]
    if early:
        raise IdentError(f"expected no module that is changed to be imported, found {early[0]}")


def tried(root: Path, target: Target, source: str) -> str:
    """How the tests of a module end over a changed source of it.

    Parameters
    ----------
    root : Path
        Top of the repository.
    target : Target
    source : str

    Returns
    -------
    str
        KILLED, SURVIVED, TIMED_OUT or NOT_LOADED.
    """
    pid = os.fork()
    if pid == 0:
        _in_fork(lambda: _tested(root, target, source), most_cpu_s=_MOST_CPU_S)
    _, status = os.waitpid(pid, 0)
    if os.WIFSIGNALED(status):
        return TIMED_OUT if os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGALRM) else KILLED
    code = os.WEXITSTATUS(status)
    return {_PASSED: SURVIVED, _FAILED: KILLED}.get(code, NOT_LOADED)


def covered(root: Path, target: Target) -> Coverage:
    """What the tests of a module reach of it, lines and branches.

    Parameters
    ----------
    root : Path
        Top of the repository.
    target : Target

    Raises
    ------
    IdentError
        The tests do not pass, or there is no report.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "coverage.json"
        pid = os.fork()
        if pid == 0:
            # Nothing is changed here that could run for ever, and a first run compiles.
            _in_fork(lambda: _measured(root, target, out), most_cpu_s=_PATIENCE_S)
        _, status = os.waitpid(pid, 0)
        if status or not out.is_file():
            raise IdentError(f"expected the tests of {target.file} to pass, found they do not")
        (found,) = json.loads(out.read_text(encoding="utf-8"))["files"].values()
    parts = [found["functions"][name] for name in target.within] or [found]
    keys = ("num_statements", "covered_lines", "num_branches", "covered_branches")
    return Coverage(*(sum(part["summary"][key] for part in parts) for key in keys))


def _in_fork(body: Any, *, most_cpu_s: int) -> None:
    """Run a body with limits and without a voice, and end the process with its exit code."""
    code = 3
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (most_cpu_s, most_cpu_s + 5))
        signal.alarm(_PATIENCE_S)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        code = body()
    finally:
        os._exit(code)


def _tested(root: Path, target: Target, source: str) -> int:
    sys.meta_path.insert(0, _Changed(target.module, root / target.file, source))
    return _pytest(root, target.tests)


def _measured(root: Path, target: Target, out: Path) -> int:
    coverage = importlib.import_module("coverage")
    measured = coverage.Coverage(data_file=None, branch=True, include=[str(root / target.file)])
    measured.start()
    code = _pytest(root, target.tests)
    measured.stop()
    measured.json_report(outfile=str(out))
    return code


def _pytest(root: Path, tests: Sequence[str]) -> int:
    import pytest

    os.chdir(root)
    paths = [str(root / test) for test in tests]
    options = ["-x", "-q", "--rootdir", str(root), "-p", "no:xdist", "-p", "no:cov"]
    return int(pytest.main([*options, *paths]))


class _Changed(importlib.abc.MetaPathFinder):
    """Finds one module with a changed source."""

    def __init__(self, name: str, path: Path, source: str) -> None:
        self._name, self._path, self._source = name, path, source

    def find_spec(
        self, name: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The changed module where it is asked for, nothing otherwise."""
        if name != self._name:
            return None
        loader = _Loader(name, str(self._path), self._source)
        return importlib.util.spec_from_file_location(name, self._path, loader=loader)


class _Loader(SourceFileLoader):
    """Loads a module from a text instead of its file, and leaves nothing compiled behind."""

    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self._source = source

    def get_code(self, fullname: str) -> CodeType:
        """The compiled text."""
        return compile(self._source, self.path, "exec", dont_inherit=True)
