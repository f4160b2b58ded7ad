"""Memory that reading a log takes, held against what there is before it is taken."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hydro_ident.errors import BagError

#: What a text log takes at most: for each byte (raw, decoded, in lines), cell and line. Measured
#: at the readers of this package; logs of long lines take about half of it.
_PER_BYTE, _PER_CELL, _PER_LINE = 4, 72, 450
_MARKS = (b",", b";", b"\t")
_LINE_ENDS = (b"\n", b"\r")


@dataclass(slots=True)
class TextSize:
    """How large a text log is, counted piece by piece.

    Attributes
    ----------
    count, cells, lines : int
        Bytes, and at most so many cells and lines.
    """

    count: int = 0
    cells: int = 0
    lines: int = 0

    def add(self, piece: bytes) -> None:
        """Count a piece.

        Parameters
        ----------
        piece : bytes
        """
        ends = sum(piece.count(mark) for mark in _LINE_ENDS)
        self.count += len(piece)
        self.lines += ends
        self.cells += ends + sum(piece.count(mark) for mark in _MARKS)

    @property
    def needed(self) -> int:
        """Memory to read it, bytes."""
        return _PER_BYTE * self.count + _PER_CELL * self.cells + _PER_LINE * self.lines


def read_text(path: Path) -> bytes:
    """A text file, once it is known to fit into memory as a table.

    Parameters
    ----------
    path : Path

    Raises
    ------
    BagError
        It does not fit.
    OSError
    """
    if path.stat().st_size * (_PER_BYTE + _PER_CELL + _PER_LINE) > available_bytes():
        size = TextSize()
        with open(path, "rb") as stream:
            while piece := stream.read(1 << 20):
                size.add(piece)
        require(path, size.needed)
    return path.read_bytes()


def require(path: Path, needed: int) -> None:
    """See that there is memory enough.

    Parameters
    ----------
    path : Path
        For the message.
    needed : int
        Bytes.

    Raises
    ------
    BagError
        There is less.
    """
    free = available_bytes()
    if needed > free:
        raise BagError(
            f"{path}: expected a log that fits into memory ({free / 1e9:.2f} GB are free), found"
            f" one that takes up to {needed / 1e9:.2f} GB: convert it in parts"
        )


def available_bytes() -> int:
    """Memory that this process may still take: the least of what the computer has free, of its
    own limit and of its control group's.

    Returns
    -------
    int
        Bytes; very many where nothing is known.
    """
    return max(0, min(_limits(), default=1 << 62))


def _limits() -> Iterator[int]:
    for line in _lines(Path("/proc/meminfo")):
        if line.startswith("MemAvailable:"):
            yield 1024 * int(line.split()[1])
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    for line in _lines(Path("/proc/self/statm")):
        if most != resource.RLIM_INFINITY:
            yield most - int(line.split()[0]) * os.sysconf("SC_PAGESIZE")
    group = Path("/sys/fs/cgroup")
    for most_text in _lines(group / "memory.max"):
        for used_text in _lines(group / "memory.current"):
            if most_text.strip().isdigit():
                yield int(most_text) - int(used_text)


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="ascii").splitlines()
    except OSError:
        return []
