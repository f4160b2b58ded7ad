"""The valve amplifiers: enable chain, watchdog, saturation and the delay of a command."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from hydro_hw_bridge.errors import BridgeError
from hydro_model.robot import FloatArray

#: Device time without a valid frame after which the amplifiers switch off.
WATCHDOG_S = 0.050
#: What amplifiers of proportional valves give at least; of a valve that is rated for more, that.
SUPPLY_LIMIT_V = 10.0


class Amplifier:
    """Outputs of all valves of one device.

    Parameters
    ----------
    rated_v : (valves,) array
        Rated voltages of the valves, in the order of their commands.
    cycle_s : float
        Device time between two calls of `step`.
    delay_cycles : int
        Whole cycles from a frame to the output that follows it.

    Attributes
    ----------
    output_v : (valves,) array
        Voltage at the spools over the current cycle.
    enabled : bool
    tripped : bool
        The watchdog has switched off; a frame with enable off, then one with enable on, mend it.
    trips : int
        How often it did.
    """

    def __init__(self, rated_v: FloatArray, cycle_s: float, delay_cycles: int) -> None:
        self._patience = max(1, round(WATCHDOG_S / cycle_s))
        self._delay = delay_cycles
        self._limit_v = np.maximum(SUPPLY_LIMIT_V, rated_v)
        self._zero = np.zeros_like(self._limit_v)
        self._queue: deque[FloatArray] = deque()
        self._held = self._zero
        self._missing = 0
        self.output_v: FloatArray = self._zero
        self.enabled = False
        self.tripped = False
        self.trips = 0

    def step(self, voltages: Sequence[float] | None, enable: bool, permitted: bool) -> FloatArray:
        """One cycle.

        Parameters
        ----------
        voltages : sequence of float or None
            Of the frame that arrived in this cycle, V; None where none did.
        enable : bool
            Enable bit of that frame.
        permitted : bool
            Emergency stop, pump and enable switch all allow driving.

        Returns
        -------
        (valves,) array
            `output_v`.

        Raises
        ------
        BridgeError
            The voltages are not finite or not one per valve.
        """
        if voltages is None:
            self._miss()
        else:
            self._take(voltages, enable, permitted)
        if self.enabled and not permitted:
            self._off()
        self._queue.append(self._held)
        if len(self._queue) > self._delay:
            self.output_v = self._queue.popleft()
        if not self.enabled:
            self.output_v = self._zero
        return self.output_v

    def _miss(self) -> None:
        self._missing += 1
        if self.enabled and self._missing >= self._patience:
            self._off()
            self.tripped = True
            self.trips += 1

    def _take(self, voltages: Sequence[float], enable: bool, permitted: bool) -> None:
        asked = np.asarray(voltages, dtype=float)
        if asked.shape != self._zero.shape or not np.isfinite(asked).all():
            raise BridgeError(
                f"valve amplifiers: expected {self._zero.size} finite voltages,"
                f" found {list(voltages)}"
            )
        self._missing = 0
        if not enable:
            self._off()
            self.tripped = False
        elif not self.tripped:
            self.enabled = permitted
            self._held = np.clip(asked, -self._limit_v, self._limit_v)

    def _off(self) -> None:
        self.enabled = False
        self._held = self._zero
        # Commands on their way must not come out after a later enable.
        self._queue.clear()
        self._queue.extend([self._zero] * self._delay)
