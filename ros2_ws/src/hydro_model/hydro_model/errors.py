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


class RobotError(HydroError):
    """A robot description that is missing, malformed or contradicts itself."""


class SimulationError(HydroError):
    """A roll-out that could not be integrated."""

    exit_code = 1
