"""What sensors show: the signals of a recording that effects of instruments alter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hydro_model.robot import FloatArray

#: Index of all chambers' pressures together, for an effect that they share.
EVERY_CHAMBER = -1


@dataclass(frozen=True, slots=True)
class Readings:
    """Sampled signals of a machine with n joints and m cylinders; N samples.

    Attributes
    ----------
    step_s : float
        Sampling interval.
    q : (N, n) array
        Joint positions, rad or m.
    p_a, p_b : (N, m) array
        Gauge pressures, Pa.
    supply, tank : (N,) array
        Gauge, Pa.
    valve_signal : (N, m) array
        Normalised, as recorded with each sample.
    torque : (N, n) array
        Measured joint torque, N m (N on a prismatic joint); NaN where there is none.
    """

    step_s: float
    q: FloatArray
    p_a: FloatArray
    p_b: FloatArray
    supply: FloatArray
    tank: FloatArray
    valve_signal: FloatArray
    torque: FloatArray

    def pressure(self, index: int) -> FloatArray:
        """Pressure by its index in `Robot.pressure_names`, (N,)."""
        m = self.p_a.shape[1]
        if index >= 2 * m:
            return self.supply if index == 2 * m else self.tank
        return np.asarray((self.p_b if index % 2 else self.p_a)[:, index // 2])

    def with_pressure(self, index: int, values: FloatArray) -> Readings:
        """The readings with one pressure replaced."""
        m = self.p_a.shape[1]
        if index == 2 * m:
            return replace(self, supply=values)
        if index > 2 * m:
            return replace(self, tank=values)
        chambers = (self.p_b if index % 2 else self.p_a).copy()
        chambers[:, index // 2] = values
        return replace(self, p_b=chambers) if index % 2 else replace(self, p_a=chambers)


def delayed(values: FloatArray, lag_s: float, step_s: float) -> FloatArray:
    """Samples as they were `lag_s` earlier (later, where negative), by linear interpolation.

    Parameters
    ----------
    values : (N,) or (N, k) array
    lag_s, step_s : float

    Returns
    -------
    array
        Same shape; the first (last) value holds where the time lies outside. NaN spreads to
        the samples interpolated from it.
    """
    count = len(values)
    if count == 0:
        return values.copy()
    at = np.clip(np.arange(count) - lag_s / step_s, 0.0, count - 1.0)
    low = np.minimum(np.floor(at).astype(int), max(count - 2, 0))
    high = np.minimum(low + 1, count - 1)
    share = at - low
    if values.ndim > 1:
        share = share[:, None]
    # Where a share is zero its sample must not count, or one NaN would spoil its neighbour.
    before = np.where(share < 1.0, values[low] * (1.0 - share), 0.0)
    after = np.where(share > 0.0, values[high] * share, 0.0)
    return np.asarray(before + after)
