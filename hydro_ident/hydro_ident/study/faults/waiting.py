"""How long threads were ready to run and had no core, as the kernel counts it."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path

from hydro_ident.errors import IdentError

#: Kernel's counts of a thread: time on a core, time on a run queue, both ns, and time slices.
COUNTS = "schedstat"


def threads_waited_ns(process: int, without: int = 0) -> dict[int, int]:
    """Time that each thread of a process has waited on a run queue since it began, ns.

    What a thread sleeps, is stopped for, or stands still for with the whole (virtual) machine is
    no part of it.

    Parameters
    ----------
    process : int
    without : int
        A thread that does not count.

    Returns
    -------
    dict from thread to ns
        Empty where the process is gone.
    """
    found = {}
    # Threads end, and processes are killed, while they are looked at.
    gone = (FileNotFoundError, ProcessLookupError)
    with contextlib.suppress(*gone):
        for thread in Path(f"/proc/{process}/task").iterdir():
            if int(thread.name) != without:
                with contextlib.suppress(*gone):
                    text = (thread / COUNTS).read_text(encoding="ascii")
                    found[int(thread.name)] = int(text.split()[1])
    return found


def longest_wait_ms(before: Mapping[int, int], now: Mapping[int, int]) -> float:
    """The wait of that thread of a process that waited longest in between, ms.

    Parameters
    ----------
    before, now : mapping of int to int
        `threads_waited_ns`; a thread that is new began with none.
    """
    waits = (ns - before.get(thread, 0) for thread, ns in now.items())
    return 1e-6 * max(waits, default=0)


def check_counted(process: int) -> None:
    """Refuse a kernel that does not count.

    Parameters
    ----------
    process : int
        One that runs.

    Raises
    ------
    IdentError
        It has no counts.
    """
    if not threads_waited_ns(process):
        raise IdentError(
            f"expected the kernel's counts of waiting in /proc/{process}/task/*/{COUNTS}, found"
            " none: the campaign needs Linux with CONFIG_SCHED_INFO"
        )
