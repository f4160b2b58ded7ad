"""What the record of the valves says of the time after a trip was cleared."""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.faults.measured_rig import STATES
from hydro_hw_bridge.gate.gate_limits import GateLimits
from hydro_hw_bridge.gate.output_ramp import REENABLE_S
from hydro_model.robot import FloatArray

#: Half a step of the wire's voltage, twice: two rounded values.
ROUNDING_V = 1e-3


def excess_v(values: FloatArray, limits: GateLimits) -> float:
    """How far the valves stepped beyond the slow rate, V; 0 or less where they did not.

    A frame that comes carries the steps of every command since the one before it: of as many
    cycles as lie between, and of those by which the earlier may have been old when it was taken.
    They come on at 0 V, however long the gate had been driving by then.

    Parameters
    ----------
    values : (N, 3 + m) array
        Enabled, watchdog, heard and voltages of every cycle since a trip was cleared.
    limits : GateLimits
    """
    enabled = values[:, 0] != 0.0
    if not enabled.any():
        return 0.0
    # The first second of driving, by the device's clock.
    values = values[: int(np.argmax(enabled)) + round(REENABLE_S / limits.period_s)]
    rows = np.flatnonzero(values[:, 2] != 0.0)
    if len(rows) < 2:
        return 0.0
    volts = values[rows, STATES:]
    most = limits.reenable_step_v * (np.diff(rows) + limits.max_age_cycles) + ROUNDING_V
    moved = np.abs(np.diff(volts, axis=0)).max(axis=1)
    # 0 V may come at once.
    moved[~volts[1:].any(axis=1)] = 0.0
    return float((moved - most).max())
