"""Memory that this process may still take, held against what is needed before it is taken."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from pathlib import Path

from hydro_ident.errors import BagError


def require(
    path: Path,
    needed: int,
    *,
    what: str = "a log",
    found: str = "one that takes up to",
    way_out: str = "convert it in parts",
) -> None:
    """See that there is memory enough.

    Parameters
    ----------
    path : Path
        For the message.
    needed : int
        Bytes beyond those that are taken already.
    what, found, way_out : str
        What was expected to fit, how sure its size is, and what else can be done.

    Raises
    ------
    BagError
        There is less.
    """
    free = available_bytes()
    if needed > free:
        raise BagError(
            f"{path}: expected {what} that fits into memory ({free / 1e9:.2f} GB are free), found"
            f" {found} {needed / 1e9:.2f} GB: {way_out}"
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
