"""The root of what the packages raise on purpose."""

from __future__ import annotations


class HydroError(Exception):
    """An error with one clear line for the user: what was expected, what was found, where.

    Attributes
    ----------
    exit_code : int
        What a command that meets it returns: 2 for bad usage or unreadable input,
        1 where the work itself failed or the data were not enough.
    """

    exit_code = 2


def in_short(error: Exception, most: int = 100) -> str:
    """What another library says of a file, in one line and so short that little of it is shown.

    Parameters
    ----------
    error : Exception
        Its own text may repeat whatever stands in the file.
    most : int
        Characters.

    Returns
    -------
    str
    """
    line = " ".join(str(error).split()) or type(error).__name__
    line = line if len(line) <= most else line[: most - 3] + "..."
    return "".join(c if c.isprintable() else "?" for c in line)


def printable(text: str) -> str:
    """A text in one line, with whatever commands a terminal or cannot be printed escaped.

    Examples
    --------
    >>> printable("a\\x1b[2J")
    'a\\\\x1b[2J'
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text
    )


class RobotError(HydroError):
    """A robot description that is missing, malformed or contradicts itself."""


class SimulationError(HydroError):
    """A roll-out that could not be integrated."""

    exit_code = 1
