"""What is expected of one parameter before the run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Expected:
    """Expected standard error of one parameter.

    Attributes
    ----------
    name, unit : str
    datasheet : float or None
        The robot file's value; None where it has none.
    std : float
        Infinite where the motion does not determine the parameter.
    """

    name: str
    unit: str
    datasheet: float | None
    std: float

    @property
    def relative(self) -> float | None:
        """Standard error over the datasheet's value; None without one."""
        return self.std / abs(self.datasheet) if self.datasheet else None
