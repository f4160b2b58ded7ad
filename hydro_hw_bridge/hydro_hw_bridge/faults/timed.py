"""What faults of all kinds have in common: the cycles that they are about."""

from __future__ import annotations


class Timed:
    """For a while, counted in cycles.

    Attributes
    ----------
    first_cycle, cycles : int
        From which cycle on, and for how many.
    """

    __slots__ = ()
    first_cycle: int
    cycles: int

    def acts(self, cycle: int) -> bool:
        """Whether a cycle is among those it is about.

        Parameters
        ----------
        cycle : int
        """
        return self.first_cycle <= cycle < self.first_cycle + self.cycles
