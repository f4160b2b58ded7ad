"""What a motion tells about the force parameters, given residuals that remember.

Least squares with residuals of covariance ``sigma^2 rho^|t - s|`` (what a model leaves out of a
crane is correlated over some tenths of a second) has the covariance ``H^-1 M H^-1`` with
``H = sum x x^T`` and ``M = sum_ts rho^|t - s| x_t x_s^T``: the population value of what
`estimate.statistics.least_squares` estimates from the residuals of a run.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hydro_ident.estimate.effects.listed_effects import ListedEffects
from hydro_ident.estimate.forces.inertial import ForceModel, Motion, force_columns, force_model
from hydro_ident.estimate.signals.derivatives import FilterSettings, parallel_filter
from hydro_ident.estimate.signals.traces import Trace
from hydro_model.hydraulics.cylinder import lever, stroke
from hydro_model.multibody.joint_ranges import middle
from hydro_model.multibody.rigid_body import inverse_dynamics
from hydro_model.robot import FloatArray, Robot


@dataclass(frozen=True, slots=True)
class Residual:
    """What the model is expected to leave unexplained, beside the sensors' noise.

    Attributes
    ----------
    force_share : float
        Standard deviation over the range of forces that the supply can give (or twice the
        effort limit): 3 kN for an 80 mm cylinder at 190 bar, most of it friction.
    flow_share : float
        Over the flow of the fully open edge at half the supply pressure.
    correlation_s : float
        Time constant of its exponential correlation.
    """

    force_share: float = 0.02
    flow_share: float = 0.0075
    correlation_s: float = 0.4


@dataclass(frozen=True)
class ForceInformation:
    """The force regressor of a robot in units in which columns and rows are alike.

    Attributes
    ----------
    robot : Robot
    residual : Residual
    effects : ListedEffects or None
        Whose friction is told beside the base model's; a run is designed without, since their
        signs of velocity are no ground for an optimiser to climb on.
    """

    robot: Robot
    residual: Residual
    effects: ListedEffects | None = None

    @cached_property
    def model(self) -> ForceModel:
        """The links' base parameters, viscous friction, then the effects'.

        Barrels and rods take no part: no run may show them.
        """
        torque = not self.robot.cylinders
        if self.effects is None:
            return force_model(self.robot, torque, parts=False)
        names, columns = self.effects.force_names, self.effects.force_columns
        return force_model(self.robot, torque, names, columns, parts=False)

    @cached_property
    def channel_std(self) -> FloatArray:
        """Expected residual of every channel, shape (n,), N or N m."""
        robot = self.robot
        spans = np.array([2.0 * joint.effort_limit for joint in robot.joints])
        for cylinder in robot.cylinders:
            j = robot.joint_index(cylinder.joint)
            pressure = robot.supply_pressure_pa - robot.tank_pressure_pa
            if pressure > 0.0:
                spans[j] = pressure * (cylinder.area_a_m2 + cylinder.area_b_m2)
            else:
                spans[j] /= abs(float(lever(cylinder, middle(robot)[j])))
        return np.asarray(self.residual.force_share * spans)

    def columns(
        self, q: FloatArray, qd: FloatArray, qdd: FloatArray, trace: Trace | None = None
    ) -> FloatArray:
        """Unfiltered regressor over the channels' residuals, shape (N, n, p).

        Parameters
        ----------
        q, qd, qdd : (N, n) array
        trace : Trace, optional
            With the pressures along the motion, which some effects look at.
        """
        trace = trace or bare_trace(self.robot, q, 1.0)
        raw = force_columns(self.model, trace, Motion(q, qd, qdd))
        if self.effects is not None:
            # Seal friction of a cylinder whose pressures nobody knows tells nothing.
            raw = np.where(np.isfinite(raw), raw, 0.0)
        return raw / self.channel_std[:, None]

    def filtered(
        self,
        q: FloatArray,
        qd: FloatArray,
        qdd: FloatArray,
        trace: Trace,
        filters: FilterSettings,
    ) -> tuple[FloatArray, float]:
        """The rows that a recording of this motion gives, and their spacing in s."""
        step_s = trace.step_s
        rows = parallel_filter(self.columns(q, qd, qdd, trace), step_s, filters)
        return rows, step_s * filters.decimation(step_s)


def bare_trace(robot: Robot, q: FloatArray, step_s: float) -> Trace:
    """A trace of positions alone: pressures and signals are not known."""
    count = len(q)
    unknown = np.full((count, len(robot.cylinders)), np.nan)
    strokes = [stroke(c, q[:, robot.joint_index(c.joint)]) for c in robot.cylinders]
    return Trace(
        label="design#0",
        step_s=step_s,
        time_s=step_s * np.arange(count, dtype=np.float64),
        q=q,
        stroke=np.column_stack(strokes) if strokes else unknown,
        p_a=unknown,
        p_b=unknown,
        supply=np.full(count, robot.supply_pressure_pa),
        tank=np.full(count, robot.tank_pressure_pa),
        valve_signal=unknown,
        joint_torque=np.full(q.shape, np.nan),
    )


def required_forces(robot: Robot, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """Piston force of every cylinder along a motion (eq. 22 without feedback), shape (N, m)."""
    torque = np.asarray(inverse_dynamics(robot, q, qd, qdd))
    forces = np.zeros((len(q), len(robot.cylinders)))
    for i, cylinder in enumerate(robot.cylinders):
        j = robot.joint_index(cylinder.joint)
        arm = lever(cylinder, q[:, j])
        forces[:, i] = torque[:, j] / arm + cylinder.viscous_friction * arm * qd[:, j]
    return forces


def moments(x: FloatArray, step_s: float, correlation_s: float) -> tuple[FloatArray, FloatArray]:
    """H and M of the module's text, at unit variance.

    Parameters
    ----------
    x : (..., T, k, p) array
        Rows of k channels whose residuals are independent of one another.
    step_s : float
        Between rows.
    correlation_s : float

    Returns
    -------
    bread, middle : (..., p, p) array
    """
    from scipy.signal import lfilter

    rho = float(np.exp(-step_s / correlation_s))
    size = x.shape[-1]
    flat = (*x.shape[:-3], -1, size)
    # One pass of the recursive filter sums rho^(t - s) x_s over the past of every row.
    past = lfilter([1.0], [1.0, -rho], x, axis=-3).reshape(flat)
    rows = np.swapaxes(x.reshape(flat), -1, -2)
    bread = rows @ x.reshape(flat)
    lagged = rows @ past
    return bread, lagged + np.swapaxes(lagged, -1, -2) - bread


def sandwich(bread: FloatArray, middle: FloatArray) -> FloatArray:
    """Covariance ``H^-1 M H^-1``, solved with unit diagonal; shapes (..., p, p).

    A parameter without information gets a large but finite variance, so that an optimiser can
    climb out of it.

    `bread` is H, the information, and `middle` M.
    """
    size = np.sqrt(np.maximum(np.einsum("...ii->...i", bread), 1e-30))
    scale = size[..., :, None] * size[..., None, :]
    identity = np.eye(bread.shape[-1])
    inverse = np.linalg.inv(bread / scale + 1e-12 * identity)
    return np.asarray(inverse @ (middle / scale) @ inverse / scale)
