"""Loads the built packages before any test, and deals the tests out to pytest-xdist's workers.

With import-mode=importlib pytest names a test after its path (`hydro_ident.test.test_x`) and makes
the missing parents itself: a package's folder would then stand for the package of the same name.

`colcon test` runs a package with what its `package.xml` names: of the workspace it sees what it
depends on, and there is no xdist, clarabel or plotly. What needs one of the latter two is marked.
"""

from __future__ import annotations

import fcntl
import gc
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

#: rosdep has no key for these. A test of a package that needs one is marked `needs` and skipped
#: where it is not installed; from all others they are hidden, so that none needs one unsaid.
_WITHOUT_KEY = ("clarabel", "plotly")
_ROOT = Path(__file__).resolve().parent
#: What a file says whose tests start processes on buses.
_MARKED = re.compile(r"pytest\.mark\.(ros|processes)\b")
#: What a file says that is long by itself.
_LONG = re.compile(r"pytest\.mark\.long\b")
#: What all other tests add to their niceness, so that processes run in time beside them: several
#: together weigh less than a tenth of a process.
_NICER = 15


def _my_turn() -> int | None:
    """Wait until one worker has collected the tests; what the first of them holds while it does.

    Whatever is imported for the first time is compiled by that one alone, as it is kept for all.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return None
    descriptor = os.open(__file__, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        fcntl.flock(descriptor, fcntl.LOCK_SH)
    return descriptor


_turn = _my_turn()

for _package in ("hydro_control", "hydro_hw_bridge", "hydro_ident", "hydro_msgs_docs"):
    _found = find_spec(_package)
    # A folder of that name alone has no origin.
    if _found is not None and _found.origin is not None:
        import_module(_package)

if find_spec("hypothesis") is not None:
    from hypothesis import settings

    # An example that has to wait for its processor is no failure.
    settings.register_profile("hydro", deadline=None)
    settings.load_profile("hydro")


@cache
def _says(file: Path, mark: re.Pattern[str]) -> bool:
    return mark.search(file.read_text(encoding="utf-8")) is not None


def _has_processes(file: Path) -> bool:
    return _says(file, _MARKED)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """Keep files with processes together, unless another way was chosen on the command line."""
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        """A file goes to one worker, and all files with processes go to the same.

        Told by the files' text: xdist's own groups stand in the tests' names, which newer pytest
        keeps (https://github.com/pytest-dev/pytest-xdist/issues/1386).
        """

        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return "processes" if _has_processes(self.config.rootpath / file) else file

    return Scheduling(config, log)


def _needed(item: pytest.Item) -> set[str]:
    return {name for mark in item.iter_markers("needs") for name in mark.args}


@contextmanager
def _hidden(packages: set[str]) -> Iterator[None]:
    """Make packages ones that are not installed, with all that was loaded of them."""
    # Among thousands, before each test: a split of every name takes five times as long.
    below = tuple(f"{name}." for name in packages)
    loaded = {
        name: module
        for name, module in sys.modules.items()
        if name in packages or name.startswith(below)
    }
    sys.modules.update(dict.fromkeys({*packages, *loaded}))  # type: ignore[arg-type]
    try:
        yield
    finally:
        for name in {*packages, *loaded}:
            sys.modules.pop(name, None)
        sys.modules.update(loaded)


@pytest.hookimpl(hookwrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Hide what a package's test does not say that it needs; those in `tests/` may use all."""
    of_package = not item.path.is_relative_to(_ROOT / "tests")
    with _hidden(set(_WITHOUT_KEY) - _needed(item) if of_package else set()):
        yield


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that says that it needs what is not installed."""
    for name in sorted(_needed(item)):
        if find_spec(name) is None:
            pytest.skip(f"{name} is not installed (rosdep has no key for it): pip install {name}")


def pytest_collection_finish() -> None:
    """Let the other workers collect."""
    global _turn
    if _turn is not None:
        os.close(_turn)
        _turn = None


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

    def pytest_collection_finish(self) -> None:
        """Keep garbage collection from walking through all modules and tests again and again."""
        gc.collect()
        gc.freeze()

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


@pytest.fixture
def full_pipe() -> Iterator[int]:
    """The end to write to of a pipe that is full, and that nobody reads."""
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, True)
    yield writing
    os.close(writing)
    os.close(reading)
