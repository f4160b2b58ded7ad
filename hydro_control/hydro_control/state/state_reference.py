"""The filters over the sensors as one reads them, in numpy.

The compiled kernels of `hydro_control.state.state_kernels`, which `hydro_control.state.state`
calls, are tested against this.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_control.gains import Gains
from hydro_control.state.axes import Axis
from hydro_control.state.filters import (
    Ewma,
    FilteredDifference,
    average_age_s2,
    average_lag_s,
    difference_lag_s,
)
from hydro_control.state.state import State
from hydro_model.robot import FloatArray


class ReadableStateFilter:
    """As `hydro_control.state.state.StateFilter`, whose parameters and methods these are.

    Parameters
    ----------
    axes : sequence of Axis
    gains : Gains
    dt_s : float
    force_lag_s : (n,) array
    """

    def __init__(
        self, axes: Sequence[Axis], gains: Gains, dt_s: float, force_lag_s: FloatArray
    ) -> None:
        self._cylinders = [a.cylinder_index for a in axes]
        self._area_a_m2 = np.array([a.cylinder.area_a_m2 for a in axes])
        self._area_b_m2 = np.array([a.cylinder.area_b_m2 for a in axes])
        self._position = Ewma(gains.alpha_q)
        self._velocity = FilteredDifference(gains.alpha_qd, dt_s)
        self._pressure = Ewma(gains.alpha_p)
        self._position_lag_s = average_lag_s(gains.alpha_q, dt_s)
        self._position_age_s2 = average_age_s2(gains.alpha_q, dt_s)
        self._velocity_lag_s = difference_lag_s(gains.alpha_qd, dt_s)
        self._force_lag_s = force_lag_s + average_lag_s(gains.alpha_p, dt_s)

    def measured(
        self, q: FloatArray, pressures: FloatArray, p_s: float, p_t: float, steps: int
    ) -> State:
        """The state at a sample whose `pressures` are (2, m), `steps` samples after the last."""
        position = self._position.update(q, steps)
        velocity = self._velocity.update(q, steps)
        filtered = self._pressure.update(pressures, steps)
        at = filtered[:, self._cylinders]
        force = at[0] * self._area_a_m2 - at[1] * self._area_b_m2  # eq. 9
        return State(position, velocity, force, filtered, p_s, p_t)

    def predicted(
        self, now: State, lead_s: float, acceleration: FloatArray, force_rate: FloatArray
    ) -> State:
        """The state `lead_s` later, if what was asked for comes about.

        Parameters
        ----------
        now : State
        lead_s : float
        acceleration, force_rate : (n,) array

        Returns
        -------
        State
        """
        late, ahead = self._velocity_lag_s, lead_s + self._position_lag_s
        bent_s2 = 0.5 * (lead_s**2 - self._position_age_s2)
        return State(
            now.q + ahead * now.qd + (late * ahead + bent_s2) * acceleration,
            now.qd + (lead_s + late) * acceleration,
            now.force + (lead_s + self._force_lag_s) * force_rate,
            now.pressures,
            now.p_s,
            now.p_t,
        )
