"""The state of the robot as the control law takes it: filtered, and predicted for the valve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro_control.gains import Gains
from hydro_control.state.axes import Axis
from hydro_control.state.filters import average_age_s2, average_lag_s, difference_lag_s
from hydro_control.state.state_kernels import (
    FORCE,
    QD,
    Q,
    StateArrays,
    StateMemory,
    measured_kernel,
    predicted_kernel,
)
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
    """The filters of section V over the sensors, compiled.

    The same in numpy is in `hydro_control.state.state_reference`. The law hands `arrays` and
    `memory` to `hydro_control.law.step_kernels`, which does what the methods do.

    Parameters
    ----------
    axes : sequence of Axis
    gains : Gains
    dt_s : float
    force_lag_s : (n,) array
        By which pressures are late before they are filtered.

    Attributes
    ----------
    arrays : StateArrays
    memory : StateMemory
        What the kernels take.
    """

    def __init__(
        self, axes: Sequence[Axis], gains: Gains, dt_s: float, force_lag_s: FloatArray
    ) -> None:
        lags = average_lag_s(gains.alpha_q, dt_s), average_age_s2(gains.alpha_q, dt_s)
        sides = [(a.cylinder.area_a_m2, a.cylinder.area_b_m2) for a in axes]
        self._dt_s = dt_s
        self.arrays = StateArrays(
            alpha=np.array([gains.alpha_q, gains.alpha_qd, gains.alpha_p]),
            late=np.array([*lags, difference_lag_s(gains.alpha_qd, dt_s)]),
            force_lag_s=force_lag_s + average_lag_s(gains.alpha_p, dt_s),
            area=np.array(sides).T.copy(),
            cylinder=np.array([a.cylinder_index for a in axes], dtype=np.int64),
        )
        n = len(axes)  # of cylinders, too: each moves a joint, and each joint has one
        self.memory = StateMemory(np.empty(n), np.empty((2, n)), np.empty((2, n)))
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        for part in self.memory:
            part[:] = np.nan

    def measured(
        self, q: FloatArray, pressures: FloatArray, p_s: float, p_t: float, steps: int
    ) -> State:
        """The state at a sample, `steps` sample times after the one before."""
        out, filtered = np.empty((3, len(q))), np.empty_like(pressures)
        given = q, pressures, steps, self._dt_s
        measured_kernel(self.arrays, self.memory, *given, out, filtered)
        return State(out[Q], out[QD], out[FORCE], filtered, p_s, p_t)

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
        out, moving = np.empty((3, len(now.q))), (now.q, now.qd, now.force)
        predicted_kernel(self.arrays, *moving, lead_s, acceleration, force_rate, out)
        return State(out[Q], out[QD], out[FORCE], now.pressures, now.p_s, now.p_t)
