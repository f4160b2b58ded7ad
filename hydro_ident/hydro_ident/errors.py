"""What hydro_ident raises on purpose."""

from __future__ import annotations

from hydro_model.errors import HydroError


class IdentError(HydroError):
    """Root of this package's errors: bad usage or unreadable input (exit code 2)."""


class BagError(IdentError):
    """A bag that is missing, is no bag, or lacks what the work needs."""


class NoCyclesError(BagError):
    """A bag that was read, but has no cycle of the robot (exit code 1).

    Attributes
    ----------
    reason : str
        What it lacks, in a few words.
    """

    exit_code = 1

    def __init__(self, text: str, reason: str) -> None:
        super().__init__(text)
        self.reason = reason


class NotEnoughDataError(IdentError):
    """Input that was read and understood, but does not carry the answer (exit code 1)."""

    exit_code = 1
