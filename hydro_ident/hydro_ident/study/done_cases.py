"""The file of the cases that are done: one line of JSON each, appended as they are.

A run may be killed while it writes. Its last line then has no end: that case is not done, and the
fragment is cut off before the next one is written, which else would be glued to it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydro_ident.errors import IdentError


def append_score(results: Path, score: Mapping[str, Any]) -> None:
    """Write a case as done.

    Parameters
    ----------
    results : Path
        The file; made where there is none.
    score : mapping
        Of the case, as `CaseScore.content`.
    """
    with results.open("ab") as stream:
        whole = len(_whole_lines(results))
        if stream.tell() > whole:
            stream.truncate(whole)
        stream.write(json.dumps(score).encode() + b"\n")


def done_scores(results: Path) -> list[dict[str, Any]]:
    """The cases that are done, in the order in which they were.

    Parameters
    ----------
    results : Path
        The file.

    Returns
    -------
    list of dict
        Their scores; none where there is no file.

    Raises
    ------
    IdentError
        A line that has an end is no score.
    """
    if not results.is_file():
        return []
    lines = _whole_lines(results).split(b"\n")[:-1]
    return [_score(line, f"{results}:{number}") for number, line in enumerate(lines, 1)]


def _whole_lines(results: Path) -> bytes:
    """The file up to the end of its last whole line."""
    content = results.read_bytes()
    return content[: content.rfind(b"\n") + 1]


def _score(line: bytes, where: str) -> dict[str, Any]:
    try:
        score = json.loads(line)
    except ValueError as error:
        raise IdentError(f"{where}: expected a case's score in JSON, found: {error}") from error
    if not isinstance(score, dict) or "case" not in score:
        raise IdentError(f"{where}: expected a mapping with 'case', found {score!r:.40}")
    return score
