"""Where a result comes from: hashes of everything that was read for it."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from hydro_ident.errors import IdentError
from hydro_ident.identify.results import Provenance
from hydro_model.robot import Robot

#: Files of fewer bytes may be begun alone: header and definitions, which recordings have alike.
_BEGUN = 1 << 13
_VERIFYING = "validation bags of which nothing is learnt"


def provenance(
    command: str,
    name: str,
    bags: Mapping[str, Path],
    validation: Mapping[str, Path],
    robot: Robot | None = None,
    compared: Robot | None = None,
) -> Provenance:
    """Provenance of a run: hashes its bags and the files of its robots.

    Parameters
    ----------
    command : str
    name : str
        The robot, as given.
    bags : mapping of str to Path
        By name.
    validation : mapping of str to Path
        Bags that predictions were scored on.
    robot : Robot, optional
        The one that was read.
    compared : Robot, optional
        The earlier model of `--compare`.

    Returns
    -------
    Provenance

    Raises
    ------
    IdentError
        A file cannot be read, or a bag or a file of it is given twice under other paths: to learn
        from, to verify on, or one for each.
    """
    try:
        version = metadata.version("hydro_ident")
    except metadata.PackageNotFoundError:
        version = "unknown"
    learnt, scored = ({n: _hashed(p) for n, p in given.items()} for given in (bags, validation))
    _refuse_twice(learnt, scored)
    hashes = [{n: one.whole for n, one in given.items()} for given in (learnt, scored)]
    files = [{path.name: _sha256([path], path) for path in files_of(r)} for r in (robot, compared)]
    return Provenance(command, version, name, *hashes, *files)


def files_of(robot: Robot | None) -> list[Path]:
    """What a robot was read from: hydraulics or model, then its URDF; nothing of no robot."""
    if robot is None:
        return []
    return [path for path in (robot.source, robot.urdf) if path is not None]


def bag_sha256(path: Path) -> str:
    """SHA-256 over the MCAP files of a bag in name order, or over a bare file."""
    return _hashed(path).whole


@dataclass(frozen=True, slots=True)
class _Hashed:
    """SHA-256 of a bag, and of all that no other recording has as well."""

    whole: str
    files: frozenset[str]


def _hashed(path: Path) -> _Hashed:
    files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
    whole = _sha256(files, path)
    large = [file for file in files if file.stat().st_size >= _BEGUN]
    parts = [] if len(files) == 1 else [_sha256([file], path) for file in large]
    return _Hashed(whole, frozenset({whole, *parts}))


def _refuse_twice(learnt: Mapping[str, _Hashed], scored: Mapping[str, _Hashed]) -> None:
    """A copy of a bag, or a file out of it, verifies nothing learnt from it and adds nothing."""
    pairs = itertools.combinations((*learnt.items(), *scored.items()), 2)
    for (other, before), (name, one) in pairs:
        if one.files & before.files:
            alike = (name in learnt) == (other in learnt)
            wanted = "each recording once" if alike else _VERIFYING
            raise IdentError(
                f"expected {wanted}, found files of '{name}' in '{other}', too (the same SHA-256)"
            )


def _sha256(files: Sequence[Path], named: Path) -> str:
    digest = hashlib.sha256()
    try:
        for file in files:
            with file.open("rb") as stream:
                while block := stream.read(1 << 20):
                    digest.update(block)
    except OSError as error:
        raise IdentError(f"{named}: cannot be read: {error.strerror}") from error
    return digest.hexdigest()
