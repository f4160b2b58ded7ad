"""Online adaptation: payload, cylinder friction and valve null bias beside a fixed model.

Positions, pressures and valve signals pass the same three averages (time constant `FILTER_S`
each), so that measurement and regressor lag alike; velocity and acceleration are differences of
the filtered position. While a cylinder slides its force gives one equation,

    f - tau(q, qd, qdd) / lever - b xd = m Y_tip / lever + Fc tanh(xd / v0) + db xd,

with Y_tip the torque of 1 kg at the tip (rigid-body regressor of a point mass). While a valve is
open beyond a dead zone the flow of eq. 14 gives another: the signal that the model's valve would
need for the motion seen (eq. 24), less the signal given, is ``u0 - d sign(u) + g u + h |u|``. Null
bias u0 is used; overlap d, gain error g and its difference between directions h are estimated
beside it because they would be taken for it. Effects that the model file lists belong to the
model: their friction is known force, and signals, volumes and flows past the valve pass their
laws, so that nothing is compensated twice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro_control.adaptation.adaptation_model import (
    coulomb,
    force_priors,
    names_of,
    unit_payload,
    valve_priors,
)
from hydro_control.adaptation.adaptation_settings import AdaptationSettings
from hydro_control.adaptation.bounded_estimator import BoundedEstimator
from hydro_control.compensation.compensation import Compensation, Motion
from hydro_control.state.axes import axes_of
from hydro_control.state.filters import Ewma, FilteredDifference, alpha_for
from hydro_control.state.oil_columns import OilColumns, piston_positions, swept_columns
from hydro_model.arrays import BoolArray
from hydro_model.effects import ActiveEffect
from hydro_model.hydraulics.cylinder import lever, piston_force
from hydro_model.hydraulics.valve import signal_at_lengths
from hydro_model.multibody.rigid_body import inverse_dynamics, required_torque
from hydro_model.robot import FloatArray, Robot

#: Time constant of each of the three averages: 8 Hz each, above the motion's band.
FILTER_S = 0.02
#: Samples between two updates of the estimates: the averages hold nothing faster.
EVERY = 5
#: A cylinder slides, and its friction has a sign, above this speed for this long.
SLIDING_M_S = 0.005
SLIDING_S = 0.1
#: A valve is open beyond its overlap, and not saturated, between these signals.
OPEN_SIGNAL, FULL_SIGNAL = 0.03, 0.9
#: Rounding of Coulomb's law: as measured, and as compensated at the required velocity, where a
#: step would be a step of the required force.
MEASURED_SCALE_M_S, REQUIRED_SCALE_M_S = 0.002, 0.02
#: Error of the force model and of the valve model, variance times correlation time.
FORCE_DENSITY = 300.0**2 * 0.1
SIGNAL_DENSITY = 0.01**2 * 0.1
#: Samples between a command and the spool that follows it.
COMMAND_SAMPLES = 2


class Adaptation:
    """Estimates beside the model of one robot, and what the control law adds for them.

    Parameters
    ----------
    robot : Robot
        The fixed model; every joint with a cylinder with a valve.
    settings : AdaptationSettings
    dt_s : float
        Sample time.
    effects : sequence of ActiveEffect
        Listed effects that the control law compensates.

    Attributes
    ----------
    names : tuple of str
        Of the values that `used` and `estimates` hold, in order.
    frozen : bool
        The newest update had no equation for want of motion.

    Raises
    ------
    ControlError, RobotError
        The robot cannot be controlled.
    """

    def __init__(
        self,
        robot: Robot,
        settings: AdaptationSettings,
        dt_s: float,
        effects: Sequence[ActiveEffect] = (),
    ) -> None:
        self.robot, self.settings, self.dt_s = robot, settings, dt_s
        self._axes = axes_of(robot)
        # At the measured motion, a sign needs no rounding of its own: only what slides counts.
        self._listed = Compensation(robot, effects, self._axes, EVERY * dt_s, 0.0)
        self._tip = unit_payload(robot)
        self._viscous = np.array([a.cylinder.viscous_friction for a in self._axes])
        self._force = BoundedEstimator(force_priors(self._axes, settings))
        self._valves = [BoundedEstimator(valve_priors(settings)) for _ in self._axes]
        self.names = names_of(self._axes)
        self._largest = np.concatenate([self._force.upper, [settings.null_bias] * len(self._axes)])
        self._chosen = self._mask()
        weight = alpha_for(FILTER_S, dt_s)
        self._averages = [Ewma(weight) for _ in range(3)]
        self._rates = [FilteredDifference(1.0, dt_s) for _ in range(2)]
        self.used: FloatArray = np.zeros(len(self.names))
        # Compiled before the first sample, not in it.
        still = np.zeros(robot.dof)
        inverse_dynamics(self._tip, still, still, coulomb(still, MEASURED_SCALE_M_S))
        self.reset()

    def _mask(self) -> FloatArray:
        n, kinds = len(self._axes), self.settings.kinds
        counts = (("payload", 1), ("friction", 2 * n), ("null_bias", n))
        return np.concatenate([np.full(size, float(kind in kinds)) for kind, size in counts])

    def reset(self, *, used: bool = True) -> None:
        """Back to the model.

        Parameters
        ----------
        used : bool
            What the law uses goes at once; otherwise at its usual pace.
        """
        self.forget()
        self._force.reset()
        for valve in self._valves:
            valve.reset()
        if used:
            self.used = np.zeros(len(self.names))

    def forget(self) -> None:
        """Drop the samples, after a gap; the estimates stay."""
        for average in self._averages:
            average.reset()
        for rate in self._rates:
            rate.reset()
        self._listed.reset()
        n = len(self._axes)
        self._commands = [np.zeros(n)] * (COMMAND_SAMPLES + 1)
        self._settled = 0
        self._slid_s = np.zeros(n)
        self._force_last: FloatArray | None = None
        self.frozen = True

    @property
    def estimates(self) -> FloatArray:
        """What is estimated, by `names`."""
        return np.concatenate([self._force.value, [v.value[0] for v in self._valves]])

    @property
    def std(self) -> FloatArray:
        """Standard deviations of `estimates`, as the estimator has them."""
        return np.concatenate([self._force.std, [v.std[0] for v in self._valves]])

    def report(self) -> dict[str, object]:
        """Keys and values for `/diagnostics`."""
        estimates, std = self.estimates, self.std
        lower = np.concatenate([self._force.lower, [v.lower[0] for v in self._valves]])
        # A parameter whose bound is its own start rests there, which says nothing.
        pushed = (estimates != 0.0) & ((estimates <= lower) | (estimates >= self._largest))
        at_bound = [name for name, out in zip(self.names, pushed, strict=True) if out]
        values: dict[str, object] = {
            "adaptation": " ".join(self.settings.kinds),
            "adaptation_frozen": "yes" if self.frozen else "no",
            "adaptation_updates": self._force.updates,
            "adaptation_at_bound": " ".join(at_bound),
        }
        for name, used, estimate, spread in zip(
            self.names, self.used, estimates, std, strict=True
        ):
            values[f"adapted/{name}"] = f"{used:.6g}"
            values[f"estimate/{name}"] = f"{estimate:.6g}"
            values[f"std/{name}"] = f"{spread:.3g}"
        return values

    def required_force(
        self, q: FloatArray, qd: FloatArray, qd_r: FloatArray, qdd_r: FloatArray, arm: FloatArray
    ) -> FloatArray:
        """What eq. 22 needs beyond the model at the required motion.

        Parameters
        ----------
        q, qd, qd_r, qdd_r, arm : (n,) array
            Positions, velocities, required velocities and accelerations, levers.

        Returns
        -------
        (n,) array
            N at the pistons.
        """
        if not np.any(self.used):
            return np.zeros_like(q)
        n = len(self._axes)
        tip = required_torque(self._tip, q, qd, qd_r, qdd_r, 0.0) / arm
        xd_r = arm * qd_r
        size, viscous = self.used[1 : n + 1], self.used[n + 1 : 2 * n + 1]
        rubbing = size * coulomb(xd_r, REQUIRED_SCALE_M_S)
        return np.asarray(self.used[0] * tip + rubbing + viscous * xd_r)

    @property
    def null_bias(self) -> FloatArray:
        """Null biases to take off the valve signals of eq. 24, by joint (n,)."""
        return self.used[2 * len(self._axes) + 1 :]

    def observe(
        self,
        q: FloatArray,
        pressures: FloatArray,
        p_s: float,
        p_t: float,
        voltage_v: FloatArray,
        steps: int = 1,
    ) -> None:
        """Take one sample, and let what the law uses follow the estimates.

        Parameters
        ----------
        q : (n,) array
            As measured.
        pressures : (2, m) array
            Gauge, as measured.
        p_s, p_t : float
            Gauge.
        voltage_v : (m,) array
            Just commanded, per valve in the robot's order.
        steps : int
            Sample times since the last sample.
        """
        n = len(self._axes)
        signal = [voltage_v[a.valve_index] / a.valve.rated_voltage_v for a in self._axes]
        self._commands = [*self._commands[1:], np.array(signal)]
        row = np.concatenate([q, pressures.ravel(), self._commands[0], (p_s, p_t)])
        for average in self._averages:
            row = average.update(row, steps)
        qd = self._rates[0].update(row[:n], steps)
        qdd = self._rates[1].update(qd, steps)
        self._settled += 1
        if self._settled % EVERY == 0 and self._settled * self.dt_s > 10.0 * FILTER_S:
            self._estimate(row, qd, qdd)
        most = self._largest * (self.dt_s / self.settings.ramp_s)
        wanted = self.estimates * self._chosen
        self.used = np.clip(wanted, self.used - most, self.used + most)

    def _estimate(self, row: FloatArray, qd: FloatArray, qdd: FloatArray) -> None:
        n, m = len(self._axes), len(self.robot.cylinders)
        q, pressures = row[:n], row[n : n + 2 * m].reshape(2, m)
        signal, (p_s, p_t) = row[n + 2 * m : 2 * n + 2 * m], row[-2:]
        arm = np.array([float(lever(a.cylinder, x)) for a, x in zip(self._axes, q, strict=True)])
        xd = arm * qd
        at = pressures[:, [a.cylinder_index for a in self._axes]]
        force = np.array(
            [float(piston_force(a.cylinder, *p)) for a, p in zip(self._axes, at.T, strict=True)]
        )
        columns = swept_columns(self._axes, q)
        if self._listed.any:
            time_s = self._settled * self.dt_s
            x = piston_positions(self._axes, q)
            self._listed.observe(Motion(time_s, q, qd, qdd, arm, x, pressures, p_s, p_t, force))
            # Flows past the valve are those of its opening, which has to be known first.
            signal = self._listed.openings(signal)
            columns = self._listed.columns(columns)
        self._slid_s = np.where(np.abs(xd) > SLIDING_M_S, self._slid_s + EVERY * self.dt_s, 0.0)
        slides = self._slid_s > SLIDING_S
        self.frozen = not slides.any()
        if not self.frozen:
            self._estimate_force(q, qd, qdd, arm, xd, force, slides)
            self._estimate_valves(columns, xd, force, at, p_s, p_t, signal, slides)
        self._force_last = force

    def _estimate_force(
        self,
        q: FloatArray,
        qd: FloatArray,
        qdd: FloatArray,
        arm: FloatArray,
        xd: FloatArray,
        force: FloatArray,
        slides: BoolArray,
    ) -> None:
        n = len(self._axes)
        known = inverse_dynamics(self.robot, q, qd, qdd) / arm + self._viscous * xd
        if self._listed.any:
            known = known + self._listed.friction()
        rows = np.zeros((n, 2 * n + 1))
        rows[:, 0] = inverse_dynamics(self._tip, q, qd, qdd) / arm
        rows[:, 1 : n + 1] = np.diag(coulomb(xd, MEASURED_SCALE_M_S))
        rows[:, n + 1 :] = np.diag(xd)
        self._force.update(
            rows[slides],
            (force - known)[slides],
            FORCE_DENSITY,
            self.settings.dead_zone_n,
            EVERY * self.dt_s,
        )

    def _estimate_valves(
        self,
        columns: OilColumns,
        xd: FloatArray,
        force: FloatArray,
        at: FloatArray,
        p_s: float,
        p_t: float,
        signal: FloatArray,
        slides: BoolArray,
    ) -> None:
        if self._force_last is None:
            return
        rate = (force - self._force_last) / (EVERY * self.dt_s)
        for i, (axis, valve) in enumerate(zip(self._axes, self._valves, strict=True)):
            u = signal[i]
            if not (slides[i] and OPEN_SIGNAL < abs(u) < FULL_SIGNAL):
                continue
            c = axis.cylinder
            lengths = columns.a_m[i], columns.b_m[i]
            area = c.area_a_m2 / lengths[0] + c.area_b_m2 / lengths[1]
            flow = -area * xd[i] - rate[i] / c.bulk_modulus_pa
            if columns.leak is not None:
                flow += columns.leak[i]
            p_a, p_b = at[:, i]
            seen = float(signal_at_lengths(axis.valve, flow, *lengths, p_a, p_b, p_s, p_t))
            row = np.array([[1.0, -np.copysign(1.0, u), u, abs(u)]])
            valve.update(row, np.array([seen - u]), SIGNAL_DENSITY, 0.0, EVERY * self.dt_s)
