"""The control law: eqs. 19 to 24 of the paper with the errata of its implementation.

Corrected against print: eq. 22 takes the **required** piston velocity for friction (the measured
one would remove damping), and eq. 23 is
``Q_d = (-A1/x - A2/(S - x)) xd_r - fdot_d/beta - k_f (f_d - f) - k_x (xd_r - xd)``.
Effects that the robot lists are compensated (`hydro_control.compensation`); with none listed
nothing differs from the equations. They run compiled (`hydro_control.law_kernels`); the same,
readable and in numpy, is in `hydro_control.law_reference`. Pure: one object per run, one `step`
per sample, no clock and no ROS.
"""

from __future__ import annotations

import math

import numpy as np

from hydro_control.adaptation import Adaptation
from hydro_control.adaptation_settings import AdaptationSettings
from hydro_control.axes import axes_of
from hydro_control.checks import not_finite
from hydro_control.compensation import Compensation
from hydro_control.compensation_plan import plan
from hydro_control.errors import ControlError
from hydro_control.filters import difference_lag_s
from hydro_control.gains import Gains
from hydro_control.law_arrays import OPEN_LOWER, OPEN_UPPER, SLEW, law_arrays, law_work
from hydro_control.law_kernels import (
    ROWS,
    Required,
    flow_kernel,
    required_kernel,
    voltage_kernel,
)
from hydro_control.motion_kernels import limit_notes
from hydro_control.motion_limits import TIP_SPEED_M_S, limits_of
from hydro_control.output import Output, stopped
from hydro_control.required_motion import Reference
from hydro_control.state import State, StateFilter
from hydro_control.state_kernels import difference_kernel
from hydro_model.robot import FloatArray, Robot

__all__ = ["ControlLaw", "Output"]

#: Samples apart by more than this many sample times are a gap: derivatives start anew.
GAP_STEPS = 10


class ControlLaw:
    """The controller of one robot.

    Parameters
    ----------
    robot : Robot
        Every joint needs a cylinder with a valve.
    gains : Gains
    dt_s : float, optional
        Sample time; by default the sensors' rate.
    adaptation : AdaptationSettings, optional
        Off by default.
    tip_speed_m_s : float
        Required motion of the tip is never faster.

    Attributes
    ----------
    limits : MotionLimits
    plan : CompensationPlan
        What becomes of the effects that the robot lists.
    compensation : Compensation or None
        None where no listed effect is compensated.
    lead_s : float
        How far ahead of a sample `step` wants to know the reference; 0 where not at all.
    adaptation : Adaptation or None
        What is estimated beside the model; its estimates outlive `reset`.

    Raises
    ------
    ControlError
        A lever arm vanishes within the joint limits, or a velocity limit is not above 0.
    RobotError
        A joint has no cylinder, a cylinder no valve, or a listed effect does not resolve.
    """

    def __init__(
        self,
        robot: Robot,
        gains: Gains,
        dt_s: float | None = None,
        adaptation: AdaptationSettings | None = None,
        tip_speed_m_s: float = TIP_SPEED_M_S,
    ) -> None:
        self.plan = plan(robot)
        robot = self.robot = self.plan.robot
        self._axes = axes_of(robot)
        self.limits = limits_of(robot, tip_speed_m_s)
        self.gains = gains
        self.dt_s = 1.0 / robot.sensors.rate_hz if dt_s is None else dt_s
        self.compensation = self._compensation()
        self.adaptation = (
            Adaptation(robot, adaptation, self.dt_s, self.plan.active)
            if adaptation is not None and adaptation.on
            else None
        )
        self.lead_s, force_lag_s = 0.0, np.zeros(robot.dof)
        if self.compensation is not None:
            # The rate of the required force is as late as its filter: it is asked for earlier.
            self.lead_s = self.compensation.delay_s + difference_lag_s(gains.alpha_fd, self.dt_s)
            force_lag_s = self.compensation.force_lag_s
        self._arrays = law_arrays(robot, self._axes, self.limits, gains, self.dt_s)
        self._work = law_work(self._arrays)
        sizes = {"tip": 3, "joint": robot.dof}
        self._references = [{s: np.empty((3, k)) for s, k in sizes.items()} for _ in range(2)]
        self._no_leak = np.zeros(robot.dof)
        self._state = StateFilter(self._axes, gains, self.dt_s, force_lag_s)
        self._force_kept = np.full((2, robot.dof), np.nan)
        self._last_s: float | None = None
        self._voltage_v = np.zeros(len(robot.valves))
        self._asked_acceleration = self._asked_force_rate = np.zeros(robot.dof)

    def _compensation(self) -> Compensation | None:
        if not self.plan.names:
            return None
        return Compensation(self.robot, self.plan.active, self._axes, self.dt_s)

    def reset(self) -> None:
        """Forget all samples, and start from 0 V."""
        self._forget()
        self._voltage_v = np.zeros_like(self._voltage_v)

    def _forget(self) -> None:
        self._state.reset()
        self._force_kept[:] = np.nan
        if self.adaptation is not None:
            self.adaptation.forget()
        if self.compensation is not None:
            self.compensation.reset()
        self._asked_acceleration = self._asked_force_rate = np.zeros(self.robot.dof)
        self._last_s = None

    def wind_down(self) -> FloatArray:
        """The next voltage on the way to 0 V within the slew limit, (m,)."""
        self._forget()
        most = self._arrays.gains[SLEW]
        self._voltage_v = self._voltage_v - np.clip(self._voltage_v, -most, most)
        return self._voltage_v.copy()

    def step(
        self,
        stamp_s: float,
        q: FloatArray,
        p_a: FloatArray,
        p_b: FloatArray,
        p_s: float,
        p_t: float,
        reference: Reference,
        ahead: Reference | None = None,
    ) -> Output:
        """Answer one sample.

        Parameters
        ----------
        stamp_s : float
            Time of the sample; must grow from step to step.
        q : (n,) array
            Joint positions.
        p_a, p_b : (m,) array
            Gauge pressures per cylinder in the robot's order, Pa.
        p_s, p_t : float
            Gauge supply and tank pressure, Pa.
        reference : Reference
        ahead : Reference, optional
            The reference `lead_s` later. Given it, the required quantities are those of that
            instant, for the state predicted for it; `q_d`, `qd_d` and `tip_d_m` are the sample's.

        Returns
        -------
        Output
            With 0 V and a fault where an input is not a finite number.

        Raises
        ------
        ControlError
            The stamp is not after the last one.
        """
        if fault := not_finite(stamp_s, q, p_a, p_b, p_s, p_t, reference):
            return self.stopped(q, reference, fault)
        steps, notes = self._advance(stamp_s)
        now = state = self._state.measured(q, np.array([p_a, p_b]), p_s, p_t, steps)
        if ahead is not None:
            rates = self._asked_acceleration, self._asked_force_rate
            state = self._state.predicted(now, self.lead_s, *rates)
        rows, tip_d, limits = self._require(now, state, reference, ahead)
        asked = Required(*rows)
        self._asked_acceleration = asked.qdd_r
        leak = self._add_listed(stamp_s, now, state, rows)
        rate = self._asked_force_rate = self._force_rate(asked.force_d, steps)
        flow_term, signal, starved = self._signals(state, rows, rate, leak, steps)
        if not math.isfinite(sum(signal.tolist())):
            fault = f"expected finite valve signals, found {signal.tolist()}"
            return self.stopped(q, reference, fault)
        voltage_v, relieved = self._driven(signal, now.pressures)
        if self.adaptation is not None:
            self.adaptation.observe(q, np.array([p_a, p_b]), p_s, p_t, voltage_v, steps)
        return Output(
            voltage_v=voltage_v,
            valve_signal=signal,
            flow_term=flow_term,
            required_force_n=asked.force_d,
            force_n=now.force,
            required_piston_velocity_m_s=asked.xd_r,
            piston_velocity_m_s=asked.xd if state is now else asked.arm * now.qd,
            q_d=asked.q_d,
            qd_d=asked.qd_d,
            tip_d_m=tip_d,
            notes=notes + limit_notes(limits | starved | relieved),
        )

    def let_beyond(self, lower: FloatArray, upper: FloatArray) -> None:
        """Let joints be beyond their ends, where the machine stands there already.

        Parameters
        ----------
        lower, upper : (n,) array
            Where they may be, rad or m. Required motion never leads further out.
        """
        self._arrays.limits[OPEN_LOWER], self._arrays.limits[OPEN_UPPER] = lower, upper

    def stopped(self, q: FloatArray, reference: Reference, fault: str) -> Output:
        """Answer a sample with 0 V, and forget those before.

        Parameters
        ----------
        q : (n,) array
            Joint positions, rad or m.
        reference : Reference
        fault : str
            Why.

        Returns
        -------
        Output
        """
        self.reset()
        return stopped(q, reference, len(self._voltage_v), fault)

    def _require(
        self, now: State, state: State, reference: Reference, ahead: Reference | None
    ) -> tuple[FloatArray, FloatArray, int]:
        """Required motion and force of the model (eqs. 19 to 22); desired tip; what limited it."""
        wanted = aim = _rows(self._references[0], reference)
        if ahead is not None:
            aim = _rows(self._references[1], ahead)
        out = np.empty((ROWS, len(now.q))), np.empty(3)
        when = (state.q, state.qd, aim, now.q, wanted)
        in_tip = reference.space == "tip"
        limits = required_kernel(self._arrays, self._work, in_tip, *when, *out)
        return *out, limits

    def _add_listed(
        self, stamp_s: float, now: State, state: State, rows: FloatArray
    ) -> FloatArray:
        """What listed effects and estimates add to force and oil columns; flow past the valve."""
        leak = self._no_leak
        if self.compensation is not None:
            leak = self.compensation.add(stamp_s, state.q, rows, now)
        if self.adaptation is not None:
            asked = Required(*rows)
            asked.force_d[:] += self.adaptation.required_force(
                state.q, state.qd, asked.qd_r, asked.qdd_r, asked.arm
            )
        return leak

    def _force_rate(self, force_d: FloatArray, steps: int) -> FloatArray:
        """Filtered rate of the required force, (n,) N/s."""
        rate, past = np.empty(len(force_d)), (1.0 - self.gains.alpha_fd) ** steps
        difference_kernel(self._force_kept, force_d, past, steps * self.dt_s, rate)
        return rate

    def _advance(self, stamp_s: float) -> tuple[int, tuple[str, ...]]:
        """Sample times since the last sample, 1 at the start and after a gap."""
        last, self._last_s = self._last_s, stamp_s
        if last is None:
            return 1, ()
        if stamp_s <= last:
            raise ControlError(f"expected a stamp after {last} s, found {stamp_s} s")
        steps = max(1, round((stamp_s - last) / self.dt_s))
        if steps <= GAP_STEPS:
            return steps, ()
        self._forget()
        self._last_s = stamp_s
        return 1, (f"gap of {stamp_s - last:.3f} s, filters start anew",)

    def _signals(
        self, state: State, rows: FloatArray, rate: FloatArray, leak: FloatArray, steps: int
    ) -> tuple[FloatArray, FloatArray, int]:
        """Q_d of eq. 23, signals of eq. 24 for the edges and then for the valve; what limits."""
        flow_term, opening = out = np.empty((2, len(rate)))
        oil = state.pressures, float(state.p_s), float(state.p_t)
        limited = flow_kernel(self._arrays, rows, state.force, rate, leak, *oil, *out)
        if self.adaptation is not None:
            opening -= self.adaptation.null_bias
        if self.compensation is None:
            return flow_term, opening, limited
        return flow_term, self.compensation.signals(opening, steps), limited

    def _driven(self, signal: FloatArray, pressures: FloatArray) -> tuple[FloatArray, int]:
        """Voltages in the robot's order of valves: relieved, saturated and slewed."""
        before_v, self._voltage_v = self._voltage_v, np.zeros(len(self._voltage_v))
        # One sample time's worth even after lost samples: whoever checks the rate downstream
        # may not have lost them.
        limited = voltage_kernel(self._arrays, signal, pressures, before_v, self._voltage_v)
        return self._voltage_v.copy(), limited


def _rows(tables: dict[str, FloatArray], reference: Reference) -> FloatArray:
    """A reference as the kernels take it, in the one of the tables of its space."""
    rows = tables[reference.space]
    rows[0], rows[1], rows[2] = reference.position, reference.velocity, reference.acceleration
    return rows
