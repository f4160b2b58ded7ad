"""The machine's permissives: without each of them nothing is driven."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_hw_bridge.gate.gate_limits import GateLimits

EMERGENCY_STOP = "emergency stop"


@dataclass(frozen=True, slots=True)
class Inputs:
    """The machine's permissives of one cycle.

    Attributes
    ----------
    emergency_stop_ok, pump_on, enable_switch : bool
    amplifier_watchdog : bool
        The amplifiers shut down on their own.
    supply_pa : float
        Gauge; NaN where not measured.
    amplifiers_on : bool or None
        None where they do not tell.
    """

    emergency_stop_ok: bool
    pump_on: bool
    enable_switch: bool
    amplifier_watchdog: bool
    supply_pa: float
    amplifiers_on: bool | None = None


def missing_permissive(inputs: Inputs | None, limits: GateLimits, *, settled: bool) -> str:
    """The first permissive that is not there.

    Parameters
    ----------
    inputs : Inputs or None
        None before the first complete cycle.
    limits : GateLimits
    settled : bool
        The amplifiers had time to answer to enable.

    Returns
    -------
    str
        Empty where all are there.
    """
    if inputs is None:
        return "no complete cycle from the device yet"
    if not inputs.emergency_stop_ok:
        return EMERGENCY_STOP
    if not inputs.enable_switch:
        return "enable switch is off"
    if not inputs.pump_on:
        return "pump is off"
    if limits.min_supply_pa > 0.0 and not inputs.supply_pa >= limits.min_supply_pa:
        return (
            f"supply pressure {inputs.supply_pa / 1e5:.1f} bar gauge"
            f" (minimum {limits.min_supply_pa / 1e5:.1f} bar)"
        )
    if inputs.amplifier_watchdog and settled:
        return "the amplifiers' watchdog shut them down"
    return ""
