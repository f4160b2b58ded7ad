"""What a run of the benchmark was made of: commit, date, machine, and the sources it measured."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from hydro_ident.errors import IdentError
from hydro_ident.study.placed import published
from hydro_ident.study.sources import differing, digests_of
from hydro_model.command_line.output import write_atomically

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
#: Of the repository: the packages whose work is measured.
FOLDERS = (
    "ros2_ws/src/hydro_model/hydro_model",
    "hydro_msgs_docs/hydro_msgs_docs",
    "hydro_hw_bridge/hydro_hw_bridge",
    "hydro_control/hydro_control",
    "hydro_ident/hydro_ident",
)
#: What is beside the measured work: campaigns and studies, but for those modules that jobs use.
_BESIDE, _USED = (
    "hydro_ident/hydro_ident/study",
    (
        "closed_loop.py",
        "known_effects.py",
        "long_bag.py",
        "peak.py",
        "synthetic.py",
    ),
)
#: Changed sources that a page names, the others are counted.
_NAMED = 8
#: How long git is waited for, s: it answers in a second, unless another holds the repository.
_GIT_S = 60.0
#: Make the page or this file: they measure nothing.
LEFT_OUT = ("page.py", "made.py", "names.py", "soak_page.py")


def digests(root: Path) -> dict[str, str]:
    """SHA-256 of every source that is measured, by its path from the repository's top.

    Parameters
    ----------
    root : Path
        That top.

    Raises
    ------
    IdentError
        There are none.
    """
    found = (path for folder in FOLDERS for path in (root / folder).rglob("*.py"))
    beside = root / _BESIDE
    paths = [
        p for p in found if beside not in p.parents or (p.parent == beside and p.name in _USED)
    ]
    if not paths:
        raise IdentError(f"{root}: expected the repository's top (--root), found no sources there")
    return digests_of(root, paths, LEFT_OUT)


def file_of(rows: Path) -> Path:
    """Where it is written what rows were made of: beside them.

    Parameters
    ----------
    rows : Path
    """
    return rows.with_name(f"{rows.stem}_made{rows.suffix}")


def made(root: Path) -> dict[str, Any]:
    """What a run that begins now is made of.

    Parameters
    ----------
    root : Path
        Top of the repository.
    """
    return {
        "schema": "hydro_ident/bench_made/1",
        "commit": _commit(root),
        "date": datetime.now(timezone.utc).date().isoformat(),
        "cores": os.cpu_count(),
        "threads": {name: os.environ.get(name) for name in THREADS},
        "sources": digests(root),
    }


def text_of(run: Mapping[str, Any], rows: str) -> str:
    """What is written beside rows.

    Parameters
    ----------
    run : mapping
        As `made`.
    rows : str
        The content of their file: another one is of another run.
    """
    return json.dumps({**run, "rows": _sha256(rows), "changed_since": []}, indent=1) + "\n"


def write(result: Path, text: str, run: Mapping[str, Any]) -> None:
    """Write a result, and beside it what it was made of.

    Parameters
    ----------
    result : Path
    text : str
        Its content.
    run : mapping
        As `made`.
    """
    write_atomically(result, text)
    write_atomically(file_of(result), text_of(run, text))


def renewed(rows: Path, root: Path) -> str | None:
    """What was written beside rows, with the sources that have changed since; None without it.

    Parameters
    ----------
    rows : Path
        Their file.
    root : Path
        Top of the repository.

    Raises
    ------
    IdentError
        It is that of other rows.
    """
    file = file_of(rows)
    run = published(file.parent, file.name)
    if run is None:
        return None
    if run["rows"] != _sha256(rows.read_text(encoding="utf-8")):
        raise IdentError(f"{file}: expected that of {rows.name}, found that of other rows")
    run["changed_since"] = differing(run["sources"], digests(root))
    return json.dumps(run, indent=1) + "\n"


def sentence(folder: Path, rows: str) -> str:
    """What a page says of it.

    Parameters
    ----------
    folder : Path
        Of the results.
    rows : str
        Name of the rows' file.
    """
    run = published(folder, file_of(Path(rows)).name)
    if run is None:
        return "What this run was made of was not written down.\n"
    threads = ", ".join(f"{name} {n or 'unset'}" for name, n in run["threads"].items())
    said = (
        f"Run of {run['date']}, commit {run['commit']}, {run['cores']} cores, threads: {threads}."
    )
    if changed := run["changed_since"]:
        names = ", ".join(f"`{path}`" for path in changed[:_NAMED])
        more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
        said += f" Of the {len(run['sources'])} sources measured, changed since: {names}{more}."
    return f"{said}\n"


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _commit(root: Path) -> str:
    words = [
        "git",
        "-C",
        str(root),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=7",
        "--exclude=*",
    ]
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=_GIT_S)
    except subprocess.TimeoutExpired:
        return f"unknown (git did not answer within {_GIT_S:g} s)"
    except (OSError, subprocess.CalledProcessError):
        return "unknown (no git)"
    return done.stdout.strip()
