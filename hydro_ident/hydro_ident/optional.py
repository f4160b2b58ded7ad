"""Packages that rosdep does not bring: plotly for reports, clarabel for bodies that can exist.

`scripts/setup.sh` installs both. Without plotly all is done but the report; without clarabel
`identify` does not begin, as its model would lack the bodies that others compute with.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec

from hydro_ident.errors import IdentError

_HINT = "scripts/setup.sh brings it (README, 'Two commands'), as does pip install"


def installed(package: str) -> bool:
    """Whether a package can be imported.

    Parameters
    ----------
    package : str

    Returns
    -------
    bool
    """
    return find_spec(package) is not None


def say_if_no_report(command: str, file: str, others: str) -> None:
    """Say on standard error, before the work, that its report cannot be written.

    Parameters
    ----------
    command, file : str
        Who says it, and the report's name.
    others : str
        What is done all the same.
    """
    if not installed("plotly"):
        print(
            f"{command}: plotly is not installed: {file} is not written, {others}; {_HINT} plotly",
            file=sys.stderr,
            flush=True,
        )


def require(package: str, purpose: str) -> None:
    """Refuse to begin work that would fail at its end.

    Parameters
    ----------
    package : str
    purpose : str
        What it is needed for.

    Raises
    ------
    IdentError
        It is not installed.
    """
    if not installed(package):
        raise IdentError(f"{package} is not installed, needed for {purpose}: {_HINT} {package}")
