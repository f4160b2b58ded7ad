"""What goes wrong with machine, bridge and clock themselves, as descriptions."""

from __future__ import annotations

from dataclasses import dataclass

from hydro_hw_bridge.faults.timed import Timed

#: Inputs of the machine, by what opens them: the amplifiers look at these themselves.
PERMISSIVES = {"emergency_stop": "emergency_stop_ok", "pump": "pump_on", "enable": "enable_switch"}
#: The fourth permissive, which no input tells: the bridge alone sees the supply's pressure.
SUPPLY = "supply"
#: What the gate says of each.
MISSING = {
    "emergency_stop": "emergency stop",
    "pump": "pump is off",
    "enable": "enable switch",
    SUPPLY: "supply pressure",
}
KINDS = (
    *MISSING,
    "bridge_dead",
    "bridge_stopped",
    "controller_stopped",
    "device_silent",
    "device_restart",
    "clock_step",
    "deactivated",
)


@dataclass(frozen=True, slots=True)
class MachineFault(Timed):
    """One fault that is not on the bus.

    Attributes
    ----------
    kind : str
        One of `KINDS`. The permissives open, the supply loses its pressure; the bridge is
        killed, or stopped for a while and then has all at once what came meanwhile; the
        controller likewise; the device sends nothing, or counts anew; the ROS clock steps.
    first_cycle, cycles : int
    amount : float
        clock_step: s; supply: Pa gauge that are left.
    """

    kind: str
    first_cycle: int
    cycles: int = 1
    amount: float = 0.0
