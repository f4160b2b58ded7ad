"""The control law: eqs. 19 to 24 of the paper with the errata of its implementation.

Corrected against print: eq. 22 takes the **required** piston velocity for friction (the measured
one would remove damping), and eq. 23 is
``Q_d = (-A1/x - A2/(S - x)) xd_r - fdot_d/beta - k_f (f_d - f) - k_x (xd_r - xd)``.
Effects that the robot lists are compensated (`hydro_control.compensation`); with none listed
nothing differs from the equations. Pure: one object per run, one `step` per sample, no clock and
no ROS.
"""

from __future__ import annotations

import math

import numpy as np

from hydro_control.adaptation import Adaptation
from hydro_control.adaptation_settings import AdaptationSettings
from hydro_control.axes import axes_of
from hydro_control.checks import not_finite
from hydro_control.compensation import Compensation, Motion
from hydro_control.compensation_plan import plan
from hydro_control.errors import ControlError
from hydro_control.filters import FilteredDifference, difference_lag_s
from hydro_control.gains import Gains
from hydro_control.motion_limits import TIP_SPEED_M_S, limited, limits_of, relieved
from hydro_control.oil_columns import OilColumns, swept_columns
from hydro_control.output import Output, stopped
from hydro_control.required_motion import (
    JointMotion,
    Reference,
    desired_at,
    required_motion,
)
from hydro_control.state import State, StateFilter
from hydro_model.cylinder import lever
from hydro_model.rigid_body import required_torque
from hydro_model.robot import FloatArray, Robot
from hydro_model.valve import signal_at_lengths

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
        self.limits = limits_of(robot, tip_speed_m_s)
        self.gains = gains
        self.dt_s = 1.0 / robot.sensors.rate_hz if dt_s is None else dt_s
        self._axes = axes_of(robot)
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
        self._rated_v = np.array([valve.rated_voltage_v for valve in robot.valves])
        self._state = StateFilter(self._axes, gains, self.dt_s, force_lag_s)
        self._force_rate = FilteredDifference(gains.alpha_fd, self.dt_s)
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
        self._force_rate.reset()
        if self.adaptation is not None:
            self.adaptation.forget()
        if self.compensation is not None:
            self.compensation.reset()
        self._asked_acceleration = self._asked_force_rate = np.zeros(self.robot.dof)
        self._last_s = None

    def wind_down(self) -> FloatArray:
        """The next voltage on the way to 0 V within the slew limit, (m,)."""
        self._forget()
        return self._slewed(np.zeros_like(self._voltage_v))

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
        fault = not_finite(stamp_s, q, p_a, p_b, p_s, p_t, reference)
        if fault:
            self.reset()
            return stopped(q, reference, len(self._voltage_v), fault)
        steps, notes = self._advance(stamp_s)
        now = state = self._state.measured(q, np.array([p_a, p_b]), p_s, p_t, steps)
        if ahead is not None:
            rates = self._asked_acceleration, self._asked_force_rate
            state = self._state.predicted(now, self.lead_s, *rates)
        aim = reference if ahead is None else ahead
        asked = required_motion(self.robot, state.q, state.qd, aim, self.gains.k_p_1_s)
        asked = limited(self.robot, self.limits, state.q, state.qd, asked)
        self._asked_acceleration = asked.qdd_r
        motion = asked if ahead is None else desired_at(self.robot, now.q, reference, asked)
        arm = np.array(
            [float(lever(a.cylinder, x)) for a, x in zip(self._axes, state.q, strict=True)]
        )
        xd, xd_r = arm * state.qd, arm * asked.qd_r
        columns = self._columns(
            Motion(
                stamp_s, state.q, asked.qd_r, asked.qdd_r, arm, now.pressures, p_s, p_t, now.force
            )
        )
        force_d = self._required_force(state, asked, arm, xd_r)
        flow_term = self._flow_term(columns, xd, xd_r, state.force, force_d, steps)
        signal = self._signals(flow_term, columns, state, steps)
        if not math.isfinite(float(signal.sum())):
            self.reset()
            fault = f"expected finite valve signals, found {signal.tolist()}"
            return stopped(q, reference, len(self._voltage_v), fault)
        voltage_v = self._driven(signal, now.pressures)
        if self.adaptation is not None:
            self.adaptation.observe(q, np.array([p_a, p_b]), p_s, p_t, voltage_v, steps)
        return Output(
            voltage_v=voltage_v,
            valve_signal=signal,
            flow_term=flow_term,
            required_force_n=force_d,
            force_n=now.force,
            required_piston_velocity_m_s=xd_r,
            piston_velocity_m_s=xd if state is now else arm * now.qd,
            q_d=motion.q_d,
            qd_d=motion.qd_d,
            tip_d_m=motion.tip_d_m,
            notes=(*notes, *motion.notes),
        )

    def _columns(self, seen: Motion) -> OilColumns:
        """Oil columns at the required motion, as the listed effects have them."""
        columns = swept_columns(self._axes, seen.q)
        if self.compensation is None:
            return columns
        self.compensation.observe(seen, columns)
        return self.compensation.columns(columns)

    def _required_force(
        self, state: State, asked: JointMotion, arm: FloatArray, xd_r: FloatArray
    ) -> FloatArray:
        """Required piston force of eq. 22, N."""
        torque = required_torque(
            self.robot, state.q, state.qd, asked.qd_r, asked.qdd_r, self.gains.k_v
        )
        force_d = torque / arm + self._friction(xd_r)
        if self.compensation is not None:
            force_d += self.compensation.friction()
        if self.adaptation is not None:
            force_d += self.adaptation.required_force(
                state.q, state.qd, asked.qd_r, asked.qdd_r, arm
            )
        return np.asarray(force_d)

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

    def _friction(self, xd_r: FloatArray) -> FloatArray:
        """Piston friction at the required velocity (last term of eq. 22), N."""
        return np.array(
            [a.cylinder.viscous_friction * v for a, v in zip(self._axes, xd_r, strict=True)]
        )

    def _flow_term(
        self,
        columns: OilColumns,
        xd: FloatArray,
        xd_r: FloatArray,
        force: FloatArray,
        force_d: FloatArray,
        steps: int,
    ) -> FloatArray:
        """Q_d of eq. 23 (corrected), m^2/s."""
        gains = self.gains
        rate = self._asked_force_rate = self._force_rate.update(force_d, steps)
        feedback = gains.k_f_m2_ns * (force_d - force) + gains.k_x_m * (xd_r - xd)
        forward = np.empty_like(xd)
        for i, axis in enumerate(self._axes):
            c = axis.cylinder
            area = c.area_a_m2 / columns.a_m[i] + c.area_b_m2 / columns.b_m[i]
            forward[i] = -area * xd_r[i] - rate[i] / c.bulk_modulus_pa
        if columns.leak is not None:
            forward += columns.leak
        return forward - feedback

    def _signals(
        self, flow_term: FloatArray, columns: OilColumns, state: State, steps: int
    ) -> FloatArray:
        """Normalised valve signals of eq. 24, for the edges and then for the valve."""
        opening = np.empty_like(flow_term)
        for i, axis in enumerate(self._axes):
            p_a, p_b = state.pressures[:, axis.cylinder_index]
            lengths = columns.a_m[i], columns.b_m[i]
            u = signal_at_lengths(
                axis.valve, flow_term[i], *lengths, p_a, p_b, state.p_s, state.p_t
            )
            opening[i] = float(u)
        if self.adaptation is not None:
            opening -= self.adaptation.null_bias
        if self.compensation is None:
            return opening
        return self.compensation.signals(opening, steps)

    def _driven(self, signal: FloatArray, pressures: FloatArray) -> FloatArray:
        """Voltages in the robot's order of valves: relieved, saturated and slewed."""
        wanted = np.zeros_like(self._rated_v)
        for i, axis in enumerate(self._axes):
            p_a, p_b = pressures[:, axis.cylinder_index].tolist()
            u = relieved(float(signal[i]), p_a, p_b, self.limits.pressure_pa)
            wanted[axis.valve_index] = u * axis.valve.rated_voltage_v
        return self._slewed(np.clip(wanted, -self._rated_v, self._rated_v))

    def _slewed(self, wanted_v: FloatArray) -> FloatArray:
        # One sample time's worth even after lost samples: whoever checks the rate downstream
        # may not have lost them.
        most = self.gains.slew_limit_v_s * self.dt_s
        self._voltage_v = np.clip(wanted_v, self._voltage_v - most, self._voltage_v + most)
        return self._voltage_v.copy()
