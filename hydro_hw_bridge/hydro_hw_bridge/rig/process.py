"""Random forces on the pistons and motions of the spools: what no model explains."""

from __future__ import annotations

import numpy as np

from hydro_hw_bridge.rig.extras import MachineExtras
from hydro_model.robot import FloatArray


class Process:
    """First-order random processes of every cylinder, drawn cycle by cycle.

    Two forces, a quick and a slow one, and a motion of the spool.

    Parameters
    ----------
    machine : MachineExtras
    count : int
        Cylinders.
    cycle_s : float
    """

    def __init__(self, machine: MachineExtras, count: int, cycle_s: float) -> None:
        self._count = count
        self._random = np.random.default_rng(machine.process_seed)
        kinds = (
            (machine.disturbance_n, machine.disturbance_time_s),
            (machine.gust_n, machine.gust_time_s),
            (machine.shake, machine.shake_time_s),
        )
        self._size = np.array([size for size, _ in kinds])[:, None]
        self._keep = np.exp([-cycle_s / time for _, time in kinds])[:, None]
        self._level = np.zeros((len(kinds), count))

    def draw(self, cycles: int) -> tuple[FloatArray, FloatArray]:
        """Forces in N and spool motions of the next cycles, (cycles, count) each."""
        out = np.zeros((cycles, *self._level.shape))
        if self._size.any():
            fresh = self._random.standard_normal(out.shape)
            fresh *= self._size * np.sqrt(1.0 - self._keep**2)
            for k in range(cycles):
                self._level = self._keep * self._level + fresh[k]
                out[k] = self._level
        return out[:, 0] + out[:, 1], out[:, 2]
