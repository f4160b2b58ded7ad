"""Files that commands write: whole or not at all."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydro_ident.errors import IdentError

#: What `--json` takes for standard output.
STDOUT = Path("-")


def add_json(parser: argparse.ArgumentParser, what: str = "the same") -> None:
    """Give a command its `--json`.

    Parameters
    ----------
    parser : ArgumentParser
    what : str
        That is written.
    """
    parser.add_argument(
        "--json",
        type=Path,
        metavar="F",
        help=f"write {what} as JSON; - for standard output, and nothing else there",
    )


def report(json_file: Path | None, data: Mapping[str, Any], text: str) -> None:
    """Print a result for a person, and for a program where that is asked for.

    Parameters
    ----------
    json_file : Path or None
        Of `--json`.
    data : mapping
    text : str
    """
    if json_file is not None:
        write_json(json_file, data)
    if json_file != STDOUT:
        print(text)


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a mapping as JSON.

    Parameters
    ----------
    path : Path
        `-` is standard output.
    data : mapping

    Raises
    ------
    IdentError
        The file cannot be written.
    """
    text = json.dumps(data, indent=2, allow_nan=False) + "\n"
    if path == STDOUT:
        sys.stdout.write(text)
    else:
        write_text(path, text)


def write_text(path: Path, text: str) -> None:
    """Write a text file.

    Parameters
    ----------
    path : Path
    text : str

    Raises
    ------
    IdentError
        The file cannot be written.
    """
    from hydro_ident.bag.metadata import write_atomically

    try:
        write_atomically(path, text)
    except OSError as error:
        raise IdentError(f"{path}: cannot be written: {error.strerror}") from error
