"""Processes that are waited for with patience, but not for ever."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from typing import Any

from hydro_ident.errors import IdentError


def run_within(
    patience_s: float, name: str, words: Sequence[str], **how: Any
) -> subprocess.CompletedProcess[Any]:
    """Run a process to its end; one that does not end is killed.

    Parameters
    ----------
    patience_s : float
        How long it is waited for, s.
    name : str
        What it is called where it does not end.
    words : sequence of str
        Its command line.
    **how
        As of `subprocess.run`.

    Returns
    -------
    CompletedProcess

    Raises
    ------
    IdentError
        It did not end in time.
    """
    try:
        return subprocess.run(words, timeout=patience_s, **how)
    except subprocess.TimeoutExpired as error:
        raise unended(name, patience_s) from error


def unended(name: str, patience_s: float) -> IdentError:
    """The error of a process that did not end.

    Parameters
    ----------
    name : str
    patience_s : float
        How long it was waited for, s.
    """
    return IdentError(f"{name}: expected its end within {patience_s:g} s, found it still running")
