"""A job of the benchmark: the same work done by us and by a peer, timed in turns."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any


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
        peer, the limit. Infinite where that share of the cycles was never answered.
    ratio, goal : float
        Theirs by ours, measured and wanted; 0 where ours is infinite.
    rounds : int or None
        Measurements that the medians are of; None in results of before they were written down.
    lost_ours, cycles_ours, lost_theirs, cycles_theirs : int or None
        Of jobs in cycles: how many were never answered, of how many, in all rounds.
    """

    job: str
    peer: str
    ours: float
    theirs: float
    ratio: float
    goal: float
    rounds: int | None = None
    lost_ours: int | None = None
    cycles_ours: int | None = None
    lost_theirs: int | None = None
    cycles_theirs: int | None = None

    @property
    def met(self) -> bool:
        """Whether the goal is met: what never came is late, whatever the peer's is."""
        return math.isfinite(self.ours) and self.ratio >= self.goal

    def as_json(self) -> dict[str, Any]:
        """The row as JSON can say it: null for what is infinite, nothing for what is not known."""
        return {
            key: None if isinstance(value, float) and math.isinf(value) else value
            for key, value in asdict(self).items()
            if value is not None
        }

    @classmethod
    def of_json(cls, found: Mapping[str, Any]) -> Row:
        """The row that `as_json` gave.

        Parameters
        ----------
        found : mapping
        """
        endless = {
            key: math.inf for key in ("ours", "theirs", "ratio") if found.get(key, 0.0) is None
        }
        return cls(**{**found, **endless})


def ratio_of(theirs: float, ours: float) -> float:
    """How many times ours fits into theirs; 0 where ours is infinite.

    Parameters
    ----------
    theirs, ours : float
    """
    return 0.0 if math.isinf(ours) else theirs / ours


def seconds_of(work: Callable[[], object]) -> float:
    """Wall time of doing it once, s.

    `work` is what is done.
    """
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def agree(holds: object, text: str) -> None:
    """What a check of two results says; unlike `assert`, whatever the interpreter leaves out.

    Parameters
    ----------
    holds : object
        True where they agree in something.
    text : str
        By what they differ.

    Raises
    ------
    AssertionError
        They do not.
    """
    if not holds:
        raise AssertionError(text)


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
    return Row(job.name, job.peer, ours, theirs, theirs / ours, job.goal, rounds)


def against_limit(
    name: str,
    limit: str,
    measured: float,
    allowed: float,
    goal: float = 1.0,
    *,
    rounds: int = 1,
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
    rounds : int
        Measurements that `measured` is the median of.
    """
    return Row(name, limit, measured, allowed, allowed / measured, goal, rounds)
