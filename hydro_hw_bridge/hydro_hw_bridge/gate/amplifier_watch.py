"""Whether the amplifiers follow, by what they say of themselves. Pure."""

from __future__ import annotations

from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.held_voltages import HeldVoltages

#: How long amplifiers may take to come on: at 0 V nothing moves meanwhile.
ENABLE_S = 0.1


class AmplifierWatch:
    """The amplifiers' own bit, and whether they take frames, from the begin of driving on.

    Parameters
    ----------
    limits : GateLimits
    held : HeldVoltages
    """

    def __init__(self, limits: GateLimits, held: HeldVoltages) -> None:
        self._held = held
        self._settling = limits.max_age_cycles
        self._patience = max(self._settling, round(ENABLE_S / limits.period_s))
        self._patience_s = self._patience * limits.period_s
        self._came_on = False

    def begin(self) -> None:
        """Driving begins: they are about to be enabled."""
        self._came_on = False

    def look(self, on: bool | None, driven_cycles: int) -> str:
        """What the amplifiers say in a cycle.

        Parameters
        ----------
        on : bool or None
            None: they do not tell.
        driven_cycles : int
            How long they have been sent enable. What they say before they can have answered is
            of the time before.

        Returns
        -------
        str
            Why driving has to end; empty where it may go on.
        """
        if driven_cycles <= self._settling:
            return ""
        if on is not False:
            self._came_on = True
            return self._held.complaint
        self._held.rest()
        if self._came_on:
            return "the amplifiers switched off while driving"
        if driven_cycles > self._patience:
            return f"the amplifiers did not come on within {1e3 * self._patience_s:.0f} ms"
        return ""
