"""A job of the benchmark: the same work done by us and by a peer, timed in turns."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Job:
    """The same work done twice.

    Attributes
    ----------
    name, peer : str
    goal : float
        Wanted ratio of their time to ours.
    ours, theirs : callable
        Do the work once; results are stored as a user would store them.
    check : callable
        Runs both and raises AssertionError where their results do not agree; so it also compiles
        and warms up what there is.
    """

    name: str
    peer: str
    goal: float
    ours: Callable[[], object]
    theirs: Callable[[], object]
    check: Callable[[], None]


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the table.

    Attributes
    ----------
    job, peer : str
    ours, theirs : float
        Seconds, or the unit that the job's name ends in: medians of the rounds; with a limit as
        peer, the limit.
    ratio, goal : float
        Theirs by ours, measured and wanted.
    """

    job: str
    peer: str
    ours: float
    theirs: float
    ratio: float
    goal: float


def seconds_of(work: Callable[[], object]) -> float:
    """Wall time of doing it once, s."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def run(job: Job, rounds: int) -> Row:
    """Check that both agree, then time them in turns.

    Parameters
    ----------
    job : Job
    rounds : int

    Returns
    -------
    Row

    Raises
    ------
    AssertionError
        The results do not agree.
    """
    job.check()
    pairs = [(seconds_of(job.ours), seconds_of(job.theirs)) for _ in range(rounds)]
    ours, theirs = (statistics.median(times) for times in zip(*pairs, strict=True))
    return Row(job.name, job.peer, ours, theirs, theirs / ours, job.goal)


def against_limit(
    name: str, limit: str, measured: float, allowed: float, goal: float = 1.0
) -> Row:
    """A row for work that has no peer but a limit to keep.

    Parameters
    ----------
    name : str
        Of the job.
    limit : str
        In words.
    measured, allowed : float
        Seconds, or the unit that the name ends in.
    goal : float
        How many times below the limit is aimed at.
    """
    return Row(name, limit, measured, allowed, allowed / measured, goal)
