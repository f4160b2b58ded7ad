"""What commands print, for people and for programs, and files they write whole or not at all."""

from __future__ import annotations

import argparse
import errno
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hydro_model.errors import HydroError

#: What `--json` takes for standard output.
STDOUT = Path("-")
#: What to try where a file cannot be written.
_TO_TRY = {
    **dict.fromkeys((errno.EACCES, errno.EPERM), "give a place that you may write to"),
    errno.ENOENT: "make its folder first",
    errno.ENOSPC: "make room there, or give another place",
}


class OutputError(HydroError):
    """A file that cannot be written (exit code 2)."""


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


def unwritable(path: Path, error: OSError) -> str:
    """What is said of a file or folder that cannot be written, and what to try.

    Parameters
    ----------
    path : Path
    error : OSError
        As the system says.

    Returns
    -------
    str
    """
    to_try = _TO_TRY.get(error.errno or 0, "give another place")
    return f"{path}: cannot be written: {error.strerror}; {to_try}"


def report(json_file: Path | None, data: Mapping[str, Any], text: str) -> None:
    """Print a result for a person, and for a program where that is asked for.

    A reader of our output that goes away (`... | head`) takes nothing from the file, and the
    command's exit code stands.

    Parameters
    ----------
    json_file : Path or None
        Of `--json`.
    data : mapping
    text : str
        Empty where a person is told nothing.

    Raises
    ------
    OutputError
        The file cannot be written; the person has the text.
    """
    try:
        try:
            if json_file is not None:
                write_json(json_file, data)
        finally:
            if text and json_file != STDOUT:
                print(text, flush=True)
    except BrokenPipeError:
        let_go_of_stdout()


def let_go_of_stdout() -> None:
    """Write nowhere from now on: the reader of our output went away, which is no failure."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def report_files(json_file: Path | None, schema: str, files: Sequence[Path]) -> None:
    """Say which files were written, where they are all of a command's result.

    Parameters
    ----------
    json_file : Path or None
        Of `--json`.
    schema : str
    files : sequence of Path
    """
    names = [str(file) for file in files]
    report(json_file, {"schema": schema, "files": names}, "\n".join(names))


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a mapping as JSON.

    Parameters
    ----------
    path : Path
        `-` is standard output.
    data : mapping

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    text = json.dumps(data, indent=2, allow_nan=False) + "\n"
    if path == STDOUT:
        sys.stdout.write(text)
        sys.stdout.flush()
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
    OutputError
        The file cannot be written.
    """
    try:
        write_atomically(path, text)
    except OSError as error:
        raise OutputError(unwritable(path, error)) from error


def write_atomically(path: Path, text: str) -> None:
    """Write a text file so that it is there whole or not at all.

    Parameters
    ----------
    path : Path
    text : str

    Raises
    ------
    OSError
        As the system says.
    """
    partial = path.with_name(path.name + ".part")
    try:
        with open(partial, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise
