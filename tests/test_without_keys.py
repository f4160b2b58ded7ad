"""Tests run with what `package.xml` names: no xdist, no package beside, and nothing without a key.

Names in `sys.modules` that stand for nothing are modules that are not installed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Starts pytest where some modules are not installed: their names, then its arguments.
WITHOUT = """
import sys
sys.modules.update(dict.fromkeys(sys.argv[1].split(",")))
import pytest
sys.exit(pytest.main(sys.argv[2:]))
"""
#: What a machine has not that has run `rosdep install`.
NOT_NAMED = (
    "xdist",
    "execnet",
    "clarabel",
    "plotly",
    "distributed",
    "h5py",
    "pyarrow",
    "ruff",
    "mypy",
)
FILE = """
import sys
from importlib.util import find_spec
import pytest

@pytest.mark.needs("clarabel")
def test_needs_one():
    import clarabel
    assert find_spec("plotly") is None

def test_needs_none():
    with pytest.raises(ImportError):
        import clarabel
    with pytest.raises(ImportError):
        from plotly.offline import get_plotlyjs

@pytest.mark.needs("clarabel", "plotly")
def test_needs_both():
    import clarabel
    from plotly.offline import get_plotlyjs
"""


def run(without: tuple[str, ...], *arguments: object) -> subprocess.CompletedProcess[str]:
    """What pytest says of some tests, in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", WITHOUT, ",".join(without), "-rA", *map(str, arguments)],
        env={**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )


def outcomes(said: str) -> dict[str, str]:
    return {name: how for how, name in re.findall(r"^(PASSED|FAILED) \S+::(\w+)", said, re.M)}


def laid(folder: Path, below: str) -> Path:
    """A file of tests below a copy of the repository's settings."""
    for name in ("conftest.py", "pyproject.toml"):
        shutil.copy(ROOT / name, folder)
    file = folder / below / "test_some.py"
    file.parent.mkdir(parents=True)
    file.write_text(FILE, encoding="utf-8")
    return file


def test_a_packages_tests_run_on_what_it_depends_on() -> None:
    # As `colcon test` does: packages that it does not depend on need not be built.
    others = ("hydro_hw_bridge", "hydro_control", "hydro_ident")
    done = run((*NOT_NAMED, *others), ROOT / "hydro_msgs_docs/test/test_real_time.py")
    assert done.returncode == 0, done.stdout + done.stderr
    assert set(outcomes(done.stdout).values()) == {"PASSED"}


def test_a_test_that_needs_what_is_not_there_is_skipped_and_says_why(tmp_path: Path) -> None:
    done = run(NOT_NAMED, laid(tmp_path, "hydro_some/test"))
    assert done.returncode == 0, done.stdout + done.stderr
    assert outcomes(done.stdout) == {"test_needs_none": "PASSED"}
    skips = re.findall(r"^SKIPPED \[(\d)\] \S+:\d+: (.*)$", done.stdout, re.M)
    assert skips == [
        ("2", "clarabel is not installed (rosdep has no key for it): pip install clarabel")
    ]


def test_what_a_packages_test_does_not_say_that_it_needs_is_hidden(tmp_path: Path) -> None:
    done = run((), laid(tmp_path, "hydro_some/test"))
    assert done.returncode == 0, done.stdout + done.stderr
    assert set(outcomes(done.stdout).values()) == {"PASSED"}


def test_tests_over_several_packages_see_all(tmp_path: Path) -> None:
    done = run((), laid(tmp_path, "tests"))
    assert outcomes(done.stdout) == {
        "test_needs_one": "FAILED",
        "test_needs_none": "FAILED",
        "test_needs_both": "PASSED",
    }
