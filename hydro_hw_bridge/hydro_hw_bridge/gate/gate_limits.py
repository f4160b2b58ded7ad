"""What the safety gate holds commands and machine to."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GateLimits:
    """What the gate holds commands and machine to.

    Attributes
    ----------
    valve_names : tuple of str
    rated_voltage_v : tuple of float
        Per valve; commands above it trip.
    period_s : float
        Of the device's cycle.
    slew_v_s : float
        The legal slew rate; commands faster than twice that trip.
    max_age_cycles : int
        Commands and silences older than this trip.
    min_supply_pa : float
        Gauge; 0 or less switches the check off.
    reenable_slew_v_s : float
        Slew rate of the output in the first second of driving after a trip was cleared.
    """

    valve_names: tuple[str, ...]
    rated_voltage_v: tuple[float, ...]
    period_s: float
    slew_v_s: float
    max_age_cycles: int
    min_supply_pa: float
    reenable_slew_v_s: float = 10.0

    @property
    def legal_step_v(self) -> float:
        """The largest legal change of voltage from one cycle to the next."""
        return self.slew_v_s * self.period_s

    @property
    def max_age_s(self) -> float:
        """The greatest age of a command that drives."""
        return self.max_age_cycles * self.period_s

    @property
    def first_age_cycles(self) -> int:
        """Age up to which a command may be the first: one at the limit would trip right after."""
        return max(1, self.max_age_cycles // 2)

    @property
    def reenable_step_v(self) -> float:
        """The largest change of the output from one cycle to the next after a cleared trip."""
        return min(self.reenable_slew_v_s, self.slew_v_s) * self.period_s
