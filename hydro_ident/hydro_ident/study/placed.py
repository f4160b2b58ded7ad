"""Results of the documentation, and their tables between two marks of a page of it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hydro_ident.errors import IdentError


def placed(page: str, content: str, begin: str, end: str) -> str:
    """A page with what stands between two marks replaced.

    Parameters
    ----------
    page : str
    content : str
        Without the marks.
    begin, end : str
        The marks; they stay.

    Returns
    -------
    str

    Raises
    ------
    IdentError
        The page lacks a mark.
    """
    before, found, rest = page.partition(begin)
    _, closed, after = rest.partition(end)
    lacking = [mark for mark, there in ((begin, found), (end, closed)) if not there]
    if lacking:
        raise IdentError(
            f"expected the marks '{begin}' and '{end}' in the page, in this order, found no"
            f" '{lacking[0]}'"
        )
    return f"{before}{begin}\n\n{content}\n{end}{after}"


#: What a page says in the place of a result that is not there.
NOT_PUBLISHED = "No run has been published yet.\n"


def published(folder: Path, name: str) -> Any:
    """What a committed result holds; None where there is none.

    Parameters
    ----------
    folder : Path
        Of the results.
    name : str
        Of the file.
    """
    path = folder / name
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def write_result(
    path: Path, result: Mapping[str, Any], page: str, made: Callable[[str, Path], str]
) -> None:
    """Write a run's result, and the tables of its page anew.

    Parameters
    ----------
    path : Path
        File of the result.
    result : mapping
        What JSON can say.
    page : str
        As `renewed`.
    made : callable
        As `renewed`.

    Raises
    ------
    IdentError
        The page has no place for its tables.
    """
    path.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    renewed(path, page, made)


def renewed(path: Path, page: str, made: Callable[[str, Path], str]) -> Path | None:
    """Write the tables of the page beside the folder of a result, if there is one.

    Parameters
    ----------
    path : Path
        File of the result.
    page : str
        Name of the page, in the folder above that of the results.
    made : callable
        Gives the page's new text from the old one and the folder of the results.

    Returns
    -------
    Path or None
        The page; None where there is none.

    Raises
    ------
    IdentError
        The page has no place for its tables.
    """
    folder = path.resolve().parent
    file = folder.parent / page
    if not file.is_file():
        return None
    file.write_text(made(file.read_text(encoding="utf-8"), folder), encoding="utf-8")
    return file
