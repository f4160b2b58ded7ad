"""Loads the built packages before any test, and deals the tests out to pytest-xdist's workers.

With import-mode=importlib pytest names a test after its path (`hydro_ident.test.test_x`) and makes
the missing parents itself: a package's folder would then stand for the package of the same name.
"""

from __future__ import annotations

import fcntl
import os
import re
import sys
from functools import cache
from pathlib import Path

import hypothesis
import pytest
from xdist.scheduler import LoadFileScheduling

import hydro_control
import hydro_hw_bridge
import hydro_ident
import hydro_msgs_docs

__all__ = ["hydro_control", "hydro_hw_bridge", "hydro_ident", "hydro_msgs_docs"]

#: What a file says whose tests start processes on buses.
_MARKED = re.compile(r"pytest\.mark\.(ros|processes)\b")
#: What a file says that is long by itself.
_LONG = re.compile(r"pytest\.mark\.long\b")
#: What all other tests add to their niceness, so that processes run in time beside them: several
#: together weigh less than a tenth of a process.
_NICER = 15

# An example that has to wait for its processor is no failure.
hypothesis.settings.register_profile("hydro", deadline=None)
hypothesis.settings.load_profile("hydro")


@cache
def _says(file: Path, mark: re.Pattern[str]) -> bool:
    return mark.search(file.read_text(encoding="utf-8")) is not None


def _has_processes(file: Path) -> bool:
    return _says(file, _MARKED)


class _Scheduling(LoadFileScheduling):
    """A file goes to one worker, and all files with processes go to the same.

    Told by the files' text: xdist's own groups stand in the tests' names, which newer pytest keeps
    (https://github.com/pytest-dev/pytest-xdist/issues/1386).
    """

    def _split_scope(self, nodeid: str) -> str:
        file = super()._split_scope(nodeid)
        return "processes" if _has_processes(self.config.rootpath / file) else file


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """Keep files with processes together, unless another way was chosen on the command line."""
    return _Scheduling(config, log) if config.getoption("dist") == "loadfile" else None


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """Wait for what holds a lock on the file that `scripts/test.sh` names: it compiles kernels."""
    if name := os.environ.get("HYDRO_TESTS_WAIT_FOR"):
        with open(name, encoding="utf-8") as held:
            fcntl.flock(held, fcntl.LOCK_SH)


class _Worker:
    """What a worker does that is not alone."""

    def __init__(self) -> None:
        self.lowered = False

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Files with processes first: they take long, and one after another.

        Then long ones, that no worker is left with one when the others are done.
        """
        items.sort(key=lambda item: (not _has_processes(item.path), not _says(item.path, _LONG)))

    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """Lower the priority at the first test without processes, once for all."""
        if not (self.lowered or _has_processes(item.path)):
            os.nice(_NICER)
            self.lowered = True


def pytest_configure(config: pytest.Config) -> None:
    """Register what workers do."""
    if hasattr(config, "workerinput"):
        config.pluginmanager.register(_Worker())


#: Runs a command that may neither ask for real-time priorities nor lock memory, whoever starts it.
_WITHOUT_RIGHTS = """
import ctypes, os, resource, sys
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
PR_CAPBSET_DROP, CAP_IPC_LOCK, CAP_SYS_NICE = 24, 14, 23
for capability in (CAP_IPC_LOCK, CAP_SYS_NICE):
    ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, capability, 0, 0, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""


@pytest.fixture
def without_rights() -> list[str]:
    """To stand before a command."""
    return [sys.executable, "-c", _WITHOUT_RIGHTS]
