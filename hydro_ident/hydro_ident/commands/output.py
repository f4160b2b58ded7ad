"""Files that commands write: whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydro_ident.bag.metadata import write_atomically
from hydro_ident.errors import IdentError


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a mapping as JSON.

    Parameters
    ----------
    path : Path
    data : mapping

    Raises
    ------
    IdentError
        The file cannot be written.
    """
    write_text(path, json.dumps(data, indent=2, allow_nan=False) + "\n")


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
    try:
        write_atomically(path, text)
    except OSError as error:
        raise IdentError(f"{path}: cannot be written: {error.strerror}") from error
