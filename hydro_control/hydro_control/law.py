"""The control law: eqs. 19 to 24 of the paper with the errata of its implementation.

Corrected against print: eq. 22 takes the **required** piston velocity for friction (the measured
one would remove damping), and eq. 23 is
``Q_d = (-A1/x - A2/(S - x)) xd_r - fdot_d/beta - k_f (f_d - f) - k_x (xd_r - xd)``.
Pure: one object per run, one `step` per sample, no clock and no ROS.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro_control.adaptation import Adaptation
from hydro_control.adaptation_settings import AdaptationSettings
from hydro_control.axes import Axis, axes_of
from hydro_control.checks import not_finite
from hydro_control.errors import ControlError
from hydro_control.filters import Ewma, FilteredDifference
from hydro_control.gains import Gains
from hydro_control.required_motion import Reference, required_motion
from hydro_model.cylinder import lever, piston_force, stroke
from hydro_model.rigid_body import required_torque
from hydro_model.robot import FloatArray, Robot
from hydro_model.valve import valve_signal

#: Share of the stroke kept from either end, so that eq. 23 stays finite at the end stops.
STROKE_MARGIN = 0.01
#: Samples apart by more than this many sample times are a gap: derivatives start anew.
GAP_STEPS = 10


@dataclass(frozen=True, slots=True)
class Output:
    """One answer of the law. Arrays are (n,), one per joint, but for the voltage.

    Attributes
    ----------
    voltage_v : (m,) array
        Per valve, in the robot's order: saturated, slewed; 0 on a fault.
    valve_signal : array
        Normalised signal u before saturation (eq. 24).
    flow_term : array
        Q_d in m^2/s (eq. 23).
    required_force_n, force_n : array
        Piston force required (eq. 22) and measured, N.
    required_piston_velocity_m_s, piston_velocity_m_s : array
    q_d, qd_d : array
        Desired joint position and velocity, for `/joint_reference`.
    tip_d_m : (3,) array
        Desired tip position, for `/tip_reference`.
    notes : tuple of str
        What was limited or started anew.
    fault : str
        Empty, or why the voltage is 0.
    """

    voltage_v: FloatArray
    valve_signal: FloatArray
    flow_term: FloatArray
    required_force_n: FloatArray
    force_n: FloatArray
    required_piston_velocity_m_s: FloatArray
    piston_velocity_m_s: FloatArray
    q_d: FloatArray
    qd_d: FloatArray
    tip_d_m: FloatArray
    notes: tuple[str, ...] = ()
    fault: str = ""


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

    Attributes
    ----------
    adaptation : Adaptation or None
        What is estimated beside the model; its estimates outlive `reset`.

    Raises
    ------
    ControlError
        A lever arm vanishes within the joint limits, or a velocity limit is not above 0.
    RobotError
        A joint has no cylinder or a cylinder no valve.
    """

    def __init__(
        self,
        robot: Robot,
        gains: Gains,
        dt_s: float | None = None,
        adaptation: AdaptationSettings | None = None,
    ) -> None:
        self.robot, self.gains = robot, gains
        self.dt_s = 1.0 / robot.sensors.rate_hz if dt_s is None else dt_s
        self._axes = axes_of(robot)
        self.adaptation = (
            Adaptation(robot, adaptation, self.dt_s)
            if adaptation is not None and adaptation.on
            else None
        )
        self._rated_v = np.array([valve.rated_voltage_v for valve in robot.valves])
        self._position = Ewma(gains.alpha_q)
        self._velocity = FilteredDifference(gains.alpha_qd, self.dt_s)
        self._pressure = Ewma(gains.alpha_p)
        self._force_rate = FilteredDifference(gains.alpha_fd, self.dt_s)
        self._last_s: float | None = None
        self._voltage_v = np.zeros(len(robot.valves))

    def reset(self) -> None:
        """Forget all samples, and start from 0 V."""
        self._forget()
        self._voltage_v = np.zeros_like(self._voltage_v)

    def _forget(self) -> None:
        for part in (self._position, self._velocity, self._pressure, self._force_rate):
            part.reset()
        if self.adaptation is not None:
            self.adaptation.forget()
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
            return self._stopped(q, reference, fault)
        steps, notes = self._advance(stamp_s)
        q_f = self._position.update(q, steps)
        qd = self._velocity.update(q, steps)
        pressures = self._pressure.update(np.array([p_a, p_b]), steps)
        motion = required_motion(self.robot, q_f, qd, reference, self.gains.k_p_1_s)
        torque = required_torque(self.robot, q_f, qd, motion.qd_r, motion.qdd_r, self.gains.k_v)
        arm = np.array([float(lever(a.cylinder, x)) for a, x in zip(self._axes, q_f, strict=True)])
        xd, xd_r = arm * qd, arm * motion.qd_r
        force_d = torque / arm + self._friction(xd_r)
        if self.adaptation is not None:
            force_d += self.adaptation.required_force(q_f, qd, motion.qd_r, motion.qdd_r, arm)
        force = self._forces(pressures)
        flow_term = self._flow_term(q_f, xd, xd_r, force, force_d, steps)
        signal = self._signals(flow_term, q_f, pressures, p_s, p_t)
        if self.adaptation is not None:
            signal -= self.adaptation.null_bias
        voltage_v = self._driven(signal)
        if self.adaptation is not None:
            self.adaptation.observe(q, np.array([p_a, p_b]), p_s, p_t, voltage_v, steps)
        return Output(
            voltage_v=voltage_v,
            valve_signal=signal,
            flow_term=flow_term,
            required_force_n=force_d,
            force_n=force,
            required_piston_velocity_m_s=xd_r,
            piston_velocity_m_s=xd,
            q_d=motion.q_d,
            qd_d=motion.qd_d,
            tip_d_m=motion.tip_d_m,
            notes=(*notes, *motion.notes),
        )

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

    def _forces(self, pressures: FloatArray) -> FloatArray:
        return np.array(
            [float(piston_force(a.cylinder, *pressures[:, a.cylinder_index])) for a in self._axes]
        )

    def _stroke(self, axis: Axis, q: float) -> float:
        length = axis.cylinder.stroke_m
        x = float(stroke(axis.cylinder, q))
        return min(max(x, STROKE_MARGIN * length), (1.0 - STROKE_MARGIN) * length)

    def _flow_term(
        self,
        q: FloatArray,
        xd: FloatArray,
        xd_r: FloatArray,
        force: FloatArray,
        force_d: FloatArray,
        steps: int,
    ) -> FloatArray:
        """Q_d of eq. 23 (corrected), m^2/s."""
        gains = self.gains
        rate = self._force_rate.update(force_d, steps)
        feedback = gains.k_f_m2_ns * (force_d - force) + gains.k_x_m * (xd_r - xd)
        forward = np.empty_like(xd)
        for i, axis in enumerate(self._axes):
            c = axis.cylinder
            x = self._stroke(axis, q[i])
            area = c.area_a_m2 / x + c.area_b_m2 / (c.stroke_m - x)
            forward[i] = -area * xd_r[i] - rate[i] / c.bulk_modulus_pa
        return forward - feedback

    def _signals(
        self, flow_term: FloatArray, q: FloatArray, pressures: FloatArray, p_s: float, p_t: float
    ) -> FloatArray:
        """Normalised valve signals of eq. 24."""
        signal = np.empty_like(flow_term)
        for i, axis in enumerate(self._axes):
            p_a, p_b = pressures[:, axis.cylinder_index]
            x = self._stroke(axis, q[i])
            u = valve_signal(axis.valve, axis.cylinder, flow_term[i], x, p_a, p_b, p_s, p_t)
            signal[i] = float(u)
        return signal

    def _driven(self, signal: FloatArray) -> FloatArray:
        """Voltages in the robot's order of valves, saturated and slewed."""
        wanted = np.zeros_like(self._rated_v)
        for i, axis in enumerate(self._axes):
            wanted[axis.valve_index] = signal[i] * axis.valve.rated_voltage_v
        return self._slewed(np.clip(wanted, -self._rated_v, self._rated_v))

    def _slewed(self, wanted_v: FloatArray) -> FloatArray:
        # One sample time's worth even after lost samples: whoever checks the rate downstream
        # may not have lost them.
        most = self.gains.slew_limit_v_s * self.dt_s
        self._voltage_v = np.clip(wanted_v, self._voltage_v - most, self._voltage_v + most)
        return self._voltage_v.copy()

    def _stopped(self, q: FloatArray, reference: Reference, fault: str) -> Output:
        zero = np.zeros(self.robot.dof)
        joint = reference.space == "joint"
        return Output(
            voltage_v=np.zeros_like(self._rated_v),
            valve_signal=zero,
            flow_term=zero,
            required_force_n=zero,
            force_n=zero,
            required_piston_velocity_m_s=zero,
            piston_velocity_m_s=zero,
            q_d=reference.position if joint else np.asarray(q, dtype=float),
            qd_d=zero,
            tip_d_m=np.full(3, np.nan) if joint else reference.position,
            fault=fault,
        )
