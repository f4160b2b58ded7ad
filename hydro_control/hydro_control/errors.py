"""What this package raises on purpose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_model.errors import HydroError, printable


class ControlError(HydroError):
    """A controller that cannot be set up as asked, or a reference that it refuses."""


#: What arithmetic raises where numbers leave its range: what cannot be computed is refused.
NUMERICAL_ERRORS = (ValueError, ArithmeticError, np.linalg.LinAlgError)

#: Of what a message names: so many names are shown, of each so many characters.
_NAMES_SHOWN, _LETTERS_SHOWN = 16, 40


def names_in_short(names: Sequence[str]) -> str:
    """What somebody's message names, for an error's line: it may hold anything, and any amount.

    Parameters
    ----------
    names : sequence of str

    Returns
    -------
    str
        The first of them, each shortened, and how many more there are; empty where there is none.
    """
    shown = [
        printable(name if len(name) <= _LETTERS_SHOWN else f"{name[:_LETTERS_SHOWN]}...")
        for name in names[:_NAMES_SHOWN]
    ]
    if len(names) > _NAMES_SHOWN:
        shown.append(f"and {len(names) - _NAMES_SHOWN} more")
    return ", ".join(shown)
