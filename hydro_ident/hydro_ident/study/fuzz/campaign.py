"""Fuzzing for as long as is asked: every loader in turn, each run a seed that can be repeated."""

from __future__ import annotations

import resource
import shutil
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from hydro_ident.study.fuzz.corpus import files, named, seeds
from hydro_ident.study.fuzz.edits import edited
from hydro_ident.study.fuzz.targets import TARGETS, Target, outcome

#: Processor time that a file may take, and memory that reading may need beside the program.
LIMIT_S = 20.0
LIMIT_BYTES = 2 << 30
_MOST_EDITS = 6


class TooLongError(Exception):
    """A loader that did not come to an end."""


@dataclass(slots=True)
class Tally:
    """What became of a target's files.

    Attributes
    ----------
    read, refused : int
    findings : list of dict
        Run, kind of exception and its place: none is the aim.
    slowest_s : float
        Processor time of the slowest file.
    """

    read: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    findings: list[dict[str, Any]] = field(default_factory=list)


@contextmanager
def time_limit(seconds: float = LIMIT_S) -> Iterator[None]:
    """Raise TooLongError once the process has used so much processor time.

    `seconds` is how much it may use.
    """

    def end(_number: int, _frame: FrameType | None) -> None:
        raise TooLongError(f"more than {seconds:g} s of processor time")

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def prepare(target: Target, work: Path, corpus: Path) -> Path:
    """The file that a target is to read, in a folder with what surrounds it; not yet written.

    `corpus` is the folder of files to start from.
    """
    folder = work / target.name
    folder.mkdir(parents=True, exist_ok=True)
    if target.name == "bag_metadata":
        shutil.copy(files(named("bag"), corpus)[0], folder / "beside.mcap")
    return folder / f"case{target.suffix}"


def case(target: Target, own: list[bytes], run: int) -> bytes:
    """The file of a run: a seed with one to six edits.

    Parameters
    ----------
    target : Target
    own : list of bytes
        Of `seeds`.
    run : int
        The same run gives the same file.

    Returns
    -------
    bytes
    """
    rng = np.random.default_rng([run, *target.name.encode()])
    first, second = rng.integers(len(own), size=2)
    # One edit mostly: two of them seldom get past the first check.
    count = 1 if rng.random() < 0.6 else int(rng.integers(2, _MOST_EDITS + 1))
    edits = rng.integers(1 << 31, size=(count, 3)).tolist()
    return edited(own[first], [(a, b, c) for a, b, c in edits], own[second])


def campaign(
    corpus: Path,
    seconds: float,
    *,
    first_run: int = 0,
    keep: Path | None = None,
    say: Callable[[str], object] = print,
) -> dict[str, Any]:
    """Fuzz every target in turn.

    Parameters
    ----------
    corpus : Path
        Folder with a folder per target.
    seconds : float
        Wall time.
    first_run : int
        Another one gives other files.
    keep : Path, optional
        Where files go that something was found with.
    say : callable
        Takes a line for each finding.

    Returns
    -------
    dict
        Tallies per target, runs, seconds, peak memory.
    """
    limit_memory()
    tallies = {target.name: Tally() for target in TARGETS}
    own = {target.name: seeds(target, corpus) for target in TARGETS}
    began_s, run = time.monotonic(), first_run
    with tempfile.TemporaryDirectory() as work:
        paths = {target.name: prepare(target, Path(work), corpus) for target in TARGETS}
        while time.monotonic() - began_s < seconds:
            for target in TARGETS:
                data = case(target, own[target.name], run)
                paths[target.name].write_bytes(data)
                finding = _try(target, paths[target.name], tallies[target.name])
                if finding is not None:
                    finding["run"] = run
                    say(f"{target.name}: run {run}: {finding['kind']}: {finding['text']}")
                    _keep(keep, target, run, data)
            run += 1
    return {
        "first_run": first_run,
        "runs": run - first_run,
        "seconds": round(time.monotonic() - began_s, 1),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "targets": {name: asdict(tally) for name, tally in tallies.items()},
    }


def _try(target: Target, path: Path, tally: Tally) -> dict[str, Any] | None:
    began_s = time.process_time()
    try:
        with time_limit(), warnings.catch_warnings():
            warnings.simplefilter("error")
            refused = outcome(target, path)
    except Exception as error:  # noqa: BLE001 - whatever a loader lets out is what is looked for
        place = traceback.extract_tb(error.__traceback__)[-1]
        finding = {
            "kind": type(error).__name__,
            "text": " ".join(str(error).split())[:200],
            "place": f"{Path(place.filename).name}:{place.name}",
        }
        tally.findings.append(finding)
        return finding
    finally:
        tally.slowest_s = round(max(tally.slowest_s, time.process_time() - began_s), 2)
    tally.refused += bool(refused)
    tally.read += not refused
    return None


def _keep(folder: Path | None, target: Target, run: int, data: bytes) -> None:
    if folder is not None:
        place = folder / target.name
        place.mkdir(parents=True, exist_ok=True)
        (place / f"run{run}{target.suffix}").write_bytes(data)


def limit_memory() -> None:
    """An end to what the process may map: what is there now and `LIMIT_BYTES`."""
    with open("/proc/self/statm", encoding="ascii") as stream:
        mapped = int(stream.read().split()[0]) * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (mapped + LIMIT_BYTES, hard))
