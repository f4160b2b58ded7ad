"""What nodes complained of in a recording, without what belongs to every run's start and end."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from hydro_ident.bag.diagnostics import Status
from hydro_msgs_docs.topics import IDLE, WAITING


def complaints_of(statuses: Sequence[Status]) -> list[str]:
    """Warnings and errors that nodes gave, each once.

    A node that was activated waits for the others and for a first sample or command, and waits
    once more when these have stopped before it: no complaint. One that waits between two times of
    work has lost something, and one that did nothing but wait never came to work.

    Parameters
    ----------
    statuses : sequence of Status
        In the order in which they were said.

    Returns
    -------
    list of str
        In the same order.
    """
    by_name: dict[str, list[Status]] = {}
    for status in statuses:
        by_name.setdefault(status.name, []).append(status)
    normal = {id(status) for own in by_name.values() for status in _normal_waits(own)}
    said = (
        f"{status.name}: {status.message} ({status.level})"
        for status in statuses
        if status.level != "ok" and id(status) not in normal
    )
    return list(dict.fromkeys(said))


def _normal_waits(statuses: Iterable[Status]) -> list[Status]:
    """The waiting of one node that has work on one side only, activation by activation.

    With what it said while it was not active.
    """
    found: list[Status] = []
    for idle, activation in groupby(statuses, key=lambda s: s.message.startswith(IDLE)):
        said = list(activation)
        if idle:
            found += said
            continue
        worked = [k for k, s in enumerate(said) if not s.message.startswith(WAITING)]
        if worked:
            found += said[: worked[0]] + said[worked[-1] + 1 :]
    return found
