"""A study in one file, to go on with it elsewhere: what was hidden, and what was said of it.

Recordings are left out: a case that is done needs none, any other is made again from its seed.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_ident.errors import IdentError
from hydro_ident.study.conceal import ANSWERS, ORACLES, TRUTHS, write_json

_FOLDERS = (TRUTHS, ANSWERS, ORACLES)
_PLAN, _SCORES = "plan.json", "scores.json"
#: Largest member, bytes; a case's is some 20 kB.
_LARGEST = 10_000_000


def pack(
    file: Path, out: Path, plan: Mapping[str, Any], scores: Sequence[Mapping[str, Any]]
) -> None:
    """Write cases to an archive.

    Parameters
    ----------
    file : Path
        A tar file, compressed by xz; the same cases give the same bytes.
    out : Path
        Of the study.
    plan : mapping
        Of the study.
    scores : sequence of mapping
        Of the cases that are done, as `CaseScore.content`.
    """
    with tarfile.open(file, "w:xz") as archive:
        _add(archive, _PLAN, dict(plan))
        _add(archive, _SCORES, [dict(score) for score in scores])
        for name in sorted(str(score["case"]) for score in scores):
            for folder in _FOLDERS:
                path = out / folder / f"{name}.json"
                if path.is_file():
                    _add(archive, f"{folder}/{name}.json", json.loads(path.read_text("utf-8")))


def unpack(file: Path, out: Path, plan: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Put an archive's cases into a study's folder; those that are there already stay.

    Parameters
    ----------
    file : Path
    out : Path
    plan : mapping
        Of the study that goes on.

    Returns
    -------
    list of dict
        The cases' scores.

    Raises
    ------
    IdentError
        It is no archive of a study, or one of another.
    """
    members = dict(_members(file))
    found = members.get(_PLAN)
    if found != dict(plan):
        raise IdentError(f"{file}: expected a study of plan {dict(plan)}, found {found}")
    scores = members.get(_SCORES) or []
    for score in scores:
        if not str(score["case"]).isalnum():
            raise IdentError(f"{file}: expected a case's name, found '{score['case']}'")
        for folder in _FOLDERS:
            name = f"{folder}/{score['case']}.json"
            if name in members and not (out / name).is_file():
                (out / folder).mkdir(parents=True, exist_ok=True)
                write_json(out / name, members[name])
    return list(scores)


def _add(archive: tarfile.TarFile, name: str, content: Any) -> None:
    data = json.dumps(content).encode()
    info = tarfile.TarInfo(name)
    info.size = len(data)
    archive.addfile(info, io.BytesIO(data))


def _members(file: Path) -> Iterator[tuple[str, Any]]:
    """Names and contents, all in memory: no member's name ever becomes a path unasked."""
    try:
        with tarfile.open(file, "r:xz") as archive:
            for info in archive:
                stream = archive.extractfile(info) if info.size <= _LARGEST else None
                if stream is None:
                    raise IdentError(f"{file}: expected files of a study, found '{info.name}'")
                yield info.name, json.loads(stream.read())
    except (OSError, EOFError, ValueError, tarfile.TarError) as error:
        raise IdentError(f"{file}: expected an archive of a study, found: {error}") from error
