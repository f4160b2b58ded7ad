"""The state of the robot as the control law takes it: filtered, and predicted for the valve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_control.axes import Axis
from hydro_control.filters import (
    Ewma,
    FilteredDifference,
    average_age_s2,
    average_lag_s,
    difference_lag_s,
)
from hydro_control.gains import Gains
from hydro_model.robot import FloatArray


@dataclass(frozen=True, slots=True)
class State:
    """The robot at an instant.

    Attributes
    ----------
    q, qd, force : (n,) array
        Joint positions and velocities, piston forces.
    pressures : (2, m) array
        Gauge, per cylinder in the robot's order.
    p_s, p_t : float
        Gauge supply and tank pressure.
    """

    q: FloatArray
    qd: FloatArray
    force: FloatArray
    pressures: FloatArray
    p_s: float
    p_t: float


class StateFilter:
    """The filters of section V over the sensors.

    Parameters
    ----------
    axes : sequence of Axis
    gains : Gains
    dt_s : float
    force_lag_s : (n,) array
        By which pressures are late before they are filtered.
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

    def reset(self) -> None:
        """Forget all samples."""
        for part in (self._position, self._velocity, self._pressure):
            part.reset()

    def measured(
        self, q: FloatArray, pressures: FloatArray, p_s: float, p_t: float, steps: int
    ) -> State:
        """The state at a sample, `steps` sample times after the one before."""
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

        What is filtered is late by its filter besides. Pressures stay as they are: valves answer
        to their square roots.

        Parameters
        ----------
        now : State
        lead_s : float
        acceleration, force_rate : (n,) array
            Of the joints and of the piston forces, as asked for one sample ago.

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
