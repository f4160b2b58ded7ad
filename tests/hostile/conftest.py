"""Reads files in a process of its own, of which memory and processor time have an end."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

READER = """
import json, resource, sys
from pathlib import Path
from hydro_ident.logs.file import read_log
from hydro_ident.bag.reader import read_bag
from hydro_ident.study.fuzz.campaign import limit_memory, time_limit
from hydro_ident.study.fuzz.corpus import named
from hydro_ident.study.fuzz.targets import Target, outcome
mat = Target("mat", ".mat", read_log)
limit_memory()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for line in sys.stdin:
    name, path = json.loads(line)
    path, notes = Path(path), []
    with time_limit(60.0):
        said = outcome(mat if name == "mat" else named(name), path)
        if name.startswith("bag") and not said:
            notes = list(read_bag(path if name == "bag" else path.parent / "bag").losses)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(json.dumps({"said": said, "grown_mb": grown / 1024, "notes": notes}), flush=True)
"""
#: Reads (path, target): what was said, and the notes beside a bag.
Read = Callable[[Path, str], str]


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Read]:
    """A process with an end to its memory and time that reads one file after another."""
    errors = tmp_path_factory.mktemp("reader") / "errors.txt"
    with open(errors, "w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-W", "error::RuntimeWarning", "-c", READER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=stream,
            text=True,
        )

    def ask(path: Path, target: str) -> str:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps([target, str(path)]) + "\n")
        process.stdin.flush()
        answer = process.stdout.readline()
        assert answer, errors.read_text()[-2000:]
        found = json.loads(answer)
        assert found["grown_mb"] < 700.0
        return " | ".join([found["said"], *found["notes"]])

    yield ask
    process.kill()
    process.wait()
    assert errors.read_text() == ""
