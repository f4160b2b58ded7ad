"""The fit of base parameters against figaroh: time in turns, memory in processes of their own."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import statistics
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from hydro_ident.bench.fit import (
    Task,
    compare,
    fit_ours,
    fit_theirs,
    load_task,
    make_task,
    save_task,
)
from hydro_ident.bench.job import Job, Row
from hydro_ident.estimate.statistics.moments import LAGS
from hydro_ident.study.peak import spent

SAMPLES = 100_000
_TIME_GOAL, _MEMORY_GOAL = 20.0, 10.0


def missing_peer() -> str:
    """Why figaroh cannot be measured; empty where it can."""
    for module in ("pinocchio", "figaroh"):
        if importlib.util.find_spec(module) is None:
            return f"base-parameter fit: {module} is not installed, skipped"
    return ""


def fit_jobs(samples: int = SAMPLES) -> Iterator[Job]:
    """The time, with intervals for white noise as the peer's, and for autocorrelated noise.

    `samples` are those of the recording.
    """
    task = make_task(samples)
    for noise, lags in (("white", 0), ("autocorrelated", LAGS)):
        yield Job(
            f"{_name(samples)} for {noise} noise",
            _peer(),
            _TIME_GOAL,
            partial(fit_ours, task, lags),
            partial(fit_theirs, task),
            partial(_check, task, lags),
        )


def _check(task: Task, lags: int) -> None:
    compare(fit_ours(task, lags), fit_theirs(task), lags)


def memory_row(folder: Path, rounds: int, samples: int = SAMPLES) -> Row:
    """Peak memory of both.

    Parameters
    ----------
    folder : Path
        For the data of a while.
    rounds : int
        Processes of each, in turns: the median counts.
    samples : int
        Of the recording.
    """
    path = folder / "fit.npz"
    save_task(path, make_task(samples))
    peaks = [
        [spent("hydro_ident.bench.fit_jobs", [way, str(path)]).peak_mb for way in _WAYS]
        for _ in range(rounds)
    ]
    ours, theirs = (statistics.median(found) for found in zip(*peaks, strict=True))
    path.unlink()
    name = f"{_name(samples)}: peak memory of the process, MiB"
    return Row(name, _peer(), ours, theirs, theirs / ours, _MEMORY_GOAL, rounds)


def _name(samples: int) -> str:
    return f"base-parameter fit, {samples} samples, 6 joints, friction, intervals"


def _peer() -> str:
    return f"figaroh {importlib.metadata.version('figaroh')} pipeline"


_WAYS: dict[str, Callable[..., object]] = {"ours": fit_ours, "theirs": fit_theirs}

if __name__ == "__main__":
    _WAYS[sys.argv[1]](load_task(Path(sys.argv[2])))
