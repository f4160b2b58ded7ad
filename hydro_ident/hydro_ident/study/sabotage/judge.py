"""Runs one test in a process of its own and writes down how it ended, and whose sources it ran.

`python -m hydro_ident.study.sabotage.judge TEST OUT MODULE...`
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

PASSED, ASSERTION, ERROR, SKIPPED = "passed", "assertion", "error", "skipped"
#: The better a message is known, the less of it is needed.
_LONGEST = 200


class Judge:
    """A plugin of pytest that keeps the worst end of any test that ran.

    Attributes
    ----------
    ran : int
        Tests that were called.
    end, message : str
    """

    def __init__(self) -> None:
        self.ran, self.end, self.message = 0, PASSED, ""

    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> None:
        """Note how a phase of a test ended; a failed set-up asserts nothing."""
        del item
        self.ran += call.when == "call"
        if call.excinfo is None or self.end == ERROR:
            return
        kind = call.excinfo.type
        if call.when == "call" and issubclass(kind, AssertionError):
            self.end = ASSERTION
        elif issubclass(kind, pytest.skip.Exception):
            self.end = SKIPPED
        else:
            self.end = ERROR
        lines = str(call.excinfo.value).splitlines() or [""]
        self.message = f"{kind.__name__}: {lines[0]}"[:_LONGEST]

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note sources that cannot be imported."""
        if report.failed:
            self.end, self.message = ERROR, str(report.longrepr)[-_LONGEST:]


def main(arguments: Sequence[str]) -> int:
    """Run the test and write the report."""
    test, out, *modules = arguments
    judge = Judge()
    code = pytest.main(["-q", test], plugins=[judge])
    if not judge.ran and judge.end == PASSED:
        judge.end, judge.message = ERROR, f"no test ran (exit code {int(code)} of pytest)"
    files = {name: str(getattr(sys.modules.get(name), "__file__", "")) for name in modules}
    report = {"end": judge.end, "message": judge.message, "tests": judge.ran, "imported": files}
    Path(out).write_text(json.dumps(report), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
