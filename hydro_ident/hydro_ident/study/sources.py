"""Which sources a campaign's results are of, and which have changed since."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path


def digest(path: Path) -> str:
    """SHA-256 of a file: another with every edit of it.

    Parameters
    ----------
    path : Path
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def digests_of(root: Path, paths: Iterable[Path], left_out: Iterable[str]) -> dict[str, str]:
    """SHA-256 of sources by their paths from the repository's top.

    Parameters
    ----------
    root : Path
        That top.
    paths : iterable of Path
        Under it.
    left_out : iterable of str
        File names that do not count.
    """
    without = set(left_out)
    kept = sorted(path for path in paths if path.name not in without)
    return {path.relative_to(root).as_posix(): digest(path) for path in kept}


def differing(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Sources that are others than they were, are new, or are gone.

    Parameters
    ----------
    then, now : mapping of str to str
        As `digests_of`.
    """
    return sorted(path for path in {*then, *now} if then.get(path) != now.get(path))
