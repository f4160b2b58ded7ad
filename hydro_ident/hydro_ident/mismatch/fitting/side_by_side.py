"""Work on several things at once, on several cores: the same results as one after the other.

Processes are forked, so that each sees all rows and columns without a copy of them. Only results
travel: they should be numbers and laws, no rows by columns.
"""

from __future__ import annotations

import ctypes
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from multiprocessing import active_children, get_context
from multiprocessing.reduction import ForkingPickler
from typing import Any, TypeVar

from hydro_ident.errors import IdentError
from hydro_model.effects.catalogue import CATALOGUE
from hydro_model.effects.effect import Effect
from hydro_model.effects.law import ParameterSpec

T = TypeVar("T")
R = TypeVar("R")

#: More processes need more memory than what they still gain is worth.
_MOST = 4

#: Of prctl(2): the signal that a process gets when the one that forked it has ended.
_PR_SET_PDEATHSIG = 1

#: What a forked process works on, and the things themselves.
_given: tuple[Callable[[Any], Any], Sequence[Any]] | None = None


def _effect(name: str, at: int, parameters: tuple[ParameterSpec, ...] | None) -> Effect:
    form = CATALOGUE[name].forms[at]
    return form if parameters is None else replace(form, parameters=parameters)


def _reduced(one: Effect) -> tuple[Callable[..., Effect], tuple[Any, ...]]:
    """A form of the catalogue, with the ranges that a recording gives its parameters."""
    for at, form in enumerate(CATALOGUE[one.name].forms):
        if form is one:
            return _effect, (one.name, at, None)
        if replace(form, parameters=one.parameters) == one:
            return _effect, (one.name, at, one.parameters)
    raise IdentError(f"expected a form of the catalogue's {one.name}, found another")


# An effect of the catalogue is that one also for whom a result is sent: laws are compared as such.
ForkingPickler.register(Effect, _reduced)


def cores() -> int:
    """How many processes are worth it here: as many as there are cores to run on, at most 4."""
    return min(len(os.sched_getaffinity(0)), _MOST)


def side_by_side(work: Callable[[T], R], things: Sequence[T], processes: int) -> list[R]:
    """Results in the order of the things.

    Parameters
    ----------
    work : callable
        Of one thing; what it changes elsewhere is lost.
    things : sequence
    processes : int
        At most so many; with 1 all is done here.

    Raises
    ------
    IdentError
        A process ended before its work was done, as where memory is short.
    """
    count, others = min(processes, len(things)), set(active_children())
    if count < 2:
        return [work(one) for one in things]
    given = os.getpid(), work, things
    pool = ProcessPoolExecutor(count, get_context("fork"), _begin, given)
    try:
        begun = _begun(pool, things)
        done, _ = wait(begun, return_when=FIRST_EXCEPTION)
        return [one.result() for one in begun if one in done]
    except BaseException as error:
        # Nobody wants what the others are at.
        for one in set(active_children()) - others:
            one.terminate()
        if isinstance(error, BrokenProcessPool):
            raise IdentError(_short_of(f"one of {count} processes ended early")) from error
        raise
    finally:
        pool.shutdown()


def _begun(pool: ProcessPoolExecutor, things: Sequence[Any]) -> list[Future[Any]]:
    """Results to come; all processes are forked here."""
    try:
        return [pool.submit(_one, at) for at in range(len(things))]
    except OSError as error:
        raise IdentError(_short_of(f"a further process cannot be had ({error})")) from error


def _short_of(what: str) -> str:
    return f"{what}, as where memory is short: --processes 1 takes least of it"


def _begin(parent: int, work: Callable[[Any], Any], things: Sequence[Any]) -> None:
    """In a process that was forked: it ends at once, and quietly, with the one that did."""
    global _given
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)
    _given = work, things


def _one(at: int) -> Any:
    if _given is None:
        raise IdentError("expected something to work on, found nothing")
    work, things = _given
    return work(things[at])
