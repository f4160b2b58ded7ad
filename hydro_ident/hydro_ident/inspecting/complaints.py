"""What nodes complained of in a recording, without what belongs to every run's start and end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from hydro_ident.bag.diagnostics import Status
from hydro_msgs_docs.topics import IDLE, WAITING


@dataclass(slots=True)
class _Node:
    """One node in the activation that goes on: what may still be a complaint, and since when."""

    worked: bool = False
    waits: dict[str, int] = field(default_factory=dict)


@dataclass(slots=True)
class Complaints:
    """Warnings and errors that nodes gave, collected while a recording is read.

    A node that was activated waits for the others and for a first sample or command, and waits
    once more when these have stopped before it: no complaint. One that waits between two times of
    work has lost something, and one that did nothing but wait never came to work.
    """

    _said: dict[str, int] = field(default_factory=dict)
    _nodes: dict[str, _Node] = field(default_factory=dict)
    _met: int = 0

    def add(self, statuses: Sequence[Status]) -> None:
        """Take in the next statuses.

        Parameters
        ----------
        statuses : sequence of Status
            In the order in which they were said.
        """
        for status in statuses:
            self._add(status)
            self._met += 1

    def _add(self, status: Status) -> None:
        node = self._nodes.setdefault(status.name, _Node())
        if status.message.startswith(IDLE):
            self._end(node)
            self._nodes[status.name] = _Node()
            return
        waits = status.message.startswith(WAITING)
        if not waits:
            # Waiting before the first work is normal, between two times of it not.
            if node.worked:
                self._end(node, worked=False)
            node.worked, node.waits = True, {}
        if status.level != "ok":
            text = f"{status.name}: {status.message} ({status.level})"
            (node.waits if waits else self._said).setdefault(text, self._met)

    def _end(self, node: _Node, worked: bool | None = None) -> None:
        """What waited to be told is a complaint unless the node worked before."""
        if not (node.worked if worked is None else worked):
            for text, at in node.waits.items():
                self._said[text] = min(at, self._said.get(text, at))

    def told(self) -> list[str]:
        """The complaints of all that was said, each once, in the order of their first times."""
        for node in self._nodes.values():
            self._end(node)
        return sorted(self._said, key=lambda text: self._said[text])
