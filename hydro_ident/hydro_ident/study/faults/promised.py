"""What the safety case promises, as wall time from a fault to 0 V at the valves."""

from __future__ import annotations

from collections.abc import Mapping

from hydro_hw_bridge.faults.bus_faults import BRIDGE, DEVICE
from hydro_hw_bridge.faults.injection import AGE, AT_ONCE, WATCHDOG

CYCLE_MS = 2.0
#: Promised is device time; two cycles of the way come on top.
WAY_MS = 4.0


def wall_ms(cycles: int) -> float:
    """The wall time of a promise in cycles of the device.

    Parameters
    ----------
    cycles : int
        From the first one of the fault to 0 V, both counted.
    """
    return CYCLE_MS * cycles + WAY_MS


AT_ONCE_MS, AGE_MS, WATCHDOG_MS = wall_ms(AT_ONCE), wall_ms(AGE), wall_ms(WATCHDOG)
#: The controller's own way to 0 V on SIGTERM: a ramp within the slew limit.
RAMP_MS = 30.0 + WAY_MS
#: All frames of one direction for longer than the watchdog's time, by kind and direction. A
#: machine that says nothing, as one does whose frames are late, ends driving once a command is too
#: old. Broken frames are no silence: there, and where the bridge's frames do not come, it is the
#: amplifiers that answer.
ALL_FRAMES_MS: Mapping[tuple[str, str], float] = {
    ("lost", DEVICE): AGE_MS,
    ("late", DEVICE): AGE_MS,
    ("bit_flip", DEVICE): WATCHDOG_MS,
    ("lost", BRIDGE): WATCHDOG_MS,
    ("late", BRIDGE): WATCHDOG_MS,
    ("bit_flip", BRIDGE): WATCHDOG_MS,
}
