"""How the valves' voltages come to what is commanded: never by more than a legal step at once."""

from __future__ import annotations

import math

from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.held_voltages import ROUNDING_V, HeldVoltages

#: Twice the slew limit.
RATE_FACTOR = 2.0
#: How long the output stays slow after a trip was cleared: time to see what moves, and to stop it.
REENABLE_S = 1.0


class OutputRamp:
    """The gate's output, one command after the other.

    Parameters
    ----------
    limits : GateLimits
    held : HeldVoltages
        Where the amplifiers may still be: a step is one from there, too.

    Attributes
    ----------
    applied_v : tuple of float
        What the valves get.
    cleared : bool
        A trip was cleared, and the valves were not driven for a second since.
    """

    def __init__(self, limits: GateLimits, held: HeldVoltages) -> None:
        self._limits, self._held = limits, held
        self._zero = (0.0,) * len(limits.valve_names)
        # Counted are the cycles that commands answer: the first may have been an old one.
        self._slow_cycles = round(REENABLE_S / limits.period_s) + limits.max_age_cycles
        self.cleared = False
        self.begin(0)
        self.reset()

    def reset(self) -> None:
        """0 V: nothing is driven."""
        self.applied_v = self._zero
        self._ramping = True

    def begin(self, counter: int) -> None:
        """Driving begins with the command of this cycle."""
        self._driving_since = self._moving_since = counter

    def hold(self, counter: int) -> None:
        """0 V to amplifiers that are off: whatever is slow at first begins when they are on."""
        self.reset()
        self._moving_since = counter

    def driven_cycles(self, counter: int) -> int:
        """How many cycles were driven until this one."""
        return counter - self._driving_since

    def follow(self, counter: int, command_v: tuple[float, ...]) -> None:
        """Go towards an accepted command.

        Parameters
        ----------
        counter : int
            Sample counter of the cycle that it answers.
        command_v : tuple of float
        """
        slow = self._slow(counter)
        values = command_v
        if values != self._zero:
            # From 0 V, or after missing commands, towards a controller that is elsewhere already:
            # however many cycles lie between, the valves see one step.
            most = self._most(slow)
            values = tuple(
                _towards(value, before, most)
                for value, before in zip(values, self.applied_v, strict=True)
            )
            # Frames that were lost, late or not taken by the bus moved nothing.
            legal = RATE_FACTOR * self._limits.legal_step_v
            most = self._limits.reenable_step_v if slow else legal
            values = self._held.towards(values, self.applied_v, most)
        self._ramping = slow or values != command_v
        self.applied_v = values

    def _most(self, slow: bool) -> float:
        """The largest change of the output at once, V."""
        if slow:
            return self._limits.reenable_step_v
        return self._limits.legal_step_v * (1.0 if self._ramping else RATE_FACTOR)

    def _slow(self, counter: int) -> bool:
        """Whether this is the first second of driving after a trip was cleared."""
        if self.cleared:
            self.cleared = counter - self._moving_since < self._slow_cycles
        return self.cleared


def _towards(value: float, before: float, most: float) -> float:
    """A value, or as near to it as a step of at most so much comes."""
    step = value - before
    return value if abs(step) <= most + ROUNDING_V else before + math.copysign(most, step)
