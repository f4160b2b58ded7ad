"""The control law: eqs. 19 to 24 of the paper with the errata of its implementation.

Corrected against print: eq. 22 takes the **required** piston velocity for friction (the measured
one would remove damping), and eq. 23 is
``Q_d = (-A1/x - A2/(S - x)) xd_r - fdot_d/beta - k_f (f_d - f) - k_x (xd_r - xd)``.
Effects that the robot lists are compensated (`hydro_control.compensation.compensation`); with none
listed nothing differs from the equations. They run compiled (`hydro_control.law.step_kernels`);
the same, readable and in numpy, is in `hydro_control.law.law_reference`. Pure: one object per run,
one `step` per sample, no clock and no ROS.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hydro_control.adaptation.adaptation import Adaptation
from hydro_control.adaptation.adaptation_settings import AdaptationSettings
from hydro_control.compensation.compensation import Compensation
from hydro_control.compensation.compensation_plan import plan
from hydro_control.errors import ControlError
from hydro_control.gains import Gains
from hydro_control.law.checks import not_finite, not_finite_answer
from hydro_control.law.law_arrays import OPEN_LOWER, OPEN_UPPER, SLEW, law_arrays, law_work
from hydro_control.law.law_kernels import ROWS, Required
from hydro_control.law.motion_kernels import limit_notes
from hydro_control.law.output import Output, stopped
from hydro_control.law.step_kernels import force_kernel, valve_kernel
from hydro_control.motion.motion_limits import TIP_SPEED_M_S, limits_of
from hydro_control.motion.required_motion import Reference
from hydro_control.state.axes import axes_of
from hydro_control.state.filters import difference_lag_s
from hydro_control.state.state import StateFilter
from hydro_control.state.state_kernels import FORCE, QD, Q
from hydro_model.robot import FloatArray, Robot

__all__ = ["ControlLaw", "Output"]

#: Samples apart by more than this many sample times are a gap: derivatives start anew.
GAP_STEPS = 10


class _Oil(NamedTuple):
    """Measured pressures, gauge."""

    pressures: FloatArray  # (2, m) of the chambers
    p_s: float
    p_t: float


class _Sample(NamedTuple):
    """What `force_kernel` makes of a sample, for `valve_kernel` and the answer."""

    states: FloatArray  # (2, 3, n) now and, where the law looks ahead, then
    filtered: FloatArray  # (2, m) pressures of the chambers
    rows: FloatArray  # (ROWS, n) as of `hydro_control.law.law_kernels.Required`
    tip_d: FloatArray  # (3,)
    limits: int  # bits of `hydro_control.law.motion_kernels`


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
    anew : bool
        Filters know no velocity: they have taken in the newest sample alone, or none yet.

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
        self._listed = Compensation(robot, self.plan.active, self._axes, self.dt_s)
        self.compensation = self._listed if self.plan.names else None
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
        self._state = StateFilter(self._axes, gains, self.dt_s, force_lag_s)
        self._force_kept = np.full((2, robot.dof), np.nan)
        self._no_bias = np.zeros(robot.dof)
        self._asked = np.zeros((2, robot.dof))
        self._last_s: float | None = None
        self.anew = True
        self._voltage_v = np.zeros(len(robot.valves))

    def reset(self) -> None:
        """Forget all samples, and start from 0 V."""
        self._forget()
        self._voltage_v = np.zeros_like(self._voltage_v)

    def _forget(self) -> None:
        self._state.reset()
        self._listed.reset()
        self._force_kept[:] = np.nan
        self._asked[:] = 0.0
        if self.adaptation is not None:
            self.adaptation.forget()
        self._last_s, self.anew = None, True

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
        *,
        shut: bool = False,
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
        shut : bool, optional
            Take the sample in, and keep the valves at 0 V.

        Returns
        -------
        Output
            With 0 V and a fault where an input, or what follows from it, is not a finite number:
            the next sample is answered as the first.

        Raises
        ------
        ControlError
            The stamp is not after the last one, or positions or pressures are not one a joint.
        """
        if fault := not_finite(stamp_s, q, p_a, p_b, p_s, p_t, reference, ahead):
            return self.stopped(q, reference, fault)
        steps, notes = self._advance(stamp_s)
        oil = _Oil(np.array([p_a, p_b]), float(p_s), float(p_t))
        sample = self._required(stamp_s, steps, q, oil, reference, ahead)
        asked, now = Required(*sample.rows), sample.states[0]
        flow_term, signal, voltage_v, limits = self._answered(sample, oil, steps)
        if fault := not_finite_answer(flow_term, signal, voltage_v):
            return self.stopped(q, reference, fault)
        self._voltage_v = voltage_v = np.zeros_like(voltage_v) if shut else voltage_v
        if self.adaptation is not None:
            self.adaptation.observe(q, oil.pressures, p_s, p_t, voltage_v, steps)
        return Output(
            voltage_v=voltage_v.copy(),
            valve_signal=signal,
            flow_term=flow_term,
            required_force_n=asked.force_d,
            force_n=now[FORCE],
            required_piston_velocity_m_s=asked.xd_r,
            piston_velocity_m_s=asked.xd if ahead is None else asked.arm * now[QD],
            q_d=asked.q_d,
            qd_d=asked.qd_d,
            tip_d_m=sample.tip_d,
            notes=notes + limit_notes(sample.limits | limits),
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

    def _required(
        self,
        stamp_s: float,
        steps: int,
        q: FloatArray,
        oil: _Oil,
        reference: Reference,
        ahead: Reference | None,
    ) -> _Sample:
        """States, required motion and forces (eqs. 9 and 19 to 22).

        The forces are with the listed effects, and what is adapted beside the model.
        """
        wanted = aim = _rows(self._references[0], reference)
        if ahead is not None:
            aim = _rows(self._references[1], ahead)
        n, state, listed = len(self._axes), self._state, self._listed
        if q.shape != (n,) or oil.pressures.shape != (2, n):  # kernels do not look at bounds
            found = f"{q.shape} and {oil.pressures.shape}"
            raise ControlError(
                f"expected positions and pressures of {n} joints, ({n},) and (2, {n}),"
                f" found {found}"
            )
        states, filtered = np.empty((2, 3, n)), np.empty_like(oil.pressures)
        rows, tip_d = np.empty((ROWS, n)), np.empty(3)
        limits = force_kernel(
            *(self._arrays, self._work, state.arrays, state.memory, listed.arrays, listed.work),
            *(self.dt_s, float(stamp_s), steps, np.array(q, dtype=float), *oil),
            *(reference.space == "tip", wanted, ahead is not None, self.lead_s, aim),
            *(self._asked, states, filtered, rows, tip_d),
        )
        if self.adaptation is not None:
            asked, then = Required(*rows), states[1]
            motion = then[Q], then[QD], asked.qd_r, asked.qdd_r, asked.arm
            asked.force_d[:] += self.adaptation.required_force(*motion)
        return _Sample(states, filtered, rows, tip_d, limits)

    def _answered(
        self, sample: _Sample, oil: _Oil, steps: int
    ) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Q_d of eq. 23, signals of eq. 24 for the valves, voltages; what limits.

        The voltages, by valve in the robot's order, are relieved, saturated and slewed.
        """
        flow_term, signal = out = np.empty((2, len(self._axes)))
        voltage_v, listed = np.zeros(len(self._voltage_v)), self._listed
        bias = self._no_bias if self.adaptation is None else self.adaptation.null_bias
        past = (1.0 - self.gains.alpha_fd) ** steps, listed.past_opening(steps)
        limits = valve_kernel(
            *(self._arrays, listed.arrays, listed.work, self._force_kept),
            *(*past, steps * self.dt_s, bias, oil.p_s, oil.p_t, self._asked),
            # One sample time's worth of slew even after lost samples: whoever checks the rate
            # downstream may not have lost them.
            *(sample.states, sample.filtered, sample.rows, self._voltage_v, *out, voltage_v),
        )
        return flow_term, signal, voltage_v, limits

    def _advance(self, stamp_s: float) -> tuple[int, tuple[str, ...]]:
        """Sample times since the last sample, 1 at the start and after a gap."""
        last, self._last_s = self._last_s, stamp_s
        if last is None:
            return 1, ()
        if stamp_s <= last:
            raise ControlError(f"expected a stamp after {last} s, found {stamp_s} s")
        steps = max(1, round((stamp_s - last) / self.dt_s))
        if steps <= GAP_STEPS:
            self.anew = False
            return steps, ()
        self._forget()
        self._last_s = stamp_s
        return 1, (f"gap of {stamp_s - last:.3f} s, filters start anew",)


def _rows(tables: dict[str, FloatArray], reference: Reference) -> FloatArray:
    """A reference as the kernels take it, in the one of the tables of its space."""
    rows = tables[reference.space]
    rows[0], rows[1], rows[2] = reference.position, reference.velocity, reference.acceleration
    return rows
