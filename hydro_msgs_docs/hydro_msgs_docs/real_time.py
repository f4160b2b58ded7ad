"""What a process does so that nothing of its own or of others stops its 500 Hz loops.

Garbage collection, scheduling, memory and cores. No ROS: the nodes declare `OPTIONS` as parameters
and say the warnings.
"""

from __future__ import annotations

import ctypes
import gc
import os
import re
import resource
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydro_msgs_docs.errors import ContractError
from hydro_msgs_docs.node_parameters import ParameterRule

#: Young containers that are collected once there are so many. A collection costs what it walks,
#: 12 ns for each: 4 us for these. One of everything took 40 ms, before `gc.freeze`.
_YOUNG = 300
#: More than so many at once (55 us) are frozen without a look, which takes 0.1 us for any number.
_BURST = 5000
#: An older generation is collected after so many collections of the next younger one, as gc does.
_TURNS = 10
#: After more processor time than this, a tenth of the period, what is left is frozen: walked once.
_COSTLY_NS = 200_000

# Of <sys/mman.h> and <linux/capability.h>.
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_CAP_IPC_LOCK = 14


class RealTimeError(ContractError):
    """A real-time option that cannot be read."""


#: Parameters that both nodes declare.
OPTIONS = (
    ParameterRule(
        "rt_priority",
        0,
        "",
        "SCHED_FIFO priority of the loop, the process's other threads one below; 0: not asked for",
        0,
        98,
    ),
    ParameterRule("lock_memory", False, "", "keep the process in memory (mlockall)"),
    ParameterRule(
        "cpu_affinity", "", "", "cores that the loop runs on, such as '2' or '2 4-5'; empty: any"
    ),
)


@dataclass(frozen=True, slots=True)
class RealTimeOptions:
    """The checked values of `OPTIONS`.

    Attributes
    ----------
    rt_priority : int
    lock_memory : bool
    cpu_affinity : tuple of int
        Cores; empty for any.
    """

    rt_priority: int = 0
    lock_memory: bool = False
    cpu_affinity: tuple[int, ...] = ()

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> RealTimeOptions:
        """From parameter values.

        Parameters
        ----------
        values : mapping
            With the names of `OPTIONS`, and others.

        Returns
        -------
        RealTimeOptions

        Raises
        ------
        RealTimeError
            `cpu_affinity` is no list of cores.
        """
        cores = cores_of(values["cpu_affinity"])
        return cls(int(values["rt_priority"]), bool(values["lock_memory"]), cores)


def cores_of(text: str) -> tuple[int, ...]:
    """Core numbers of a text such as '2 4-5' or '2,4-5', ascending.

    Parameters
    ----------
    text : str

    Returns
    -------
    tuple of int

    Raises
    ------
    RealTimeError
    """
    cores: set[int] = set()
    for word in text.replace(",", " ").split():
        match = re.fullmatch(r"(\d{1,4})(?:-(\d{1,4}))?", word)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if first > last:
            raise RealTimeError(
                f"parameter 'cpu_affinity' should be cores such as '2 4-5', found '{word}'"
            )
        cores.update(range(first, last + 1))
    return tuple(sorted(cores))


def as_others() -> None:
    """In a thread that takes seconds: be scheduled as other programs' are.

    A thread has its maker's priority. One that computes for seconds before all ordinary programs
    keeps them, and the threads of its own process that have that priority, from its core.
    """
    with suppress(OSError):  # nobody is refused less
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


class RealTime:
    """The measures of one process, from `prepare` to `leave`.

    Automatic garbage collection walks containers whenever enough were made, in whichever thread
    made the last one. Here what is alive at the start is frozen, automatic collection is off, and
    `idle` collects between cycles, a few microseconds at a time. So cycles of references that are
    dropped while running do not pile up.

    Parameters
    ----------
    options : RealTimeOptions
    warn : callable
        Told once of each thing that the system refused; the process goes on without it.

    Attributes
    ----------
    collections : int
        Garbage collections between cycles.
    """

    def __init__(self, options: RealTimeOptions, warn: Callable[[str], None]) -> None:
        self.options = options
        self.collections = 0
        self._warn = warn
        self._granted: list[str] = []
        self._refused: list[str] = []
        self._turns = [0, 0]
        self._automatic = True
        self._prepared = False

    def prepare(self) -> None:
        """Before the loops start: collect and freeze, lock memory, raise the other threads."""
        gc.collect()
        gc.freeze()
        if not self._prepared:
            self._automatic = gc.isenabled()
        gc.disable()
        self._prepared = True
        options = self.options
        if options.lock_memory:
            self._try("memory lock", "limits.d: memlock unlimited", _lock_memory)
        if options.rt_priority:
            self._fifo(max(options.rt_priority - 1, 1), _threads())

    def enter(self) -> None:
        """At the start of a loop, in its thread."""
        options = self.options
        if options.rt_priority:
            self._fifo(options.rt_priority, [0])
        if options.cpu_affinity:
            cores = options.cpu_affinity
            name = f"core {' '.join(map(str, cores))}"
            self._try(name, f"of {os.cpu_count()} cores", lambda: os.sched_setaffinity(0, cores))

    def idle(self) -> None:
        """After the work of a cycle: collect what is young where there is enough of it."""
        young = gc.get_count()[0]
        if young < _YOUNG or not self._prepared:
            return
        if young > _BURST:
            gc.freeze()
            return
        generation = self._due()
        begin = time.thread_time_ns()
        gc.collect(generation)
        if time.thread_time_ns() - begin > _COSTLY_NS:
            gc.freeze()
        self.collections += 1

    def _due(self) -> int:
        """Which generation it is the turn of, and count."""
        for i, count in enumerate(self._turns):
            if count < _TURNS:
                self._turns[i] += 1
                return i
            self._turns[i] = 0
        return 2

    def leave(self) -> None:
        """After the loops: garbage collection as before. Memory and priorities stay."""
        if not self._prepared:
            return
        self._prepared = False
        gc.unfreeze()
        if self._automatic:
            gc.enable()

    def values(self) -> dict[str, object]:
        """Keys and values for `/diagnostics`: `real_time`, `real_time_refused`, `gc_...`."""
        return {
            "real_time": "; ".join(self._granted) or "off",
            "real_time_refused": "; ".join(self._refused),
            "gc_collections": self.collections,
        }

    def _fifo(self, priority: int, threads: list[int]) -> None:
        def raise_all() -> None:
            for thread in threads:
                # One that ended since it was listed has no priority to raise.
                with suppress(ProcessLookupError):
                    os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))

        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        asked = self.options.rt_priority
        self._try(f"SCHED_FIFO {asked}", f"rtprio limit {limit}, limits.d: rtprio", raise_all)

    def _try(self, name: str, hint: str, change: Callable[[], None]) -> None:
        try:
            change()
        except OSError as error:
            if name not in self._refused:
                self._refused.append(name)
                self._warn(f"{name} refused, going on without: {error.strerror} ({hint})")
            return
        if name not in self._granted:
            self._granted.append(name)


def _threads() -> list[int]:
    """The process's threads, those of DDS among them: a sample comes through them."""
    return [int(path.name) for path in Path("/proc/self/task").iterdir()]


def _lock_memory() -> None:
    """Lock what is in memory, and the rest once it is touched.

    All at once would read in 300 MB of libraries that nobody uses. With a limit, memory that is
    asked for later could be refused in the middle of a run: then nothing is locked.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft != hard == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    elif hard != resource.RLIM_INFINITY and not _may_lock():
        raise OSError(0, f"memlock limit {hard >> 10} KiB")
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _may_lock() -> bool:
    """Whether the process has the capability that no limit holds for."""
    status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    found = re.search(r"^CapEff:\s*([0-9a-f]+)", status, re.M)
    return found is not None and bool(int(found[1], 16) >> _CAP_IPC_LOCK & 1)
