"""What goes wrong with machine, bridge and clock themselves, as descriptions."""

from __future__ import annotations

from dataclasses import dataclass

PERMISSIVES = {"emergency_stop": "emergency_stop_ok", "pump": "pump_on", "enable": "enable_switch"}
KINDS = (
    *PERMISSIVES,
    "bridge_dead",
    "bridge_stopped",
    "controller_stopped",
    "device_silent",
    "device_restart",
    "clock_step",
    "deactivated",
)


@dataclass(frozen=True, slots=True)
class MachineFault:
    """One fault that is not on the bus.

    Attributes
    ----------
    kind : str
        One of `KINDS`. The permissives open; the bridge is killed, or stopped for a while and
        then has all at once what came meanwhile; the controller likewise; the device sends
        nothing, or counts anew; the ROS clock steps.
    first_cycle, cycles : int
    amount : float
        clock_step: s.
    """

    kind: str
    first_cycle: int
    cycles: int = 1
    amount: float = 0.0

    def acts(self, cycle: int) -> bool:
        """Whether a cycle is among those it is about."""
        return self.first_cycle <= cycle < self.first_cycle + self.cycles
