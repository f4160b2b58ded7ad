"""Runs tests on copies of the package, each time in a process of its own.

Started as a file, not as a module: what takes long to import is imported once, and nothing of
`hydro_ident` is. For every job (a line of JSON on standard input) it forks. The fork puts the copy
first on the module path, runs the tests, and writes down how each ended and which files the
modules that matter came from. A line on standard output says that a job is done.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

PASSED, ASSERTION, ERROR, SKIPPED = "passed", "assertion", "error", "skipped"
#: Slow to import, and no part of what is changed.
_SLOW = (
    "numba",
    "scipy.linalg",
    "scipy.signal",
    "hydro_model.simulation.simulate",
    "hydro_model.robot_files",
)
#: Far longer than any of the tests takes on a busy machine.
_PATIENCE_S = 900
#: Of a message that is kept.
_LONGEST = 200


class Judge:
    """A plugin of pytest that keeps how tests ended, the worst of a test's parameters.

    Attributes
    ----------
    ends : dict of str to (str, str)
        End and message by node, without parameters.
    broken : str
        Why a file of tests could not be collected.
    """

    def __init__(self) -> None:
        self.ends: dict[str, tuple[str, str]] = {}
        self.broken = ""

    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> None:
        """Note how a phase of a test ended; a failed set-up asserts nothing."""
        node = item.nodeid.partition("[")[0]
        known = self.ends.get(node, ("", ""))[0]
        if call.excinfo is None:
            if call.when == "call" and not known:
                self.ends[node] = PASSED, ""
            return
        kind = call.excinfo.type
        if call.when == "call" and issubclass(kind, AssertionError):
            end = ASSERTION
        else:
            end = SKIPPED if issubclass(kind, pytest.skip.Exception) else ERROR
        lines = str(call.excinfo.value).splitlines() or [""]
        if known != ERROR:
            self.ends[node] = end, f"{kind.__name__}: {lines[0]}"[:_LONGEST]

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note sources that cannot be imported."""
        if report.failed:
            self.broken = str(report.longrepr)[-_LONGEST:]


def judged(copy: str, root: str, tests: list[str], modules: list[str], out: str) -> None:
    """Run tests on a copy of the package, in a fork, and write the report.

    `root` is the folder of the sources.

    `modules` are those that must be of the copy.
    """
    signal.alarm(_PATIENCE_S)
    os.chdir(root)
    sys.path.insert(0, copy)
    os.environ["PYTHONPATH"] = os.pathsep.join([copy, os.environ.get("PYTHONPATH", "")])
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    judge = Judge()
    code = int(pytest.main(["-q", "--rootdir", root, *tests], plugins=[judge]))
    missing = ERROR, judge.broken or f"the test did not run (pytest's exit code {code})"
    report: dict[str, Any] = {
        "ends": {test: judge.ends.get(test, missing) for test in tests},
        "imported": {n: str(getattr(sys.modules.get(n), "__file__", "")) for n in modules},
    }
    Path(out).write_text(json.dumps(report), encoding="utf-8")


def main() -> int:
    """Answer jobs until standard input ends."""
    # This file's own folder: its neighbours are no modules of their own.
    sys.path.pop(0)
    for name in _SLOW:
        importlib.import_module(name)
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            try:
                judged(**json.loads(line))
            finally:
                os._exit(0)
        os.waitpid(pid, 0)
        print("done", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
